"""Compression of the breast between paddle and support."""

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.compress import compress
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.inverse import InverseMap
from mammosim.compression.keys import CompressionKeys
from mammosim.compression.lattice import breast_volume_ml
from mammosim.compression.model import MODELS, MechanicalModel, compressing_models
from mammosim.compression.plate_check import check_plates
from mammosim.compression.plates import held_tissue, plate_edge_mm, population_thickness_mm
from mammosim.compression.posture import in_posture, posture_caution
from mammosim.compression.samples import Sample, Sampler
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.uncompressed import held_before
from mammosim.compression.unloading import weightless

__all__ = [
    "MODELS",
    "CompressedBreast",
    "CompressionKeys",
    "CompressionSettings",
    "DisplacementField",
    "InverseMap",
    "MechanicalModel",
    "Sample",
    "Sampler",
    "breast_volume_ml",
    "check_plates",
    "compress",
    "compressing_models",
    "held_before",
    "held_tissue",
    "in_posture",
    "plate_edge_mm",
    "population_thickness_mm",
    "posture_caution",
    "weightless",
]
