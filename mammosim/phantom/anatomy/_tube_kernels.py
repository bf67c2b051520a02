"""Straight round pieces painted into labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, borrowing_kernel, kernel, merged_kernel, parallel_kernel, share
from mammosim.phantom.anatomy._block_kernels import Lattice
from mammosim.phantom.anatomy._fill_kernels import fill_of, fill_step
from mammosim.phantom.anatomy._noise_kernels import lattice_hash

SLAB = 16
"""Layers of voxels in which strands are painted together."""

CONE = 1.7320508
"""Base of a cone of `thread_fill` that is 1 in the middle, against the thread's radius: sqrt 3."""


@kernel
def paint_tubes(
    labels: NDArray[np.uint8], lattice: Lattice, ends_mm: NDArray[np.float64],
    radius_mm: NDArray[np.float64], label: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Paint straight round pieces: ends (n, 2, 3) and radii (n, 2) at both ends, mm.

    Besides the voxels whose centre lies in it, a piece gets those that its axis goes through, one
    a step along its longest side, so that a thin one does not break up.
    """
    step = lattice.x_mm[1] - lattice.x_mm[0]
    for n in range(ends_mm.shape[0]):
        a, b = ends_mm[n, 0], ends_mm[n, 1]
        (wx, wy, wz), squared = _axis(a, b)
        i0, i1, j0, j1, k0, k1 = _box(lattice, a, b, max(radius_mm[n, 0], radius_mm[n, 1]))
        for i in range(i0, i1):
            dx = lattice.x_mm[i] - a[0]
            for j in range(j0, j1):
                dy = lattice.lateral_mm[j] - a[1]
                for k in range(k0, k1):
                    dz = lattice.superior_mm[k] - a[2]
                    t = min(max((dx * wx + dy * wy + dz * wz) / squared, 0.0), 1.0)
                    radius = radius_mm[n, 0] + t * (radius_mm[n, 1] - radius_mm[n, 0])
                    if _squared_gap(dx, dy, dz, wx, wy, wz, t) <= radius * radius:
                        labels[i, j, k] = label[n]
        steps = int(np.ceil(np.abs(b - a).max() / step))
        for turn in range(steps + 1):
            along = turn / max(steps, 1)
            i = int(np.rint((a[0] + along * (b[0] - a[0]) - lattice.x_mm[0]) / step))
            j = int(np.rint((a[1] + along * (b[1] - a[1]) - lattice.lateral_mm[0]) / step))
            k = int(np.rint((a[2] + along * (b[2] - a[2]) - lattice.superior_mm[0]) / step))
            within = 0 <= i < labels.shape[0] and 0 <= j < labels.shape[1]
            if within and 0 <= k < labels.shape[2]:
                labels[i, j, k] = label[n]


@merged_kernel
def thread_reach(radius_mm: float, voxel_mm: float) -> float:
    """Distance from its axis up to which a round thread fills voxels."""
    return max(voxel_mm, CONE * radius_mm)


@merged_kernel
def thread_fill(gap_mm: float, radius_mm: float, voxel_mm: float) -> float:
    """Part of a voxel that a round thread fills whose axis passes at a distance.

    A cone over the distance that holds the thread's cross-section whatever the voxel: its base is
    a voxel wide, or as wide as leaves 1 in the middle.
    """
    wide = thread_reach(radius_mm, voxel_mm)
    return 3.0 * (radius_mm / wide) ** 2 * max(1.0 - gap_mm / wide, 0.0)


@parallel_kernel
def paint_threads(
    thread: Thread, labels: NDArray[np.uint8], lattice: Lattice, ends_mm: NDArray[np.float64],
    radius_mm: NDArray[np.float64], name: NDArray[np.uint8], key: int,
) -> None:  # fmt: skip
    """Paint straight round pieces of ligament by the part of each voxel that they fill.

    Ends are (n, 2, 3) and radii (n, 2) at both ends, mm; `name` as `Paint.labels`. What several
    pieces fill of a voxel adds up. A thread takes whole slabs, in each all pieces in order.
    """
    slabs = (labels.shape[0] + SLAB - 1) // SLAB
    for slab in share(thread, 0, slabs):
        first, last = slab * SLAB, min((slab + 1) * SLAB, labels.shape[0])
        voxel = lattice.x_mm[1] - lattice.x_mm[0]
        low, high = lattice.x_mm[first] - voxel, lattice.x_mm[last - 1] + voxel
        for n in range(ends_mm.shape[0]):
            reach = thread_reach(max(radius_mm[n, 0], radius_mm[n, 1]), voxel)
            if max(ends_mm[n, 0, 0], ends_mm[n, 1, 0]) + reach < low:
                continue
            if min(ends_mm[n, 0, 0], ends_mm[n, 1, 0]) - reach < high:
                _paint_thread(
                    labels, lattice, (first, last), ends_mm[n], radius_mm[n], name, key + n
                )


@borrowing_kernel
def _paint_thread(
    labels: NDArray[np.uint8], lattice: Lattice, layers: tuple[int, int],
    ends_mm: NDArray[np.float64], radius_mm: NDArray[np.float64], name: NDArray[np.uint8],
    key: int,
) -> None:  # fmt: skip
    """Paint one piece within some layers of voxels."""
    voxel = lattice.x_mm[1] - lattice.x_mm[0]
    a, b = ends_mm[0], ends_mm[1]
    (wx, wy, wz), squared = _axis(a, b)
    reach = thread_reach(max(radius_mm[0], radius_mm[1]), voxel)
    i0, i1, j0, j1, k0, k1 = _box(lattice, a, b, reach)
    first_z = lattice.superior_mm[0]
    # Along a row, the square of the distance from the axis is leading (z - nearest)^2 + least.
    leading = max(1.0 - wz * wz / squared, 1e-6)
    for i in range(max(i0, layers[0]), min(i1, layers[1])):
        dx = lattice.x_mm[i] - a[0]
        for j in range(j0, j1):
            dy = lattice.lateral_mm[j] - a[1]
            across = (dx * wx + dy * wy) / squared
            nearest = across * wz / leading
            least = dx * dx + dy * dy - across * across * squared - leading * nearest * nearest
            room = (reach * reach - least) / leading
            if room <= 0.0:
                continue
            room, middle = np.sqrt(room), (a[2] + nearest - first_z) / voxel
            low = max(k0, int(np.ceil(middle - room / voxel)))
            for k in range(low, min(k1, int(np.floor(middle + room / voxel)) + 1)):
                dz = lattice.superior_mm[k] - a[2]
                t = across + dz * wz / squared
                if t < 0.0 or t >= 1.0:
                    continue  # the next piece's
                gap = np.sqrt(max(least + leading * (dz - nearest) ** 2, 0.0))
                radius = radius_mm[0] + t * (radius_mm[1] - radius_mm[0])
                fill = thread_fill(gap, radius, voxel) + fill_of(labels[i, j, k], name)
                lot = lattice_hash(i, j, k, key) / 4294967296.0
                labels[i, j, k] = name[fill_step(min(fill, 1.0), lot)]


@borrowing_kernel
def _axis(
    start_mm: NDArray[np.float64], end_mm: NDArray[np.float64]
) -> tuple[tuple[float, float, float], float]:
    """From one end of a piece to the other, mm, and the square of its length, mm2."""
    x, y, z = end_mm[0] - start_mm[0], end_mm[1] - start_mm[1], end_mm[2] - start_mm[2]
    return (x, y, z), max(x * x + y * y + z * z, 1e-9)


@borrowing_kernel
def _box(
    lattice: Lattice, start_mm: NDArray[np.float64], end_mm: NDArray[np.float64], reach_mm: float
) -> tuple[int, int, int, int, int, int]:
    """First voxel, and first beyond, along each axis, of those within a reach of a piece."""
    i0, i1 = _span(lattice.x_mm, start_mm[0], end_mm[0], reach_mm)
    j0, j1 = _span(lattice.lateral_mm, start_mm[1], end_mm[1], reach_mm)
    k0, k1 = _span(lattice.superior_mm, start_mm[2], end_mm[2], reach_mm)
    return i0, i1, j0, j1, k0, k1


@borrowing_kernel
def _span(places_mm: NDArray[np.float64], start_mm: float, end_mm: float, reach_mm: float
) -> tuple[int, int]:  # fmt: skip
    """First of evenly spaced places, and first beyond, within a reach of what lies between two."""
    low = _first_from(places_mm, min(start_mm, end_mm) - reach_mm)
    return low, _first_from(places_mm, max(start_mm, end_mm) + reach_mm)


@borrowing_kernel
def _first_from(places_mm: NDArray[np.float64], least_mm: float) -> int:
    """Index of the first of evenly spaced places that is not below a limit; their number if none.

    As `np.searchsorted`: the spacing tells where to look.
    """
    count = places_mm.size
    found = (least_mm - places_mm[0]) / (places_mm[1] - places_mm[0])
    index = int(min(max(found, 0.0), float(count)))
    while index > 0 and places_mm[index - 1] >= least_mm:
        index -= 1
    while index < count and places_mm[index] < least_mm:
        index += 1
    return index


@merged_kernel
def _squared_gap(
    dx: float, dy: float, dz: float, wx: float, wy: float, wz: float, t: float
) -> float:
    """Square of the distance of a place d from a part t of the way w, mm2."""
    return (dx - t * wx) ** 2 + (dy - t * wy) ** 2 + (dz - t * wz) ** 2
