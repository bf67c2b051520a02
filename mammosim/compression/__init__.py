"""Compression of the breast between paddle and support."""

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.compress import MODELS, compress
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.inverse import InverseMap
from mammosim.compression.samples import Sample, Sampler
from mammosim.compression.settings import CompressionSettings

__all__ = [
    "MODELS",
    "CompressedBreast",
    "CompressionSettings",
    "DisplacementField",
    "InverseMap",
    "Sample",
    "Sampler",
    "compress",
]
