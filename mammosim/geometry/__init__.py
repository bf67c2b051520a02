"""Frames (breast, compression, gantry, detector) and views (CC, MLO, ML)."""

from mammosim.geometry.frames import VoxelFrame, compression_from_breast
from mammosim.geometry.gantry import MAGNIFIED, Gantry, magnification
from mammosim.geometry.views import VIEW_NAMES, View

__all__ = [
    "MAGNIFIED",
    "VIEW_NAMES",
    "Gantry",
    "View",
    "VoxelFrame",
    "compression_from_breast",
    "magnification",
]
