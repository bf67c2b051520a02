"""Where lesions, landmarks and the nipple are: before, after, and on the image."""

from mammosim.targets.target import Target

__all__ = ["Target"]
