"""The steps of voxels larger than a pixel, taken out of what attenuates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import Gantry
from mammosim.phantom import LESION_KINDS
from mammosim.projection.channels import Channels
from mammosim.projection.voxel_map import VoxelMap

SMOOTHING_VOXELS = 0.35
"""Standard deviation of the smoothing in stretched voxels: a pattern of that period keeps 9 %."""

STRETCH_QUANTILE = 0.9
"""Of the in-plane stretch over the breast's cells: the weave is clearest where it is large."""

SKIN_FACTOR = 1.5
"""How much wider skin is smoothed: it is a smooth layer, and its steps stand against air along the
edge of the breast, several voxels long. Of steps three voxels long a half is left."""

MAX_STRETCH = 3.0
"""In-plane stretch is taken no larger than this: beyond it the map is torn, not stretched."""

_REACH = 3.0  # standard deviations at which the smoothing is cut off


def smooth_voxels(
    attenuating_mm: NDArray[np.float32],
    channels: Channels,
    gantry: Gantry,
    voxel_mm: tuple[float, float],
    thickness_mm: float,
) -> None:
    """Smooth attenuating lengths in place over the shadow of a voxel.

    Parameters
    ----------
    attenuating_mm : ndarray of float32, [channel, row, column]
    channels : Channels
    gantry : Gantry
    voxel_mm : tuple of float
        Extent of a compressed voxel along y and x of the compression frame, mm
        (`stretched_voxel_mm`).
    thickness_mm : float
        Gap between the plates' faces, mm.

    Notes
    -----
    A curved surface made of voxels is a staircase. Rays that graze it, as all do near the skin
    line, see steps that repeat with every voxel and draw a weave into the picture. Compression
    stretches the voxels in the plane of the image. Nothing finer than a voxel is known of the
    breast, so a Gaussian of about a third of a stretched voxel, as seen at mid-height, costs
    little; skin, a smooth layer, is smoothed more. An axis along which voxels are no larger than a
    pixel there is left alone. Sums are kept, except for what crosses the image border.
    """
    to_spot = gantry.source_to_detector_mm - gantry.support_to_detector_mm - 0.5 * thickness_mm
    scale = gantry.source_to_detector_mm / to_spot / gantry.pixel_mm
    shadow_px = np.array(voxel_mm) * scale
    sigma_px = np.where(shadow_px > 1.0, SMOOTHING_VOXELS * shadow_px, 0.0)
    if not sigma_px.any():
        return
    for image, lesion, material in zip(
        attenuating_mm, channels.lesions, channels.materials, strict=True
    ):
        if lesion is not None and LESION_KINDS[lesion.kind].few_voxels:
            continue
        wide_px = sigma_px * (SKIN_FACTOR if material == "skin" else 1.0)
        row_reach, column_reach = (int(np.ceil(_REACH * sigma)) for sigma in wide_px)
        lit = image > 0.0
        rows, columns = (np.flatnonzero(lit.any(axis=axis)) for axis in (1, 0))
        if rows.size:
            box = image[_around(rows, row_reach), _around(columns, column_reach)]
            box[:] = ndimage.gaussian_filter(box, wide_px, mode="nearest", truncate=_REACH)


def stretched_voxel_mm(mapped: VoxelMap, voxel_mm: NDArray[np.float64]) -> tuple[float, float]:
    """Extent of a compressed voxel along y and x, where it is most stretched.

    Parameters
    ----------
    mapped : VoxelMap
    voxel_mm : ndarray, (3,)
        Edges of the phantom's voxels before compression, mm; the longest counts.

    Returns
    -------
    tuple of float
        Along y, along x, mm.
    """
    cells = mapped.tissue
    extents = []
    for axis in (1, 0):
        first = tuple(slice(None, -1) for _ in range(3))
        second = tuple(slice(1, None) if a == axis else slice(None, -1) for a in range(3))
        nodes = mapped.nodes[..., :3]
        step = (nodes[second][cells] - nodes[first][cells]) * voxel_mm
        original_mm = np.linalg.norm(step.astype(np.float64), axis=1)
        stretch = mapped.frame.spacing_mm[axis] / original_mm[original_mm > 0.0]
        usual = 1.0
        if np.isfinite(stretch).any():
            usual = float(np.nanquantile(stretch, STRETCH_QUANTILE))
        extents.append(float(voxel_mm.max()) * min(usual, MAX_STRETCH))
    return extents[0], extents[1]


def _around(places: NDArray[np.intp], reach: int) -> slice:
    return slice(max(0, int(places[0]) - reach), int(places[-1]) + reach + 1)
