"""Which way a breast looks, from its voxels alone: its chest wall is cut flat, its nipple is not.

This finds the anterior direction. Superior cannot be told from left in this way: a breast is about
as round in one direction as in the other. The remaining axes keep their order in the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.readers.axes import BREAST_AXES
from mammosim.phantom.readers.volume import every_nth

MAX_VOXELS = 2_000_000
"""Looked at: a phantom is thinned to fewer, some 100 along each axis, enough for its outline."""

SPECK_PART = 0.01
"""Of the largest section: layers with less tissue than this are specks beside the breast."""

MIN_WALL = 0.3
"""Least difference of tissue between the two ends of an axis, of its largest section, that makes a
chest wall. Chosen: twelve generated breasts and FDA's have 0.92 to 0.99 from chest wall to nipple,
and no more than 0.05 along the other axes."""

MIN_LEAD = 2.0
"""How far the chest wall's difference must exceed that of the next axis. Chosen."""

MIN_NIPPLE = 0.4
"""Least distance of the nipple from the middle of all tissue, of half its extent. Chosen."""


def find_chest_wall(values: NDArray[Any], tissue_of: Mapping[int, str]) -> tuple[int, int] | None:
    """The axis along which a breast points forward, and its sense.

    Parameters
    ----------
    values : ndarray, [i, j, k]
    tissue_of : mapping of int to str
        Tissue of each value; values that it does not name count as tissue.

    Returns
    -------
    (int, int) or None
        Number of the axis, and +1 or -1: the sense from the chest wall to the nipple. None where
        neither is to be seen.
    """
    step = max(1, round((values.size / MAX_VOXELS) ** (1 / 3)))
    coarse = every_nth(values, min(step, *values.shape)) if values.size else values
    air = [value for value, tissue in tissue_of.items() if tissue == "air"]
    tissue = ~np.isin(coarse, air)
    if not tissue.any():
        return None
    nipple = [value for value, name in tissue_of.items() if name == "nipple"]
    return _from_nipple(tissue, np.isin(coarse, nipple)) or _from_sections(tissue)


def _from_nipple(tissue: NDArray[np.bool_], nipple: NDArray[np.bool_]) -> tuple[int, int] | None:
    """Towards the nipple from the middle of the box around all tissue, in units of half the box."""
    places = np.argwhere(nipple)
    if len(places) == 0:
        return None
    offsets = []
    for axis, profile in enumerate(_profiles(tissue)):
        low, high = _ends(profile)
        offsets.append((places[:, axis].mean() - 0.5 * (low + high)) / max(0.5 * (high - low), 0.5))
    axis = int(np.argmax(np.abs(offsets)))
    return (axis, int(np.sign(offsets[axis]))) if abs(offsets[axis]) >= MIN_NIPPLE else None


def _from_sections(tissue: NDArray[np.bool_]) -> tuple[int, int] | None:
    """From the end of an axis with a large section of tissue to the end with a small one."""
    falls = []
    for profile in _profiles(tissue):
        low, high = _ends(profile)
        falls.append((profile[low] - profile[high]) / profile.max())
    order = np.argsort(np.abs(falls))
    axis, next_axis = int(order[-1]), int(order[-2])
    lead = abs(falls[axis]) >= MIN_LEAD * abs(falls[next_axis])
    if abs(falls[axis]) < MIN_WALL or not lead:
        return None
    return axis, int(np.sign(falls[axis]))


def _profiles(tissue: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Share of tissue in each layer along each axis."""
    return [tissue.mean(axis=tuple({0, 1, 2} - {axis})) for axis in range(3)]


def _ends(profile: NDArray[np.float64]) -> tuple[int, int]:
    """First and last layer of the breast, specks left out."""
    layers = np.flatnonzero(profile > SPECK_PART * profile.max())
    return int(layers[0]), int(layers[-1])


def find_axes(found: tuple[int, int] | None) -> str:
    """Letters of a file's axes whose anterior direction was found, or not.

    Parameters
    ----------
    found : (int, int) or None
        Of `find_chest_wall`.

    Returns
    -------
    str
        The other two axes are left and superior in their order in the file, or right and superior
        where the three would not be right-handed otherwise.

    Examples
    --------
    >>> find_axes((0, 1)), find_axes((2, 1)), find_axes((1, 1)), find_axes(None)
    ('ALS', 'LSA', 'RAS', 'ALS')
    """
    if found is None:
        return BREAST_AXES
    axis, sense = found
    # A, L, S are right-handed in this order; leaving the second place swaps two of them.
    handed = sense * (-1 if axis == 1 else 1)
    letters = ["L" if handed > 0 else "R", "S"]
    letters.insert(axis, "A" if sense > 0 else "P")
    return "".join(letters)
