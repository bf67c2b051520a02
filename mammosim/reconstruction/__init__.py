"""Slices of a compressed breast from the projections of a tomosynthesis series."""

from mammosim.reconstruction.keys import ReconstructionKeys, SeriesKeys
from mammosim.reconstruction.reconstruct import (
    Reconstruction,
    check_reconstruction,
    reconstruct,
    reconstruction_gb,
    reconstruction_seconds,
)
from mammosim.reconstruction.rtk import load_rtk
from mammosim.reconstruction.settings import ReconstructionSettings, SeriesSettings
from mammosim.reconstruction.synthetic import METHOD, Synthetic, synthetic_mammogram
from mammosim.reconstruction.volume import Box, VolumeGrid, box_above, volume_grid

__all__ = [
    "METHOD",
    "Box",
    "Reconstruction",
    "ReconstructionKeys",
    "ReconstructionSettings",
    "SeriesKeys",
    "SeriesSettings",
    "Synthetic",
    "VolumeGrid",
    "box_above",
    "check_reconstruction",
    "load_rtk",
    "reconstruct",
    "reconstruction_gb",
    "reconstruction_seconds",
    "synthetic_mammogram",
    "volume_grid",
]
