"""Where lesions, landmarks and the nipple are: before, after, and on the image."""

from mammosim.targets.anatomy import clock_position
from mammosim.targets.find import find_targets
from mammosim.targets.lesion_voxels import touching_lesions
from mammosim.targets.locate import (
    Located,
    RayCurve,
    Sight,
    curve_of,
    point_at_height,
    point_from_sights,
    stereotactic,
)
from mammosim.targets.settings import TargetsSettings
from mammosim.targets.target import Target

__all__ = [
    "Located",
    "RayCurve",
    "Sight",
    "Target",
    "TargetsSettings",
    "clock_position",
    "curve_of",
    "find_targets",
    "point_at_height",
    "point_from_sights",
    "stereotactic",
    "touching_lesions",
]
