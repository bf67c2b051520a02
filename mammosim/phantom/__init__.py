"""The uncompressed breast: readers, generator, lesions, checks."""

from mammosim.phantom.anatomy import GenerateSettings, generate_phantom
from mammosim.phantom.breast import BreastPhantom, Landmark, Lesion
from mammosim.phantom.lesions import insert_lesions
from mammosim.phantom.make import make_phantom
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
    "PhantomSettings",
    "PhantomSummary",
    "generate_phantom",
    "insert_lesions",
    "make_phantom",
    "phantom_summary",
    "read_phantom",
]
