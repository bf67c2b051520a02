"""Where the breast is in an image, and what protrudes from its rounded outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition.discs import beyond_discs

F64 = NDArray[np.float64]

AIR_LEVEL = 0.04
"""Attenuation (ln) that separates tissue from air: half a millimetre of skin."""

CONTOUR_SIGMA_MM = 1.5
"""Depths are smoothed by this much, because the edge of the mask is a staircase."""

OUTLINE_RADII_MM = (35.0, 20.0, 12.0)
"""What no disc of this radius reaches protrudes from the outline: a nipple in profile. Where it is
too wide for one the breast itself is pointed, and the next radius tells them apart."""

MAX_NIPPLE_MM = 25.0
"""No nipple is wider than this, root included: those of generated breasts are 7 to 18 mm wide. What
the largest disc does not reach of the pointed end of FDA's phantom is 39 to 47 mm wide."""

MIN_NIPPLE_MM = 1.0
"""A nipple protrudes by at least this much."""


@dataclass(frozen=True, eq=False)
class Margin:
    """Where the breast is, on a coarse grid.

    Parameters
    ----------
    breast : ndarray of bool, [row, column]
        With the nipple.
    body : ndarray of bool, [row, column]
        Without what protrudes from its rounded outline.
    depth_mm : ndarray of float64, [row, column]
        Distance to the edge of the body, negative outside. The image border is no edge.
    cell_mm : float
        Pitch of the grid.
    """

    breast: NDArray[np.bool_]
    body: NDArray[np.bool_]
    depth_mm: F64
    cell_mm: float


def find_margin(coarse: F64, cell_mm: float) -> Margin | None:
    """Locate the breast in a coarse image.

    Parameters
    ----------
    coarse : ndarray of float64, [row, column]
        Attenuation (ln).
    cell_mm : float
        Pitch of the grid, mm.

    Returns
    -------
    Margin or None
        None if the image holds no breast.
    """
    breast = _breast_mask(coarse)
    if not breast.any():
        return None
    body = without_nipple(breast, cell_mm)
    depth_mm = signed_depth(body, CONTOUR_SIGMA_MM / cell_mm) * cell_mm
    return Margin(breast, body, depth_mm, cell_mm)


def _breast_mask(coarse: F64) -> NDArray[np.bool_]:
    """The largest connected region that is not air, without holes."""
    smooth = ndimage.gaussian_filter(coarse, 1.0, mode="nearest")
    labels, count = ndimage.label(smooth > AIR_LEVEL)
    if count == 0:
        return np.zeros(coarse.shape, bool)
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    filled: NDArray[np.bool_] = ndimage.binary_fill_holes(labels == largest)
    return filled


def without_nipple(breast: NDArray[np.bool_], cell_mm: float) -> NDArray[np.bool_]:
    """The breast without what protrudes from its rounded outline; the image border is none.

    What ends at the border is no nipple but, at the chest wall, a bit of the abdomen.

    Parameters
    ----------
    breast : ndarray of bool, [row, column]
    cell_mm : float
        Pitch of the grid, mm.
    """
    body = breast
    for radius_mm in OUTLINE_RADII_MM:
        outside, pointed = _protruding(breast, cell_mm, radius_mm)
        body = breast & ~outside
        if not pointed:
            break
    return body


def _protruding(
    breast: NDArray[np.bool_], cell_mm: float, radius_mm: float
) -> tuple[NDArray[np.bool_], bool]:
    """What no disc reaches and may be a nipple, and whether something is too wide for one."""
    none = np.zeros(breast.shape, bool)
    wide = int(np.ceil(radius_mm / cell_mm)) + 1
    padded = np.pad(breast, wide, mode="edge")
    if padded.all():
        return none, False
    beyond = beyond_discs(padded, wide)[wide:-wide, wide:-wide]
    if np.isinf(beyond).all():  # a breast narrower than the disc
        return none, False
    labels, count = ndimage.label(breast & (beyond > 0.0))
    far = ndimage.maximum(beyond * cell_mm, labels, np.arange(1, count + 1))
    nipples = 1 + np.flatnonzero(np.asarray(far) >= MIN_NIPPLE_MM)
    ends = (labels[0], labels[-1], labels[:, 0], labels[:, -1])
    nipples = np.setdiff1d(nipples, np.concatenate(ends))
    boxes = ndimage.find_objects(labels)
    narrow = [
        label for label in nipples
        if cell_mm * np.hypot(*(side.stop - side.start for side in boxes[label - 1]))
        <= MAX_NIPPLE_MM
    ]  # fmt: skip
    found: NDArray[np.bool_] = np.isin(labels, narrow)
    return found, len(narrow) < len(nipples)


def signed_depth(region: NDArray[np.bool_], sigma_cells: float) -> F64:
    """Distance to the edge of a region in cells, negative outside."""
    if region.all():
        return np.full(region.shape, float(sum(region.shape)))
    inside = ndimage.distance_transform_edt(region)
    outside = ndimage.distance_transform_edt(~region)
    depth = np.where(region, inside - 0.5, 0.5 - outside)
    smooth: F64 = ndimage.gaussian_filter(depth, sigma_cells, mode="nearest")
    return smooth


def wall_is_left(breast: NDArray[np.bool_]) -> bool:
    """Whether the chest wall is at the first column: the image's side that more breast touches."""
    return bool(breast[:, 0].sum() >= breast[:, -1].sum())
