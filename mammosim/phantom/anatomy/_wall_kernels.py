"""Walls of a net at a place: how far the nearest is, and what part of a voxel they fill."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import merged_kernel
from mammosim.phantom.anatomy._net_kernels import MAX_WALL

ROUNDING_REACH = 1.1
"""Distance from walls beyond which they round no corner, against the rounding."""

MOST_BORDER, BORDER_PART, BORDER_SLOPE = 1.8, 0.65, 2.5
"""Most that a fillet is larger than the mean one, chosen by eye; the part of its size to which it
reaches along a wall, where it is a twenty-fifth of its size thick; and how steeply the sum that
decides on it rises across its face."""


@merged_kernel
def wall_distance(
    place: NDArray[np.float64], pair: NDArray[np.float64], cells: NDArray[np.int64], holding: int,
    n: int, x: float, y: float, z: float, rounding_mm: float,
) -> tuple[float, int]:  # fmt: skip
    """Distance to the nearest wall of a net, mm, and which of the cells holds a point.

    The first n of `cells` count; those below `holding` hold places. x, y, z are net coordinates in
    lattice cells. Near an edge the distance is less, so that where it has one value the cell's
    corners are round: a polynomial smooth minimum of two, of which no distance above
    `ROUNDING_REACH` roundings counts, so that cells farther away need not be known.
    """
    inside, least = 0, np.inf
    for m in range(n):
        a = cells[m]
        if a >= holding:
            break
        q = place[a, 3] - 2.0 * (place[a, 0] * x + place[a, 1] * y + place[a, 2] * z)
        if q < least:
            inside, least = a, q
    far = ROUNDING_REACH * rounding_mm
    gap, second = far, far
    for m in range(n):
        b = cells[m]
        if b != inside:
            q = place[b, 3] - 2.0 * (place[b, 0] * x + place[b, 1] * y + place[b, 2] * z)
            other = (q - least) * pair[inside, b, 0]
            if other < gap:
                gap, second = other, gap
            elif other < second:
                second = other
    if second - gap < rounding_mm:
        gap -= 0.25 * rounding_mm * (1.0 - (second - gap) / rounding_mm) ** 2
    return gap, inside


@merged_kernel
def wall_reach(thick_mm: float, voxel_mm: float) -> float:
    """Distance from the walls of a net up to which it may fill voxels, mm."""
    return 0.5 * (MAX_WALL * thick_mm + voxel_mm)


@merged_kernel
def border_reach(border_mm: float, voxel_mm: float) -> float:
    """Distance from two walls up to which the fillet between them may fill voxels, mm."""
    return BORDER_PART * MOST_BORDER * border_mm + voxel_mm


@merged_kernel
def fillet_span(border_mm: float, voxel_mm: float) -> float:
    """Square of the sum of the roots of the distances from two walls, mm, up to which the fillet
    between them may fill voxels (see `wall_fill`)."""
    return 1.000001 * (MOST_BORDER * border_mm + 0.5 * BORDER_SLOPE * voxel_mm)


@merged_kernel
def free_of_fillets(one_mm: float, other_mm: float, far_mm: float, span_mm: float) -> float:
    """How far a place may come nearer to both of its nearest walls before a fillet fills it, mm.

    `far_mm` is the `border_reach`, `span_mm` the `fillet_span`. Negative where one may do so.
    """
    most = max(span_mm - (other_mm - one_mm), 0.0)
    return max(other_mm - far_mm, one_mm - 0.25 * most * most / span_mm)


@merged_kernel
def wall_fill(
    place: NDArray[np.float64], pair: NDArray[np.float64], cells: NDArray[np.int64], n: int,
    inside: int, least: float, at: tuple[float, float, float], thick_mm: float, voxel_mm: float,
    border_mm: float,
) -> float:  # fmt: skip
    """Part of a voxel that walls of a mean thickness fill: the overlap of slab and voxel.

    The first n of `cells` count. `inside` is the one that holds the place `at`, and `least` its q.
    Where two walls meet they are joined by fillets, as films of a foam are by Plateau borders: a
    place at distances a and b from them is filled if sqrt a + sqrt b is less than the root of
    `border_mm` times the product of both thicknesses against the mean, and neither is above
    `BORDER_PART` of that length.
    """
    x, y, z = at
    fill, wide = 0.0, 0.5 * voxel_mm
    one, other, strong, weak = np.inf, np.inf, 0.0, 0.0
    for m in range(n):
        b = cells[m]
        strength = pair[inside, b, 1]
        if b != inside and strength > 0.0:
            half = 0.5 * thick_mm * strength
            q = place[b, 3] - 2.0 * (place[b, 0] * x + place[b, 1] * y + place[b, 2] * z)
            gap = (q - least) * pair[inside, b, 0]
            if gap < half + wide:
                fill = max(fill, (min(gap + wide, half) - max(gap - wide, -half)) / voxel_mm)
            if gap < one:
                one, other, strong, weak = gap, one, strength, strong
            elif gap < other:
                other, weak = gap, strength
    size = border_mm * min(strong * weak, MOST_BORDER)
    if other < BORDER_PART * size + voxel_mm:
        way = one + other + 2.0 * np.sqrt(one * other) - size
        fill = max(fill, min(0.5 - way / (BORDER_SLOPE * voxel_mm), 1.0))
    return fill
