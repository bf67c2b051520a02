"""Breast, outline and nipple of a mammogram as displayed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

PIXEL_MM = 0.1
"""Finer images are brought to this pitch, at which real ones were measured."""

SKIN_CLEARANCE_MM = 8.0
"""The inner breast, in which grey and texture are measured, is deeper than this."""

WALL_CLEARANCE_MM = 2.0
"""And this far from the chest wall's edge of the image."""

DISC_MM = 10.0
"""What no disc of this radius reaches protrudes from the outline: a nipple in profile."""

MIN_NIPPLE_MM = 1.0
"""By at least this much."""

AROUND_MM = 12.0
"""Of the air around the breast, this much is kept."""

_CELLS_PER_SIGMA = 3.0  # of the grid on which wide smoothing is done
_COARSE_MM = 0.5  # grid on which the outline is rounded

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Region:
    """A mammogram with its breast, chest wall at the left.

    Parameters
    ----------
    grey : ndarray of float64, [row, column]
        0 to 1 of the display's range.
    breast, body : ndarray of bool, [row, column]
        With and without a nipple in profile.
    depth_mm : ndarray of float64, [row, column]
        Distance to the edge of the body; the image border is no edge.
    pixel_mm : float
    """

    grey: F64
    breast: Mask
    body: Mask
    depth_mm: F64
    pixel_mm: float

    @property
    def nipple(self) -> Mask:
        """What protrudes from the rounded outline."""
        return self.breast & ~self.body

    @property
    def extent_mm(self) -> F64:
        """[row] from the chest wall to the edge of the body, mm."""
        columns = self.body.shape[1]
        last = columns - np.argmax(self.body[:, ::-1], axis=1)
        return np.where(self.body.any(axis=1), last, 0) * self.pixel_mm

    @property
    def tip_row(self) -> int:
        """Row in which the body reaches farthest."""
        return int(np.argmax(ndimage.gaussian_filter1d(self.extent_mm, 3.0 / self.pixel_mm)))


def find_region(grey: F64, pixel_mm: float) -> Region | None:
    """Bring an image to the common pitch and find the breast in it.

    Parameters
    ----------
    grey : ndarray of float64, [row, column]
        0 to 1, bright is dense.
    pixel_mm : float

    Returns
    -------
    Region or None
        None if no breast was found.
    """
    if pixel_mm < 0.98 * PIXEL_MM:
        part = pixel_mm / PIXEL_MM
        smooth = ndimage.gaussian_filter(grey, 0.5 * (1.0 / part - 1.0) + 0.15)
        grey, pixel_mm = ndimage.zoom(smooth, part, order=1), PIXEL_MM
    breast = _largest(grey, pixel_mm)
    if breast is None:
        return None
    half = breast.shape[1] // 2
    if breast[:, :half].sum() < breast[:, half:].sum():
        grey, breast = grey[:, ::-1], breast[:, ::-1]
    height = breast.sum(axis=0)
    first = int(np.argmax(height > 0.25 * height.max()))
    reach = int(AROUND_MM / pixel_mm)
    rows, columns = (np.flatnonzero(breast.any(axis=axis)) for axis in (1, 0))
    around = np.s_[max(0, rows[0] - reach) : rows[-1] + reach, first : columns[-1] + reach]
    grey, breast = np.ascontiguousarray(grey[around]), np.ascontiguousarray(breast[around])
    body = breast & ~_nipple(breast, pixel_mm)
    depth_mm = ndimage.distance_transform_edt(np.pad(body, 1, mode="edge"))[1:-1, 1:-1]
    return Region(grey, breast, body, depth_mm * pixel_mm, pixel_mm)


