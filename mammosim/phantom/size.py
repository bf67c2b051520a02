"""How large a phantom will be, from its header or the generator's settings alone."""

from __future__ import annotations

import numpy as np

from mammosim.phantom.readers import open_voxels
from mammosim.phantom.settings import PhantomSettings

LARGEST_DRAWN_ML = 900.0
"""Largest volume that the generator draws by itself, mL."""

BOX_PART = 3.0
"""Of the breast's volume: the box around it with its muscle; 2.4 to 2.9 was seen."""


def expected_voxels(settings: PhantomSettings) -> tuple[int, float]:
    """Number of voxels and volume of one, mm3, without reading or generating any.

    Parameters
    ----------
    settings : PhantomSettings
        With an absolute path, where it names a file.

    Raises
    ------
    InputError
        If the file is missing, of an unknown format, or has no readable header.
    """
    if settings.generate is not None:
        volume_mm3 = 1e3 * (settings.generate.volume_ml or LARGEST_DRAWN_ML)
        voxel_mm3 = settings.generate.voxel_mm**3
        return int(BOX_PART * volume_mm3 / voxel_mm3), voxel_mm3
    opened = open_voxels(str(settings.file))
    spacing = opened.voxel_mm if settings.voxel_mm is None else settings.voxel_mm
    voxel_mm3 = float(np.prod(np.broadcast_to(spacing, 3))) * settings.reduce**3
    return max(opened.count // settings.reduce**3, 1), voxel_mm3
