"""Where a point lies in the uncompressed breast, in the words of a radiologist."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from mammosim.phantom import BreastPhantom
from mammosim.targets._nearest_air_kernels import nearest_air_mm


def clock_position(point_mm: ArrayLike, nipple_mm: ArrayLike) -> str:
    """Hour at which a point lies around the nipple, as seen facing the patient.

    Parameters
    ----------
    point_mm, nipple_mm : array_like, (3,)
        Breast frame (+y patient's left, +z superior), mm.

    Returns
    -------
    str
        To the half hour, as `10:30`.

    Notes
    -----
    (6/pi) atan2(y - y_nipple, z - z_nipple) mod 12 for both breasts: the patient's left is at
    three o'clock. A point straight behind the nipple has no hour; it gets `12:00`.

    Examples
    --------
    >>> clock_position([20.0, -10.0, 10.0], [60.0, 0.0, 0.0])
    '10:30'
    """
    _, y, z = np.asarray(point_mm, dtype=float) - np.asarray(nipple_mm, dtype=float)
    half_hours = round(12.0 / math.pi * math.atan2(y, z)) % 24
    return f"{half_hours // 2 or 12}:{30 * (half_hours % 2):02d}"


def skin_depth_mm(phantom: BreastPhantom, point_mm: ArrayLike) -> float:
    """Distance from a point to the nearest air around the breast.

    Parameters
    ----------
    phantom : BreastPhantom
    point_mm : array_like, (3,)
        Breast frame, mm.

    Returns
    -------
    float
        mm to the nearest face of a voxel of air; 0 for a point in air.

    Notes
    -----
    Air is label 0, and what lies beyond the array's faces except the one at the chest wall.
    Whatever lies behind the chest-wall plane (the first x plane with tissue in it) does not
    count, so that the depth is never taken through the chest. Air pockets inside the breast are
    not distinguished from the air around it.
    """
    chest_wall = next((x for x, plane in enumerate(phantom.labels) if plane.any()), 0)
    index = phantom.frame.index(point_mm)
    return float(nearest_air_mm(phantom.labels, chest_wall, index, phantom.voxel_mm))