def block_mean_of(grey: F64, step: int) -> F64:
    """Mean of whole blocks of `step` by `step` pixels."""
    rows, columns = (n // step for n in grey.shape)
    blocks = grey[: rows * step, : columns * step].reshape(rows, step, columns, step)
    mean: F64 = blocks.mean(axis=(1, 3))
    return mean


def smooth(grey: F64, sigma: float) -> F64:
    """Gaussian smoothing; wide ones on a coarser grid, which is interpolated linearly.

    Blocks are a third of `sigma`, which leaves an error below a hundredth of what is smoothed out.
    """
    step = max(1, int(sigma / _CELLS_PER_SIGMA))
    if step == 1:
        fine: F64 = ndimage.gaussian_filter(grey, sigma)
        return fine
    padded = np.pad(grey, [(0, -n % step) for n in grey.shape], mode="edge")
    # the blocks' own width is part of the smoothing
    coarse = ndimage.gaussian_filter(
        block_mean_of(padded, step), np.sqrt(sigma**2 / step**2 - 1 / 12)
    )
    at = [
        np.clip((np.arange(n) + 0.5) / step - 0.5, 0.0, m - 1.0)
        for n, m in zip(grey.shape, coarse.shape, strict=True)
    ]
    along = [_linear(places, m) for places, m in zip(at, coarse.shape, strict=True)]
    interpolated: F64 = along[0] @ coarse @ along[1].T
    return interpolated


def _linear(places: F64, count: int) -> Any:
    """Sparse matrix of linear interpolation at fractional places between `count` values."""
    low = np.minimum(places.astype(np.intp), count - 2) if count > 1 else np.zeros(places.size, int)
    part = places - low
    rows = np.arange(places.size)
    high = np.minimum(low + 1, count - 1)
    values = np.concatenate([1.0 - part, part])
    at = (np.concatenate([rows, rows]), np.concatenate([low, high]))
    return sparse.csr_array((values, at), shape=(places.size, count))


def inner_breast(region: Region, muscle: Mask) -> Mask:
    """Where grey and texture are measured: clear of skin, chest wall and muscle."""
    inner = region.depth_mm > SKIN_CLEARANCE_MM
    if muscle.any():
        inner &= ndimage.distance_transform_edt(~muscle) * region.pixel_mm > 4.0
    inner[:, : int(WALL_CLEARANCE_MM / region.pixel_mm)] = False
    return inner


def _largest(grey: F64, pixel_mm: float) -> Mask | None:
    """The largest bright region, without holes."""
    air = float(np.quantile(grey, 0.02))
    smooth = ndimage.gaussian_filter(grey, 0.3 / pixel_mm)
    lit = smooth[smooth > air + 0.01]
    if lit.size == 0:
        return None
    # an eighth of the usual grey, but no less than one that noise does not reach
    threshold = air + max(0.035, 0.12 * (float(np.median(lit)) - air))
    bright = smooth > threshold
    rows, columns = (np.flatnonzero(bright.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return None
    # The air around is left out; a rim of it is kept.
    around = np.s_[max(0, rows[0] - 1) : rows[-1] + 2, max(0, columns[0] - 1) : columns[-1] + 2]
    opened = ndimage.binary_opening(bright[around], iterations=max(1, int(1.0 / pixel_mm)))
    labels, count = ndimage.label(opened)
    if count == 0:
        return None
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    filled = np.zeros(grey.shape, np.bool_)
    filled[around] = ndimage.binary_fill_holes(labels == largest)
    return filled


def _nipple(breast: Mask, pixel_mm: float) -> Mask:
    """The tallest part in front that protrudes from the rounded outline; empty without one."""
    step = max(1, round(_COARSE_MM / pixel_mm))
    coarse, cell_mm = breast[::step, ::step], step * pixel_mm
    radius = int(DISC_MM / cell_mm)
    padded = np.pad(coarse, radius + 1, mode="edge")
    core = ndimage.distance_transform_edt(padded) > radius
    beyond = np.maximum(ndimage.distance_transform_edt(~core) - radius, 0.0)
    beyond = beyond[radius + 1 : -radius - 1, radius + 1 : -radius - 1] * cell_mm
    labels, count = ndimage.label(coarse & (beyond > 0.0))
    front = 0.5 * np.flatnonzero(coarse.any(axis=0))[-1]
    best, best_mm = 0, MIN_NIPPLE_MM
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        rows, columns = place
        inside = rows.start > 2 and rows.stop - 1 < coarse.shape[0] - 3
        height_mm = float(beyond[place][labels[place] == number].max())
        if inside and columns.stop - 1 >= front and height_mm >= best_mm:
            best, best_mm = number, height_mm
    found = np.kron(labels == best, np.ones((step, step), bool)) if best and count else None
    nipple = np.zeros(breast.shape, bool)
    if found is not None:
        rows, columns = (min(a, b) for a, b in zip(found.shape, breast.shape, strict=True))
        nipple[:rows, :columns] = found[:rows, :columns]
    return nipple & breast
