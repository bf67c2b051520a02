"""How large a phantom will be, from its header or the generator's settings alone."""

from __future__ import annotations

import numpy as np

from mammosim.phantom.anatomy import expected_volume_ml
from mammosim.phantom.settings import PhantomSettings, Side
from mammosim.phantom.voxels import open_checked
from mammosim.tissues import load_label_map

BOX_PART = 6.4
"""Of the breast's volume: the box around it with its muscle, its extension towards the axilla
and the abdominal wall; the median of 24 drawn breasts, of which 5.2 to 8.1 was seen."""


def expected_voxels(
    settings: PhantomSettings, seed: int = 1, laterality: Side = "L"
) -> tuple[int, float]:
    """Number of voxels and volume of one, mm3, without reading or generating any.

    Parameters
    ----------
    settings : PhantomSettings
        With absolute paths, where it names files.
    seed : int
        Of the generator, which may draw the volume.
    laterality : {"L", "R"}
        Breast, whose volume is drawn.

    Raises
    ------
    InputError
        If the file is missing, of an unknown format, has no readable header or does not fit into
        memory, or the label map cannot be used.
    """
    if settings.generate is not None:
        volume_mm3 = 1e3 * expected_volume_ml(settings.generate, seed, laterality)
        voxel_mm3 = settings.generate.voxel_mm**3
        return int(BOX_PART * volume_mm3 / voxel_mm3), voxel_mm3
    if settings.labels is not None:
        load_label_map(settings.labels)
    opened = open_checked(str(settings.file), settings.axes, settings.reduce)
    spacing = opened.voxel_mm if settings.voxel_mm is None else settings.voxel_mm
    voxel_mm3 = float(np.prod(np.broadcast_to(spacing, 3))) * settings.reduce**3
    return max(opened.count // settings.reduce**3, 1), voxel_mm3
