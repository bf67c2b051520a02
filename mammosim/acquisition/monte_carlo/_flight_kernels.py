"""Flights of photons through coarse voxels, cell by cell, and where they collide on the way.

Voxels are words: the mixture in the lower 16 bits, the density in units of 1 / 8192 above.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import borrowing_kernel, contracting_kernel, inlined_kernel
from mammosim.acquisition.monte_carlo._random_kernels import Stream

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ray = tuple[float, float, float, float, float, float]
"""x, y, z in mm and the direction's cosines."""

MIXTURE_BITS, MIXTURE_MASK = np.uint32(16), np.uint32(0xFFFF)
DENSITY_STEPS = 8192.0
EMITTED, DETECTED, ESCAPED, DEPOSITED = 0, 1, 2, 3
"""Places in the ledger of energy."""

_LARGEST_UNIFORM_DEPTH = 12.0
_SMALL_DEPTH = 0.3
"""Down to the first depth collisions are spread evenly, deeper as photons attenuate; below the
second, 1 - exp is a Taylor series. They change noise and time, and the mean by at most 1e-6."""


class Space(NamedTuple):
    """Cells between planes along each axis (gantry frame, mm), and the words of their voxels."""

    x: F64
    y: F64
    z: F64
    words: NDArray[np.uint32]


class Plan(NamedTuple):
    """How many photons are followed in each batch, from which key, and how.

    A first flight collides in so many places that each scores about `score` keV, `collisions` at
    most.
    """

    photons: int
    key: Stream
    score: float
    collisions: int
    analog: bool
    mapped: bool
    first_photon: int


class Path(NamedTuple):
    """A flight cell by cell: optical depth and length at each cell's end, and the cell's place."""

    depth: F64
    length: F64
    place: NDArray[np.int64]


@inlined_kernel
def interval(sums: F64, value: float) -> int:
    """Index of the first cumulated sum that is above a value."""
    low, high = 0, sums.size - 1
    while low < high:
        middle = (low + high) >> 1
        if sums[middle] > value:
            high = middle
        else:
            low = middle + 1
    return low


@borrowing_kernel
def cell_at_top(space: Space, ray: Ray) -> int:
    """Place of the cell below a point of the scene's top."""
    ny, nz = space.y.size - 1, space.z.size - 1
    i = interval(space.x[1:], ray[0])
    j = interval(space.y[1:], ray[1])
    return (i * ny + j) * nz + nz - 1


@contracting_kernel
def fly(
    plan: Plan,
    space: Space,
    attenuation: F32,
    deposit: F32,
    ray: Ray,
    start: int,
    weight: float,
    path: Path,
    out_collisions: F64,
    out_map: F32,
) -> tuple[int, float]:
    """Follow a ray from a cell out of the scene; the number of steps, and what comes through.

    Traversal of Amanatides and Woo 1987 (Eurographics), with planes at any distance. The weight
    that is lost in each cell is added to its mixture's collisions, and, if `plan.mapped`, times
    `deposit` [mixture] to the cell's energy.
    """
    nx, ny, nz = space.x.size - 1, space.y.size - 1, space.z.size - 1
    i, j, k = start // (ny * nz), start // nz % ny, start % nz
    x, y, z, dx, dy, dz = ray
    over_x = 1.0 / dx if dx != 0.0 else math.inf
    over_y = 1.0 / dy if dy != 0.0 else math.inf
    over_z = 1.0 / dz if dz != 0.0 else math.inf
    up_x, up_y, up_z = int(dx > 0.0), int(dy > 0.0), int(dz > 0.0)
    to_x = (space.x[i + up_x] - x) * over_x if dx != 0.0 else math.inf
    to_y = (space.y[j + up_y] - y) * over_y if dy != 0.0 else math.inf
    to_z = (space.z[k + up_z] - z) * over_z if dz != 0.0 else math.inf
    steps, depth, length, through = 0, 0.0, 0.0, 1.0
    tally = not plan.analog
    while True:
        end = max(min(to_x, to_y, to_z), length)
        place = (i * ny + j) * nz + k
        word = space.words[np.uint64(place)]
        mixture = word & MIXTURE_MASK
        crossed = attenuation[mixture] * np.float64(word >> MIXTURE_BITS) * (end - length)
        if crossed < _SMALL_DEPTH:  # Taylor: within 1e-6 of 1 - exp(-crossed)
            gone = crossed * (
                1.0
                - crossed
                / 2.0
                * (1.0 - crossed / 3.0 * (1.0 - crossed / 4.0 * (1.0 - crossed / 5.0)))
            )
        else:
            gone = -math.expm1(-crossed)
        if tally:
            lost = weight * through * gone
            out_collisions[mixture] += lost
            if plan.mapped:
                out_map[place] += lost * deposit[mixture]
        through -= through * gone
        depth += crossed
        length = end
        path.depth[steps], path.length[steps], path.place[steps] = depth, length, place
        steps += 1
        if to_x <= to_y and to_x <= to_z:
            i += 2 * up_x - 1
            if i < 0 or i >= nx:
                break
            to_x = (space.x[i + up_x] - x) * over_x
        elif to_y <= to_z:
            j += 2 * up_y - 1
            if j < 0 or j >= ny:
                break
            to_y = (space.y[j + up_y] - y) * over_y
        else:
            k += 2 * up_z - 1
            if k < 0 or k >= nz:
                break
            to_z = (space.z[k + up_z] - z) * over_z
    return steps, through


@borrowing_kernel
def draw_depth(path: Path, steps: int, down: bool, u: float, analog: bool) -> tuple[float, float]:
    """Optical depth of the next collision and the factor that this choice puts on the weight.

    In nature the density of depths t is exp(-t). Downwards, where what collides late reaches the
    detector best, they are drawn evenly, so that all scores weigh about the same; elsewhere from
    exp(-t) cut off at the scene's end. A factor of 0 says that there is no collision.
    """
    last = path.depth[steps - 1]
    if analog:
        depth = -math.log(u)
        return (depth, 1.0) if depth < last else (0.0, 0.0)
    if last <= 0.0:
        return 0.0, 0.0
    if down and last < _LARGEST_UNIFORM_DEPTH:
        depth = u * last
        return depth, last * math.exp(-depth)
    lost = -math.expm1(-last)
    return min(-math.log1p(-u * lost), last * (1.0 - 1e-12)), lost


@inlined_kernel
def depth_below(last: float, depth: float, slope: float, below: float) -> float:
    """Optical depth straight down from a collision, as far as the flights so far tell."""
    if slope < 0.0:
        return (last - depth) * -slope
    return below + depth * slope


@inlined_kernel
def moved(path: Path, step: int, depth: float, ray: Ray) -> Ray:
    """The ray begun anew at an optical depth within a step."""
    before = path.depth[step - 1] if step > 0 else 0.0
    behind = path.length[step - 1] if step > 0 else 0.0
    part = (depth - before) / (path.depth[step] - before)
    length = behind + part * (path.length[step] - behind)
    x, y, z, dx, dy, dz = ray
    return x + length * dx, y + length * dy, z + length * dz, dx, dy, dz
