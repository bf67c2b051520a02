"""Rays through the deformed voxels: path lengths of each tissue at each pixel."""

from mammosim.projection.paths import PathLengths

__all__ = ["PathLengths"]
