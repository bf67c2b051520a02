"""The steps of voxels larger than a pixel, taken out of what attenuates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import Gantry
from mammosim.phantom import LESION_KINDS
from mammosim.projection.channels import Channels

SMOOTHING_VOXELS = 0.35
"""Standard deviation of the smoothing in voxels: what repeats with every voxel is left to 9 %."""

_REACH = 3.0  # standard deviations at which the smoothing is cut off


def smooth_voxels(
    attenuating_mm: NDArray[np.float32],
    channels: Channels,
    gantry: Gantry,
    voxel_mm: NDArray[np.float64],
    thickness_mm: float,
) -> None:
    """Smooth attenuating lengths in place over the shadow of a voxel.

    Parameters
    ----------
    attenuating_mm : ndarray of float32, [channel, row, column]
    channels : Channels
    gantry : Gantry
    voxel_mm : ndarray, (3,)
        Edges of the phantom's voxels, mm; the longest counts.
    thickness_mm : float
        Gap between the plates' faces, mm.

    Notes
    -----
    A curved surface made of voxels is a staircase. Rays that graze it, as all do near the skin
    line, see steps that repeat with every voxel and draw a weave into the picture. Nothing finer
    than a voxel is known of the breast, so a Gaussian of about a third of a voxel, as seen at
    mid-height, costs little. Voxels no larger than a pixel there are left alone. Sums are kept,
    but for what crosses the picture's border.
    """
    to_spot = gantry.source_to_detector_mm - gantry.support_to_detector_mm - 0.5 * thickness_mm
    shadow_px = float(voxel_mm.max()) * gantry.source_to_detector_mm / to_spot / gantry.pixel_mm
    if shadow_px <= 1.0:
        return
    sigma_px = SMOOTHING_VOXELS * shadow_px
    reach = int(np.ceil(_REACH * sigma_px))
    for image, lesion in zip(attenuating_mm, channels.lesions, strict=True):
        if lesion is not None and LESION_KINDS[lesion.kind].few_voxels:
            continue
        lit = image > 0.0
        rows, columns = (np.flatnonzero(lit.any(axis=axis)) for axis in (1, 0))
        if rows.size:
            box = image[_around(rows, reach), _around(columns, reach)]
            box[:] = ndimage.gaussian_filter(box, sigma_px, mode="nearest", truncate=_REACH)


def _around(places: NDArray[np.intp], reach: int) -> slice:
    return slice(max(0, int(places[0]) - reach), int(places[-1]) + reach + 1)
