"""The shape of a lesion from a file, and how much of each voxel it fills."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Grid = tuple[int, int, int]
"""Voxels along x, y and z."""


@dataclass(frozen=True, eq=False)
class LesionShape:
    """A shape in coordinates of its own, axes along those of the breast frame, mm.

    Parameters
    ----------
    centre_mm : ndarray, (3,)
        Centre of the box around it; it comes to lie at the lesion's position.
    radius_mm : float
        Greatest distance of a point of it from that centre, mm.
    volume_mm3 : float
    filled : callable
        Function of a placing, (3, 4), which takes points of the shape to indices of a grid with
        whole numbers at voxel centres, and of that grid. Gives the part of each voxel that the
        shape fills, float64, [x, y, z].
    """

    centre_mm: NDArray[np.float64]
    radius_mm: float
    volume_mm3: float
    filled: Callable[[NDArray[np.float64], Grid], NDArray[np.float64]]
