"""The background of the image of iodine: the breast's margin, and what is wider than a lesion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition.blocks import block_mean, cell_pixels
from mammosim.acquisition.breast_outline import wall_is_left, without_nipple

CELL_MM = 1.0
"""Side of the cells in which the background is found."""

SKIN_ATTENUATION = 0.15
"""Logarithmic attenuation of the low-energy beam from which a cell belongs to the breast: that of
the skin alone, 1.5 mm (0.1 per mm at 20 keV)."""

SPECK_CELLS = 2
"""Half the width, in cells, below which what lies apart from the breast is noise."""

BACKGROUND_SIGMA_MM = 10.0
"""Standard deviation of the window whose mean is taken for background. A lesion of 10 mm loses an
eighth of its brightness by it, one of 20 mm two fifths. Chosen."""

MAX_UNEVENNESS_MG_CM2 = 2.0
"""What is further from the two profiles than this counts as so much in that mean. Chosen, above the
iodine of most lesions, so that a plate's edge leaves no wide shadow beside it."""

NIPPLE_SIGMA_MM, NIPPLE_CELLS = 1.0, 2
"""The same for a nipple in profile, whose thickness has nothing to do with the margin's, and the
cells around it that belong to it. Chosen."""

WALL_MM = 20.0
"""So far from the chest wall the breast is taken to thicken alike all along it: it bulges behind
the plates' edge, which is rounded, and begins to do so in front of it. Chosen."""


def flattened(
    iodine: NDArray[np.float32],
    low_attenuation: NDArray[np.float32],
    pixel_mm: float,
    thickness_mm: float,
) -> NDArray[np.float32]:
    """The image of iodine as a reader sees it, flat from the chest wall to the skin.

    Parameters
    ----------
    iodine : ndarray of float32, [row, column]
        Recombined image, mg/cm2.
    low_attenuation : ndarray of float32, [row, column]
        Logarithmic attenuation of the low-energy exposure, which shows where the breast is.
    pixel_mm, thickness_mm : float
        Pixel pitch, and thickness of the compressed breast, mm.

    Notes
    -----
    A millimetre of fat more or less is as bright as 0.8 mg/cm2. Three things are taken for a
    difference of thickness and subtracted:

    * the median over all places at one distance from the skin, as far in as the breast is thick
      and constant from there on: the margin bulges freely, and nearly alike all along the breast.
      Clinical systems also correct it by a model of the margin's shape, and leave a rim in 97
      to 99 per cent of images (Yagil et al. 2016, Clin Radiol 71:450). A nipple in profile is
      left out, since behind it the margin is no deeper, and loses its own mean;
    * of the rest, the median over all places at one distance from the chest wall, up to `WALL_MM`:
      the breast bulges behind the plates' edge too;
    * of the rest, the mean over `BACKGROUND_SIGMA_MM` inside the breast.

    Nothing is subtracted outside the breast.
    """
    cell = cell_pixels(CELL_MM, pixel_mm)
    inside = _breast(block_mean(low_attenuation, cell) > SKIN_ATTENUATION)
    if not inside.any():
        return iodine.copy()
    level, cell_mm = block_mean(iodine, cell), cell * pixel_mm
    body = without_nipple(inside, cell_mm)
    depth_mm = _depth_mm(body, cell_mm, thickness_mm)
    margin = body & (depth_mm < thickness_mm)
    places_mm, profile = _profile(level[margin], depth_mm[margin])
    uneven = level - np.interp(depth_mm, places_mm, profile)
    uneven -= (wall := _wall(uneven, body, cell_mm))
    nipple = inside & ndimage.binary_dilation(inside & ~body, iterations=NIPPLE_CELLS)
    own = _mean_inside(uneven, nipple, NIPPLE_SIGMA_MM / cell_mm)
    np.clip(uneven, -MAX_UNEVENNESS_MG_CM2, MAX_UNEVENNESS_MG_CM2, out=uneven)
    mean = _mean_inside(uneven, body, BACKGROUND_SIGMA_MM / cell_mm)
    wide = np.where(nipple, own, wall + mean)
    flat = iodine.copy()
    for line, depth, rest, within in zip(
        flat, *(_in_pixels(grid, cell, iodine.shape) for grid in (depth_mm, wide, inside)),
        strict=True,
    ):  # fmt: skip
        line -= np.where(within > 0.0, np.interp(depth, places_mm, profile) + rest, 0.0)
    return flat


def _wall(
    level: NDArray[np.float64], body: NDArray[np.bool_], cell_mm: float
) -> NDArray[np.float64]:
    """Median of each column near the chest wall.

    Counted from the last column, behind which nothing is subtracted.
    """
    wall = np.zeros(level.shape)
    ahead = slice(None, None, 1 if wall_is_left(body) else -1)
    columns = min(round(WALL_MM / cell_mm) + 1, level.shape[1])
    near = [
        float(np.median(values[within])) if within.any() else 0.0
        for values, within in zip(level.T[ahead][:columns], body.T[ahead][:columns], strict=True)
    ]
    wall[:, ahead][:, :columns] = np.array(near) - near[-1]
    return wall


def _breast(attenuating: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that attenuate, without specks; the breast goes on beyond the image's edge."""
    beyond = np.pad(attenuating, 2 * SPECK_CELLS, mode="edge")
    opened = ndimage.binary_opening(beyond, iterations=SPECK_CELLS)
    inner = slice(2 * SPECK_CELLS, -2 * SPECK_CELLS)
    return np.asarray(opened[inner, inner])


def _depth_mm(inside: NDArray[np.bool_], cell_mm: float, max_mm: float) -> NDArray[np.float64]:
    """Distance of each cell from the skin, mm, at most `max_mm`; the image's edge is no skin."""
    if inside.all():
        return np.full(inside.shape, max_mm)
    distance = ndimage.distance_transform_edt(inside) * cell_mm
    # The mask's steps would be drawn as streaks along the skin.
    smooth: NDArray[np.float64] = ndimage.gaussian_filter(distance, 1.0, mode="nearest")
    return np.minimum(smooth, max_mm)


def _profile(
    level: NDArray[np.float64], depth_mm: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depths of rings one cell wide, and the median level in each that has a cell."""
    ring = (depth_mm / CELL_MM).astype(np.intp)
    found = np.unique(ring)
    places = (found.astype(np.float64) + 0.5) * CELL_MM
    return places, np.asarray(ndimage.median(level, ring, found), dtype=np.float64)


def _mean_inside(
    values: NDArray[np.float64], inside: NDArray[np.bool_], sigma: float
) -> NDArray[np.float64]:
    """Mean of the values inside over a Gaussian window; 0 far from the breast."""
    weight = ndimage.gaussian_filter(inside.astype(np.float64), sigma, mode="nearest")
    total = ndimage.gaussian_filter(np.where(inside, values, 0.0), sigma, mode="nearest")
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 1e-3)


def _in_pixels(
    grid: NDArray[np.generic], cell: int, shape: tuple[int, ...]
) -> Iterator[NDArray[np.float64]]:
    """Rows of pixels of a grid of cells, interpolated linearly one row at a time."""
    rows, columns = ((np.arange(size) + 0.5) / cell - 0.5 for size in shape)
    values = grid.astype(np.float64)
    across = np.arange(values.shape[1])
    for row in np.clip(rows, 0.0, values.shape[0] - 1.0):
        low = min(int(row), max(values.shape[0] - 2, 0))
        high, part = min(low + 1, values.shape[0] - 1), row - low
        yield np.interp(columns, across, (1.0 - part) * values[low] + part * values[high])
