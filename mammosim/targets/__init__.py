"""Where lesions, landmarks and the nipple are: before, after, and on the image."""

from mammosim.targets.anatomy import clock_position
from mammosim.targets.biopsy import BiopsyResult, aim_needles
from mammosim.targets.find import find_targets
from mammosim.targets.in_volume import in_volume
from mammosim.targets.keys import TargetsKeys
from mammosim.targets.lesion_shift_results import LesionShiftResults
from mammosim.targets.lesion_voxels import touching_lesions
from mammosim.targets.locate import (
    ImagePoint,
    Located,
    RayCurve,
    curve_of,
    point_at_height,
    point_from_image_points,
    stereotactic,
)
from mammosim.targets.origins import UncompressedTarget, mean_shift_mm, target_origins
from mammosim.targets.settings import BiopsySettings, TargetsSettings, UncertaintySettings
from mammosim.targets.target import Target
from mammosim.targets.uncertainty import (
    ShiftUncertainty,
    draw_samples,
    sampled_shifts,
    uncertainties,
)
from mammosim.targets.view_rules import RuleError, rule_errors
from mammosim.targets.warnings import lesion_cut_off, target_warnings

__all__ = [
    "BiopsyResult",
    "BiopsySettings",
    "ImagePoint",
    "LesionShiftResults",
    "Located",
    "RayCurve",
    "RuleError",
    "ShiftUncertainty",
    "Target",
    "TargetsKeys",
    "TargetsSettings",
    "UncertaintySettings",
    "UncompressedTarget",
    "aim_needles",
    "clock_position",
    "curve_of",
    "draw_samples",
    "find_targets",
    "in_volume",
    "lesion_cut_off",
    "mean_shift_mm",
    "point_at_height",
    "point_from_image_points",
    "rule_errors",
    "sampled_shifts",
    "stereotactic",
    "target_origins",
    "target_warnings",
    "touching_lesions",
    "uncertainties",
]
