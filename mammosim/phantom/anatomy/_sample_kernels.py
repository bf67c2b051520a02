"""What voxels spread over a breast would be, for the threshold between gland and fat."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, borrowing_kernel, merged_kernel, parallel_kernel, share
from mammosim.phantom.anatomy._block_kernels import (
    ADIPOSE,
    MUSCLE_DEPTH,
    NET,
    SEPTUM,
    SKIN_DEPTH,
    SKIN_MM,
    SUB_STEPS,
    Block,
    Lattice,
    Paint,
    Texture,
    least_and_most,
    load_corners,
    new_block,
    sub_index,
    trilinear,
)
from mammosim.phantom.anatomy._fill_kernels import fill_of
from mammosim.phantom.anatomy._grain_kernels import gland_grain_at
from mammosim.phantom.anatomy._noise_kernels import lattice_hash
from mammosim.phantom.anatomy._parenchyma_kernels import add_potential, gather_lobules, strands
from mammosim.phantom.anatomy._surface_kernels import areola, beyond_cut

NOT_COUNTED, UNDECIDED, TUBE, VESSEL, IN_MUSCLE = 0, 1, 2, 3, 4
"""What a voxel is before the threshold between gland and fat is known."""

SAMPLES = 4
"""Voxels of a block that are looked at."""

SUB_CELL = 0.32
"""Half diagonal of a cell of the sub-grid against that of its block: a quarter, and more where
coordinates are not linear."""


@parallel_kernel
def sample_potential(
    thread: Thread, order: NDArray[np.int64], labels: NDArray[np.uint8], lattice: Lattice,
    texture: Texture, paint: Paint, out_potential: NDArray[np.float32],
    out_state: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Potential at four voxels of every block, and what is there whatever the threshold.

    Outputs are (x, lateral, superior, 4) over blocks. `order` is that of the layers of blocks. Fine
    voxels are taken from one cell of the sub-grid, so that its corners are known once; with coarse
    ones each has a cell of its own.
    """
    block, at = new_block(), np.empty(3)
    origin = block.origin
    first, size = np.empty(3, np.int64), np.empty(3, np.int64)
    places = (lattice.x_mm, lattice.lateral_mm, lattice.superior_mm)
    starts = (lattice.x_start, lattice.lateral_start, lattice.superior_start)
    h, voxel = lattice.coarse_mm, lattice.x_mm[1] - lattice.x_mm[0]
    for turn in share(thread, 0, order.size):
        i = order[turn]
        for j in range(out_state.shape[1]):
            for k in range(out_state.shape[2]):
                for axis, place in enumerate((i, j, k)):
                    origin[axis] = lattice.coarse_origin_mm[axis] + place * h
                    size[axis] = starts[axis][place + 1] - starts[axis][place]
                count = size[0] * size[1] * size[2]
                if count == 0:
                    continue
                load_corners(texture.fields, i, j, k, block.corner)
                if least_and_most(block.corner, SKIN_DEPTH)[1] < 0.0:
                    continue
                lot = lattice_hash(i, j, k, np.intp(11)) / 4294967296.0
                for s in range(SAMPLES):
                    if s == 0 or voxel > h / SUB_STEPS:
                        number = int((s + lot) * count / SAMPLES)
                        for axis, place in enumerate((i, j, k)):
                            first[axis] = starts[axis][place]
                            size[axis] = starts[axis][place + 1] - first[axis]
                            chosen, number = number % size[axis], number // size[axis]
                            at[axis] = places[axis][first[axis] + chosen] - origin[axis]
                            block.low[axis] = sub_index(at[axis] / h)
                            _keep_cell(places[axis], axis, h, block, first, size)
                        if s > 0:
                            load_corners(texture.fields, i, j, k, block.corner)
                        _sub_cell(texture, block, h, at)
                    bits = lattice_hash(i, j, k, 12 + s)
                    a = first[0] + ((bits & 1023) * size[0] >> 10)
                    b = first[1] + ((bits >> 10 & 1023) * size[1] >> 10)
                    c = first[2] + ((bits >> 20 & 1023) * size[2] >> 10)
                    at[0] = (lattice.x_mm[a] - origin[0]) / h
                    at[1] = (lattice.lateral_mm[b] - origin[1]) / h
                    at[2] = (lattice.superior_mm[c] - origin[2]) / h
                    out_state[i, j, k, s] = _state(labels[a, b, c], h, paint, block, at)
                    for axis in range(3):
                        block.centre[axis] = at[axis] * SUB_STEPS - block.low[axis]
                    value = trilinear(
                        block.corner, SEPTUM, block.centre[0], block.centre[1], block.centre[2]
                    )
                    p = trilinear(block.corner, NET, at[0], at[1], at[2])
                    q = trilinear(block.corner, NET + 1, at[0], at[1], at[2])
                    r = trilinear(block.corner, NET + 2, at[0], at[1], at[2])
                    grain = gland_grain_at(texture.grain_tile, texture.gland_scale, p, q, r)
                    # Whatever the threshold, a hole in the gland stays one.
                    hole = texture.gland_cap + grain <= 0.0
                    out_potential[i, j, k, s] = -1e9 if hole else value + grain


