"""Compiled search for the air voxel nearest to a point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel


@kernel
def nearest_air_mm(
    labels: NDArray[np.uint8],
    first_x: int,
    index: NDArray[np.float64],
    spacing_mm: NDArray[np.float64],
) -> float:
    """Distance from a point to the nearest voxel cube of label 0, mm.

    `index` is the point as a fractional voxel, whole numbers at voxel centres. Planes of x, in
    them rows of y, in them voxels of z are visited from the point outwards, each for as long as
    it can be nearer than the best so far. Planes before `first_x` are behind the chest wall and
    do not count; beyond the array's other faces all is air.
    """
    nx, ny, nz = labels.shape
    best = math.inf
    turn_x = 0
    while True:
        x, gap_x = _outwards(index[0], turn_x, spacing_mm[0])
        if gap_x >= best:
            return math.sqrt(best)
        turn_x += 1
        if x < first_x:
            continue
        turn_y = 0
        while True:
            y, gap_y = _outwards(index[1], turn_y, spacing_mm[1])
            if gap_x + gap_y >= best:
                break
            turn_y += 1
            turn_z = 0
            while True:
                z, gap_z = _outwards(index[2], turn_z, spacing_mm[2])
                if gap_x + gap_y + gap_z >= best:
                    break
                turn_z += 1
                beyond = x >= nx or y < 0 or y >= ny or z < 0 or z >= nz
                if beyond or labels[x, y, z] == 0:
                    best = gap_x + gap_y + gap_z


@kernel
def _outwards(at: float, turn: int, spacing_mm: float) -> tuple[int, float]:
    """The voxel visited at a turn, nearest first, and its squared distance along the axis, mm2.

    The first is the one that holds the point, then one on the side that the point leans to, then
    one on the other side, and so on: the distances never decrease.
    """
    nearest = math.floor(at + 0.5)
    step = (turn + 1) // 2
    if (turn % 2 == 1) != (at >= nearest):
        step = -step
    voxel = nearest + step
    gap = max(abs(voxel - at) - 0.5, 0.0) * spacing_mm
    return voxel, gap * gap
