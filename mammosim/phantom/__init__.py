"""The uncompressed breast: readers, generator, lesions, checks."""

from mammosim.phantom.breast import BreastPhantom, Landmark, Lesion

__all__ = ["BreastPhantom", "Landmark", "Lesion"]
