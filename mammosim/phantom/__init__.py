"""The uncompressed breast: readers, generator, lesions, checks."""

from mammosim.phantom.anatomy import GenerateSettings, generate_phantom
from mammosim.phantom.breast import BreastPhantom, Landmark, Lesion, OpenEnd
from mammosim.phantom.lesions import insert_lesions
from mammosim.phantom.make import make_phantom
from mammosim.phantom.open_end import as_held, leaves_picture, without_open_end
from mammosim.phantom.read import read_phantom
from mammosim.phantom.settings import LandmarkSettings, LesionSettings, PhantomSettings
from mammosim.phantom.summary import PhantomSummary, phantom_summary

__all__ = [
    "BreastPhantom",
    "GenerateSettings",
    "Landmark",
    "LandmarkSettings",
    "Lesion",
    "LesionSettings",
    "OpenEnd",
    "PhantomSettings",
    "PhantomSummary",
    "as_held",
    "generate_phantom",
    "insert_lesions",
    "leaves_picture",
    "make_phantom",
    "phantom_summary",
    "read_phantom",
    "without_open_end",
]
