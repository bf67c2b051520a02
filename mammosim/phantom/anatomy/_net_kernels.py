"""Nets of walls: cells of a power diagram in bent coordinates, block by block.

A net is a power diagram (Aurenhammer 1987, SIAM J Comput 16:78-96) of jittered points: a Voronoi
diagram whose cells are of unequal size because each point has a weight. Within a block only the
few cells that come near it matter, so that they are gathered once a block. What walls between them
fill is in `_wall_kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import borrowing_kernel, kernel, merged_kernel

MAX_NEAR = 96
"""Most cells kept for one block; the nearest ones are met first often enough that the rest would
lie beyond its reach."""

X, Y, Z, WEIGHT, FATNESS, TAG = 0, 1, 2, 3, 4, 5
"""Columns of `Net.seeds`: place in the lattice cell, weight (in cells squared; below `ABSENT` there
is no cell), how strongly a fat lobule pushes gland aside, and a number by which walls differ."""

ABSENT = -5.0
"""Far below all weights that cells have."""

LOOKED_AT = 125
"""Cells of the lattice around one: two to each side."""

ABSENT_WALLS, THIN_WALL, GROUP_WALL, MAX_WALL = 0.35, 0.2, 0.6, 2.5
"""Share of walls within a group that are missing, so that lobules run together; the least thickness
of a wall against the mean, the most within a group and least between groups, and the most of all.
Chosen by eye."""

GOLDEN = 0.6180339887498949
"""Multiples of the golden ratio, less their whole parts, are spread evenly."""


class Net(NamedTuple):
    """Points of a net, one a lattice cell: `seeds` is (nx, ny, nz, 6), lengths in lattice cells."""

    seeds: NDArray[np.float32]
    origin_mm: NDArray[np.float64]
    cell_mm: float


class Near(NamedTuple):
    """Cells of a net near a block: place and constant of each, fatness, tag, and pairs of them.

    `place` is (n, 4): x, y, z and |x|^2 - weight, so that q = place[3] - 2 x . place is smallest
    for the cell that holds x. The first `holding` cells are those that hold a place of the block.
    `pair` is (n, n, 2), known for these and all others: by what a difference of q must be
    multiplied to be a distance from their wall in mm, and the wall's thickness against the mean.
    `scale` is the least of these factors of each, which bounds its distance from all walls;
    `closest` that of any cell's walls with holders. `block` and `row` are lists of the cells whose
    walls come near a block, all that were gathered at first, and near a row of it; `q` is room for
    their q at its ends. The rest is
    room for the cells that are looked at, by their place from the middle of the block, q
    there, weight, fatness and tag; which of them hold a place; and which are kept.
    """

    place: NDArray[np.float64]
    fatness: NDArray[np.float64]
    tag: NDArray[np.float64]
    pair: NDArray[np.float64]
    scale: NDArray[np.float64]
    closest: NDArray[np.float64]
    block: NDArray[np.int64]
    row: NDArray[np.int64]
    q: NDArray[np.float64]
    holding: NDArray[np.int64]
    around: NDArray[np.float64]
    holder: NDArray[np.int64]
    kept: NDArray[np.bool_]


@kernel
def new_near() -> Near:
    """Room for the cells near a block."""
    return Near(
        np.empty((MAX_NEAR, 4)), np.empty(MAX_NEAR), np.empty(MAX_NEAR),
        np.empty((MAX_NEAR, MAX_NEAR, 2)), np.empty(MAX_NEAR), np.empty(MAX_NEAR),
        np.empty(MAX_NEAR, np.int64), np.empty(MAX_NEAR, np.int64), np.empty((8, MAX_NEAR)),
        np.zeros(1, np.int64), np.empty((LOOKED_AT, 7)), np.empty(LOOKED_AT, np.int64),
        np.empty(LOOKED_AT, np.bool_),
    )  # fmt: skip


@borrowing_kernel
def gather(
    net: Net, centre_mm: NDArray[np.float64], radius_mm: float, reach_mm: float,
    slope: NDArray[np.float64], near: Near,
) -> int:  # fmt: skip
    """Cells whose walls come within a reach of any place within a radius of a centre.

    All in net coordinates, mm. A cell holds such a place only if its wall with the centre's cell
    comes within the radius; another cell comes within the reach of its walls there only if the
    wall between the two lies within radius and reach of the centre. `slope` is (3, 3): how net
    coordinates change with the real ones. Returns how many there are; the first `near.holding` hold
    such places, the very first the centre.
    """
    c = net.cell_mm
    x = (centre_mm[0] - net.origin_mm[0]) / c
    y = (centre_mm[1] - net.origin_mm[1]) / c
    z = (centre_mm[2] - net.origin_mm[2]) / c
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    seeds, around, kept, holder = net.seeds, near.around, near.kept, near.holder
    best, first, count = np.inf, np.intp(0), np.intp(0)
    for a in range(max(i - 2, 0), min(i + 3, seeds.shape[0])):
        for b in range(max(j - 2, 0), min(j + 3, seeds.shape[1])):
            for d in range(max(k - 2, 0), min(k + 3, seeds.shape[2])):
                weight = seeds[a, b, d, WEIGHT]
                if weight < ABSENT:
                    continue
                px, py = a + seeds[a, b, d, X] - x, b + seeds[a, b, d, Y] - y
                pz = d + seeds[a, b, d, Z] - z
                q = px * px + py * py + pz * pz - weight
                around[count, 0], around[count, 1], around[count, 2] = px, py, pz
                around[count, 3], around[count, 4] = q, weight
                for part in (FATNESS, TAG):
                    around[count, part + 1] = seeds[a, b, d, part]
                if q < best:
                    best, first = q, count
                count += 1
    if count == 0:
        return 0
    # Rounding must not lose a cell whose wall a corner of the block lies on.
    radius, far = 1.000001 * radius_mm / c, (radius_mm + reach_mm) / c
    holders = _holders(around, holder, kept, count, first, radius)
    n, chosen = np.intp(holders), near.block
    for h in range(holders):
        chosen[h] = holder[h]
    for m in range(count):
        if n < MAX_NEAR and not kept[m] and _comes_near(around, holder, holders, m, far):
            chosen[n] = m
            n += 1
    _keep(near, n, x, y, z)
    near.holding[0] = holders
    _pairs(near, holders, n, c, slope)
    return int(n)


@borrowing_kernel
def _keep(near: Near, n: int, x: float, y: float, z: float) -> None:
    """Make the first n cells of `around` that `block` lists those that are near, and list these."""
    around, place, chosen = near.around, near.place, near.block
    fatness, tag = near.fatness, near.tag
    for c in range(n):
        m = chosen[c]
        place[c, 0], place[c, 1], place[c, 2] = x + around[m, 0], y + around[m, 1], z + around[m, 2]
        squared = place[c, 0] ** 2 + place[c, 1] ** 2 + place[c, 2] ** 2
        place[c, 3] = squared - around[m, 4]
        fatness[c], tag[c] = around[m, 5], around[m, 6]
        chosen[c] = c


@borrowing_kernel
def _holders(
    around: NDArray[np.float64], holder: NDArray[np.int64], kept: NDArray[np.bool_], count: int,
    first: int, radius: float,
) -> int:  # fmt: skip
    """Cells around that may hold a place within a radius, lattice cells; how many, the holder of
    the middle first."""
    holder[0], n = first, np.intp(1)
    for m in range(count):
        further = around[m, 3] - around[first, 3]
        kept[m] = m == first
        if m != first and n < MAX_NEAR and further <= 2.0 * radius * _apart(around, m, first):
            holder[n], kept[m] = m, True
            n += 1
    return int(n)


@merged_kernel
def _apart(around: NDArray[np.float64], m: int, n: int) -> float:
    x, y = around[m, 0] - around[n, 0], around[m, 1] - around[n, 1]
    z = around[m, 2] - around[n, 2]
    return np.sqrt(x * x + y * y + z * z)


@merged_kernel
def _comes_near(
    around: NDArray[np.float64], holder: NDArray[np.int64], holders: int, m: int, far: float
) -> bool:
    """Whether a cell's wall with one of the holders comes as near as `far`, in lattice cells."""
    comes = False
    for h in range(holders):
        further = around[m, 3] - around[holder[h], 3]
        comes = comes or further <= 2.0 * far * _apart(around, m, holder[h])
    return comes


