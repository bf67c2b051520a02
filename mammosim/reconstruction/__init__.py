"""Slices of a compressed breast from the projections of a tomosynthesis series."""

from mammosim.reconstruction.reconstruct import (
    Reconstruction,
    reconstruct,
    reconstruction_gb,
)
from mammosim.reconstruction.settings import ReconstructionSettings
from mammosim.reconstruction.volume import VolumeGrid, volume_grid

__all__ = [
    "Reconstruction",
    "ReconstructionSettings",
    "VolumeGrid",
    "reconstruct",
    "reconstruction_gb",
    "volume_grid",
]
