"""The uncompressed breast: readers, generator, lesions, checks."""

from mammosim.phantom.anatomy import GenerateSettings, generate_outline, generate_phantom
from mammosim.phantom.breast import (
    BreastPhantom,
    CompressedState,
    Landmark,
    Lesion,
    OpenEnd,
    Posture,
)
from mammosim.phantom.keys import PhantomKeys
from mammosim.phantom.label_counts import label_counts
from mammosim.phantom.label_table import (
    LABELS_FILE,
    LabelledLesion,
    LabelTable,
    table_values,
)
from mammosim.phantom.lesion_kinds import LESION_KINDS, LesionForm, LesionKind
from mammosim.phantom.lesion_shapes import shape_files
from mammosim.phantom.lesions import PlannedLesion, insert_lesions, plan_lesions
from mammosim.phantom.make import make_phantom
from mammosim.phantom.memory import address_bytes, available_bytes
from mammosim.phantom.open_end import abdominal_counts, as_held, leaves_picture, without_open_end
from mammosim.phantom.place import box_text, tissue_at, tissue_box_mm
from mammosim.phantom.read import read_phantom
from mammosim.phantom.readers import BREAST_AXES, TIFF_AXES_KEY, Volume, open_voxels
from mammosim.phantom.settings import LandmarkSettings, LesionSettings, PhantomSettings, Side
from mammosim.phantom.size import expected_voxels
from mammosim.phantom.summary import PhantomSummary, phantom_summary
from mammosim.phantom.translate import count_values, translated
from mammosim.phantom.voxels import read_volume

__all__ = [
    "BREAST_AXES",
    "LABELS_FILE",
    "LESION_KINDS",
    "TIFF_AXES_KEY",
    "BreastPhantom",
    "CompressedState",
    "GenerateSettings",
    "LabelTable",
    "LabelledLesion",
    "Landmark",
    "LandmarkSettings",
    "Lesion",
    "LesionForm",
    "LesionKind",
    "LesionSettings",
    "OpenEnd",
    "PhantomKeys",
    "PhantomSettings",
    "PhantomSummary",
    "PlannedLesion",
    "Posture",
    "Side",
    "Volume",
    "abdominal_counts",
    "address_bytes",
    "as_held",
    "available_bytes",
    "box_text",
    "count_values",
    "expected_voxels",
    "generate_outline",
    "generate_phantom",
    "insert_lesions",
    "label_counts",
    "leaves_picture",
    "make_phantom",
    "open_voxels",
    "phantom_summary",
    "plan_lesions",
    "read_phantom",
    "read_volume",
    "shape_files",
    "table_values",
    "tissue_at",
    "tissue_box_mm",
    "translated",
    "without_open_end",
]