@borrowing_kernel
def _pairs(near: Near, holders: int, n: int, cell_mm: float, slope: NDArray[np.float64]) -> None:
    """Scale of distance and thickness of the wall between each holder and the gathered cells."""
    place, tag, pair, scale, closest = near.place, near.tag, near.pair, near.scale, near.closest
    for b in range(n):
        closest[b] = np.inf
    for a in range(holders):
        scale[a] = np.inf
        for b in range(n):
            if a == b:
                continue
            dx, dy = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
            dz = place[b, 2] - place[a, 2]
            gx = slope[0, 0] * dx + slope[1, 0] * dy + slope[2, 0] * dz
            gy = slope[0, 1] * dx + slope[1, 1] * dy + slope[2, 1] * dz
            gz = slope[0, 2] * dx + slope[1, 2] * dy + slope[2, 2] * dz
            # The difference of q changes by twice this a real mm, once in cells.
            steep = np.sqrt(gx * gx + gy * gy + gz * gz)
            pair[a, b, 0] = 0.5 * cell_mm / max(steep, 1e-9)
            scale[a] = min(scale[a], pair[a, b, 0])
            closest[b] = min(closest[b], pair[a, b, 0])
            pair[a, b, 1] = _wall_strength(tag[a], tag[b])


@kernel
def wall_strengths(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Thickness of walls against the mean from the tags of the cells on both sides."""
    strength = np.empty(one.size)
    for n in range(one.size):
        strength[n] = _wall_strength(one[n], other[n])
    return strength


@merged_kernel
def _wall_strength(one: float, other: float) -> float:
    """Thickness of a wall against the mean from the tags of the cells on both sides.

    The whole part of a tag is the cell's group. Within a group walls are thin and some are missing;
    those between two groups are all there and of one thickness, a ligament. Where tags are
    negative there are no groups, and thickness has a long tail.
    """
    odd = one + other
    odd -= np.floor(odd)
    first, second = np.floor(one), np.floor(other)
    if first != second:
        between = GOLDEN * (first + second)
        between -= np.floor(between)
        return GROUP_WALL + (MAX_WALL - GROUP_WALL) * between * between * between
    if odd < ABSENT_WALLS:
        return 0.0
    part = (odd - ABSENT_WALLS) / (1.0 - ABSENT_WALLS)
    if first < 0.0:
        return THIN_WALL + (MAX_WALL - THIN_WALL) * part * part * part
    return THIN_WALL + (GROUP_WALL - THIN_WALL) * part * part


@borrowing_kernel
def walls_between(
    place: NDArray[np.float64], closest: NDArray[np.float64], cells: NDArray[np.int64],
    count: int, ends: NDArray[np.float64], limit_mm: float, q: NDArray[np.float64],
    out_cells: NDArray[np.int64],
) -> int:  # fmt: skip
    """Those of some cells whose walls come within a limit anywhere between ends; how many.

    `ends` is (n, 3), net coordinates in lattice cells: both ends of a row, or the corners of a
    block. Between them coordinates are linear in each direction, and so is the difference of q of
    two cells: it is nowhere less than at one of the ends. `place`, `closest` and `q` are those of
    `Near`.
    """
    for e in range(ends.shape[0]):
        x, y, z = ends[e, 0], ends[e, 1], ends[e, 2]
        for m in range(count):
            a = cells[m]
            q[e, m] = place[a, 3] - 2.0 * (place[a, 0] * x + place[a, 1] * y + place[a, 2] * z)
    kept = np.intp(0)
    for m in range(count):
        out_cells[m] = 1
    for e in range(ends.shape[0]):
        nearest, least = 0, np.inf
        for m in range(count):
            if q[e, m] < least:
                nearest, least = m, q[e, m]
        for m in range(count):
            if out_cells[m] == 1:
                gap = np.inf
                for other in range(ends.shape[0]):
                    gap = min(gap, q[other, m] - q[other, nearest])
                # Rounding must not lose a wall.
                if gap * closest[cells[m]] > 1.000001 * limit_mm:
                    out_cells[m] = 0
    for m in range(count):
        if out_cells[m] == 1:
            out_cells[kept] = cells[m]
            kept += 1
    return int(kept)


@merged_kernel
def three_nearest(
    place: NDArray[np.float64], cells: NDArray[np.int64], n: int, x: float, y: float, z: float
) -> tuple[int, float, float, float]:
    """Which of some cells holds a point of the lattice, its q (see `Near`) and the next two."""
    inside, least, second, third = 0, np.inf, np.inf, np.inf
    for m in range(n):
        a = cells[m]
        q = place[a, 3] - 2.0 * (place[a, 0] * x + place[a, 1] * y + place[a, 2] * z)
        if q < least:
            inside, least, second, third = a, q, least, second
        elif q < second:
            second, third = q, second
        elif q < third:
            third = q
    return inside, least, second, third