@borrowing_kernel
def _keep_cell(
    places_mm: NDArray[np.float64], axis: int, h: float, block: Block, first: NDArray[np.int64],
    size: NDArray[np.int64],
) -> None:  # fmt: skip
    """Of the voxels along an axis of a block, `size` from the `first` on, keep those that lie in
    the cell of its sub-grid at `low`."""
    start, end = first[axis], first[axis] + size[axis]
    size[axis] = 0
    for n in range(start, end):
        if sub_index((places_mm[n] - block.origin[axis]) / h) == block.low[axis]:
            if size[axis] == 0:
                first[axis] = n
            size[axis] += 1


@borrowing_kernel
def _sub_cell(texture: Texture, block: Block, h: float, at: NDArray[np.float64]) -> None:
    """Potential at the corners of a cell of the sub-grid, in place of SEPTUM."""
    for axis in range(3):
        at[axis] = (block.low[axis] + 0.5) / SUB_STEPS
    n = gather_lobules(texture, block, h, SUB_CELL, at)
    corners = np.intp(8)
    for corner in range(corners):
        _corner_of_sub_cell(block, corner, at)
        for axis in range(3):
            block.places.part[corner, axis] = at[axis]
            block.places.at_mm[corner, axis] = block.origin[axis] + at[axis] * h
    strands(texture, block.places, corners)
    add_potential(texture, block, n, corners)
    for corner in range(corners):
        block.corner[SEPTUM, corner] = block.places.noise[corner]


@merged_kernel
def _corner_of_sub_cell(block: Block, corner: int, at: NDArray[np.float64]) -> None:
    """Where in a block (u, v, w) a corner lies of the cell of its sub-grid at `low`."""
    at[0] = (block.low[0] + (corner >> 2)) / SUB_STEPS
    at[1] = (block.low[1] + ((corner >> 1) & 1)) / SUB_STEPS
    at[2] = (block.low[2] + (corner & 1)) / SUB_STEPS


@borrowing_kernel
def _state(label: int, h: float, paint: Paint, block: Block, at: NDArray[np.float64]) -> int:
    """What a voxel at a place of a block is whatever the threshold."""
    u, v, w = at[0], at[1], at[2]
    y, z = block.origin[1] + v * h, block.origin[2] + w * h
    depth = trilinear(block.corner, SKIN_DEPTH, u, v, w)
    thick = trilinear(block.corner, SKIN_MM, u, v, w) + areola(paint, y, z)
    if depth < thick or beyond_cut(paint, y, z):
        return NOT_COUNTED
    if trilinear(block.corner, MUSCLE_DEPTH, u, v, w) > 0.0 and depth > paint.cover_mm:
        return IN_MUSCLE
    if label == 0 or label == paint.labels[ADIPOSE] or fill_of(label, paint.labels) > 0.0:
        return UNDECIDED  # threads are no tubes: gland takes their place
    return TUBE if label == 95 or label == 125 else VESSEL
