"""Compression of the breast between paddle and support."""

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.displacement import DisplacementField, InverseMap

__all__ = ["CompressedBreast", "DisplacementField", "InverseMap"]
