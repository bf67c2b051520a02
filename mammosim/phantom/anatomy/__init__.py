"""The generator: a breast from a seed."""

from mammosim.phantom.anatomy.body import expected_volume_ml
from mammosim.phantom.anatomy.generate import generate_phantom
from mammosim.phantom.anatomy.keys import GenerateKeys
from mammosim.phantom.anatomy.outlined import generate_outline
from mammosim.phantom.anatomy.settings import DENSITY_ALIASES, DENSITY_PERCENT, GenerateSettings

__all__ = [
    "DENSITY_ALIASES",
    "DENSITY_PERCENT",
    "GenerateKeys",
    "GenerateSettings",
    "expected_volume_ml",
    "generate_outline",
    "generate_phantom",
]
