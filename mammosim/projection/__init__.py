"""Rays through the deformed voxels: path lengths of each tissue at each pixel."""

from mammosim.projection.arc import Arc, project_arc
from mammosim.projection.channels import channels_of, host_channel
from mammosim.projection.coarse_copy import CoarseBreast, coarse_breast
from mammosim.projection.detector_field import STANDARD_FORMATS_MM, Shadow, cast_shadow
from mammosim.projection.feasible import (
    check_arc,
    check_copy,
    check_memory,
    check_shadow,
    installed_memory,
)
from mammosim.projection.keys import ProjectionKeys, TomosynthesisKeys
from mammosim.projection.open_end import compressed_end
from mammosim.projection.paths import PathLengths
from mammosim.projection.settings import ProjectionSettings, TomosynthesisSettings
from mammosim.projection.trace import project
from mammosim.projection.warp import compressed_labels

__all__ = [
    "STANDARD_FORMATS_MM",
    "Arc",
    "CoarseBreast",
    "PathLengths",
    "ProjectionKeys",
    "ProjectionSettings",
    "Shadow",
    "TomosynthesisKeys",
    "TomosynthesisSettings",
    "cast_shadow",
    "channels_of",
    "check_arc",
    "check_copy",
    "check_memory",
    "check_shadow",
    "coarse_breast",
    "compressed_end",
    "compressed_labels",
    "host_channel",
    "installed_memory",
    "project",
    "project_arc",
]
