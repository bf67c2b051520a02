"""Where lesions, landmarks and the nipple are: before, after, and on the image."""

from mammosim.targets.find import find_targets
from mammosim.targets.lesion_voxels import touching_lesions
from mammosim.targets.settings import TargetsSettings
from mammosim.targets.target import Target

__all__ = ["Target", "TargetsSettings", "find_targets", "touching_lesions"]
