"""Rays through the deformed voxels: path lengths of each tissue at each pixel."""

from mammosim.projection.paths import PathLengths
from mammosim.projection.settings import ProjectionSettings
from mammosim.projection.trace import project
from mammosim.projection.warp import compressed_labels

__all__ = ["PathLengths", "ProjectionSettings", "compressed_labels", "project"]
