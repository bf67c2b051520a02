"""The generator: a breast from a seed."""

from mammosim.phantom.anatomy.generate import generate_phantom
from mammosim.phantom.anatomy.settings import DENSITY_ALIASES, DENSITY_PERCENT, GenerateSettings

__all__ = ["DENSITY_ALIASES", "DENSITY_PERCENT", "GenerateSettings", "generate_phantom"]
