"""The pectoral muscle in a For Presentation image, which takes no part in its levels.

In MLO it fills a corner of the image and attenuates several times as much above fat as gland does.
A grey scale that holds both would leave the breast flat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition.discs import beyond_discs, distance_to

CORNER_MM = 5.0
"""Side of the square in a picture's corner that muscle fills where there is any."""

EDGE_LEVEL = 0.4
"""Level of the muscle's edge, of that in the corner above fat's."""

OPENING_MM = 1.5
"""Bridges between muscle and gland up to twice as wide are no muscle."""

MAX_PART = 0.38
"""Part of the breast above which it is no muscle: gland that runs into it, or fills the corner.
The muscles of eight generated breasts take 0.18 to 0.37, their edge included."""

EDGE_MM = 2.0
"""Around the muscle, where it thins."""

WIDENING_MM = 5.0
"""By how much the muscle may be wider than anywhere nearer its corner (assumed: its edge is uneven
by a few millimetres). It narrows along the chest wall, so what is wider is gland that touches
it."""

LENGTH_PER_WIDTH = 1.8
"""Length along the chest wall over width: inclination of a front that gland hides. On clinical
images they are 104 to 160 mm and 30 to 58 mm (five images); the least, for the front is convex."""


def muscle_of(
    equalised: NDArray[np.float64],
    breast: NDArray[np.bool_],
    fat: float,
    least: float,
    cell_mm: float,
) -> NDArray[np.bool_]:
    """Where muscle is, with its edge.

    Parameters
    ----------
    equalised : ndarray, [row, column]
        Attenuation (ln) as if the breast were equally thick everywhere.
    breast : ndarray of bool, [row, column]
    fat : float
        Attenuation of fat.
    least : float
        Of the corner above fat, for it to be muscle.
    cell_mm : float
        Pitch of the grid, mm.

    Returns
    -------
    ndarray of bool, [row, column]
        Empty where no corner of the picture is muscle.
    """
    size = max(1, round(CORNER_MM / cell_mm))
    ends = (slice(0, size), slice(-size, None))
    corners = [(row, column) for row in ends for column in ends if breast[row, column].all()]
    levels = [float(np.median(equalised[corner])) for corner in corners]
    if not levels or max(levels) < fat + least:
        return np.zeros(breast.shape, bool)
    corner = corners[int(np.argmax(levels))]
    smooth = ndimage.gaussian_filter(np.where(breast, equalised, 0.0), 1.0, mode="nearest")
    bright = smooth > fat + EDGE_LEVEL * (max(levels) - fat)
    parts, _ = ndimage.label(beyond_discs(bright, OPENING_MM / cell_mm) <= 0.0)
    muscle = np.isin(parts, np.setdiff1d(parts[corner], 0))
    muscle = _narrowing(muscle, corner, cell_mm)
    if muscle.sum() > MAX_PART * breast.sum():
        return np.zeros(breast.shape, bool)
    grown: NDArray[np.bool_] = distance_to(muscle) <= EDGE_MM / cell_mm
    return grown & breast


def _narrowing(
    muscle: NDArray[np.bool_], corner: tuple[slice, slice], cell_mm: float
) -> NDArray[np.bool_]:
    """What continues from the wall in each row, down to where its front runs into gland.

    From there on the front is taken to be straight, with its usual inclination.
    """
    flips = tuple(slice(None, None, -1 if at.start else 1) for at in corner)
    seen = muscle[flips]
    whole = ndimage.binary_fill_holes(np.pad(seen, ((1, 0), (1, 0)), constant_values=True))[1:, 1:]
    width = np.argmin(np.pad(whole, ((0, 0), (0, 1))), axis=1)
    # A dark strand across the muscle is not its end.
    width = ndimage.median_filter(width, 2 * round(WIDENING_MM / cell_mm / 2) + 1, mode="nearest")
    limit = np.minimum.accumulate(width) + WIDENING_MM / cell_mm
    joined = int(np.argmax(np.append(width > limit, True)))
    if joined < width.size:
        rows_on = np.arange(width.size - joined)
        limit[joined:] = float(width[:joined].min()) - rows_on / LENGTH_PER_WIDTH
    return (seen & (np.arange(seen.shape[1]) < limit[:, None]))[flips]
