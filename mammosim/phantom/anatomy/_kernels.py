"""Kernels of the generator: the tissue of each voxel from coarse fields and fine structure.

A block is a cell of the coarse grid. What a block's corners decide is not asked of its voxels: air
is skipped, fat without walls is filled, and noise is evaluated on a sub-grid of `SUB_STEPS` only
where it decides between gland and fat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, merged_kernel, parallel_kernel, share
from mammosim.phantom.anatomy._net_kernels import (
    Near,
    Net,
    gather,
    new_near,
    wall_distance,
    wall_fill,
)
from mammosim.phantom.anatomy._noise_kernels import gradient_noise, lattice_hash

SKIN_DEPTH, MUSCLE_DEPTH, POTENTIAL, SEPTUM, SKIN_MM, NET, FIBRE = (
    np.intp(n) for n in (0, 1, 2, 3, 4, 5, 8)
)
"""Channels of the coarse fields; NET and FIBRE take three each."""

CHANNELS = 11

SUB_STEPS = 4
"""Steps of a block's sub-grid: 0.5 mm, against a finest noise of 1.6 mm."""

NOT_COUNTED, UNDECIDED, TUBE, SEPTUM_STATE = 0, 1, 2, 3

MUSCLE_FAT = 0.22
"""Mean thickness of the fat between bundles of muscle, mm. Chosen."""


class Lattice(NamedTuple):
    """Where voxels and coarse grid lie, in generator coordinates (x, lateral, superior), mm.

    `x_start` and so on give the first voxel of each block, and the number of voxels last.
    """

    x_mm: NDArray[np.float64]
    lateral_mm: NDArray[np.float64]
    superior_mm: NDArray[np.float64]
    coarse_origin_mm: NDArray[np.float64]
    coarse_mm: float
    x_start: NDArray[np.int64]
    lateral_start: NDArray[np.int64]
    superior_start: NDArray[np.int64]


class Texture(NamedTuple):
    """Everything that decides the fine structure.

    `fields` is (x, lateral, superior, channel); `coarse` and `fine` are the nets of primary and
    secondary septa, `bundles` that of the muscle's; amplitudes are in units of the potential.
    """

    fields: NDArray[np.float32]
    coarse: Net
    fine: Net
    bundles: Net
    fine_septum: float
    apex_mm: NDArray[np.float64]
    fan_amplitude: NDArray[np.float64]
    fan_per_radian: NDArray[np.float64]
    grain_amplitude: NDArray[np.float64]
    grain_mm: NDArray[np.float64]
    noise_limit: float
    lobule_mm: float
    lobule_amplitude: float
    key: int


class Paint(NamedTuple):
    """Labels and lengths that the last step needs.

    `nipple` is described at `in_nipple`; `areola_mm` is extra thickness of the skin at the
    nipple and the radius over which it is lost; `cut` is the direction out of the open end and its
    distance from the nipple's axis.
    """

    nipple: NDArray[np.float64]
    areola_mm: NDArray[np.float64]
    cut: NDArray[np.float64]
    cover_mm: float
    threshold: float
    labels: NDArray[np.uint8]


ADIPOSE, SKIN, GLAND, NIPPLE, MUSCLE, LIGAMENT, EIGHTH, QUARTER, HALF = range(9)
"""Places in `Paint.labels`."""


class Block(NamedTuple):
    """Scratch of one block: corners of each channel, its sub-grid, slope of the net's coordinates,
    walls near it, a row's ends of each channel, and the planes of the sub-grid that are wanted."""

    corner: NDArray[np.float64]
    sub: NDArray[np.float64]
    sub_row: NDArray[np.float64]
    slope: NDArray[np.float64]
    centre: NDArray[np.float64]
    low: NDArray[np.float64]
    step: NDArray[np.float64]
    coarse: Near
    fine: Near
    wanted: NDArray[np.bool_]


@kernel
def _new_block() -> Block:
    n = SUB_STEPS + 1
    return Block(
        np.empty((CHANNELS, 8)), np.empty((n, n, n)), np.empty(n), np.empty((3, 3)), np.empty(3),
        np.empty(CHANNELS), np.empty(CHANNELS), new_near(), new_near(),
        np.zeros((3, n), np.bool_),
    )  # fmt: skip


@kernel
def _load(fields: NDArray[np.float32], i: int, j: int, k: int, corner: NDArray[np.float64]) -> None:
    """All channels at the eight corners of a block, the last axis fastest."""
    for a in range(2):
        for b in range(2):
            for c in range(2):
                for channel in range(CHANNELS):
                    corner[channel, 4 * a + 2 * b + c] = fields[i + a, j + b, k + c, channel]


@merged_kernel
def trilinear(corner: NDArray[np.float64], channel: int, u: float, v: float, w: float) -> float:
    """Value of a channel within a block from its corners."""
    low = (1.0 - v) * ((1.0 - w) * corner[channel, 0] + w * corner[channel, 1]) + v * (
        (1.0 - w) * corner[channel, 2] + w * corner[channel, 3]
    )
    high = (1.0 - v) * ((1.0 - w) * corner[channel, 4] + w * corner[channel, 5]) + v * (
        (1.0 - w) * corner[channel, 6] + w * corner[channel, 7]
    )
    return (1.0 - u) * low + u * high


@kernel
def dither(i: int, j: int, k: int, corners: NDArray[np.float64]) -> float:
    """Shift of a surface at a voxel, in voxels along its normal, that hides the staircase.

    The surface's normal is the gradient over the coarse cell's corners. Along the axis nearest to
    it all voxels of a column are shifted alike, so that layers keep their thickness and stay
    whole; from column to column the shift follows a sequence of low discrepancy (the golden ratio
    in two dimensions), so that the mean of any few columns is the surface's true place. Half a
    voxel along that axis is the most.
    """
    gx = (
        corners[SKIN_DEPTH, 4]
        + corners[SKIN_DEPTH, 5]
        + corners[SKIN_DEPTH, 6]
        + corners[SKIN_DEPTH, 7]
    )
    gx -= (
        corners[SKIN_DEPTH, 0]
        + corners[SKIN_DEPTH, 1]
        + corners[SKIN_DEPTH, 2]
        + corners[SKIN_DEPTH, 3]
    )
    gy = (
        corners[SKIN_DEPTH, 2]
        + corners[SKIN_DEPTH, 3]
        + corners[SKIN_DEPTH, 6]
        + corners[SKIN_DEPTH, 7]
    )
    gy -= (
        corners[SKIN_DEPTH, 0]
        + corners[SKIN_DEPTH, 1]
        + corners[SKIN_DEPTH, 4]
        + corners[SKIN_DEPTH, 5]
    )
    gz = (
        corners[SKIN_DEPTH, 1]
        + corners[SKIN_DEPTH, 3]
        + corners[SKIN_DEPTH, 5]
        + corners[SKIN_DEPTH, 7]
    )
    gz -= (
        corners[SKIN_DEPTH, 0]
        + corners[SKIN_DEPTH, 2]
        + corners[SKIN_DEPTH, 4]
        + corners[SKIN_DEPTH, 6]
    )
    ax, ay, az = abs(gx), abs(gy), abs(gz)
    if ax >= ay and ax >= az:
        most, first, second, sign = ax, j, k, gx
    elif ay >= az:
        most, first, second, sign = ay, i, k, gy
    else:
        most, first, second, sign = az, i, j, gz
    turn = 0.7548776662466927 * first + 0.5698402909980532 * second
    shift = (turn - np.floor(turn) - 0.5) * most / np.sqrt(gx * gx + gy * gy + gz * gz + 1e-12)
    return shift if sign > 0.0 else -shift


@merged_kernel
def strands(texture: Texture, x: float, y: float, z: float) -> float:
    """Strands towards the nipple and isotropic grain, within the noise's limit."""
    total = 0.0
    dx, dy, dz = texture.apex_mm[0] - x, y - texture.apex_mm[1], z - texture.apex_mm[2]
    r = np.sqrt(dx * dx + dy * dy + dz * dz) + 1.0
    along = np.log(r) / 5.0
    for octave in range(texture.fan_amplitude.size):
        # Strands run towards the nipple: noise in direction and, five times slower, distance.
        per = texture.fan_per_radian[octave]
        total += texture.fan_amplitude[octave] * gradient_noise(
            along * per, dy / r * per, dz / r * per, texture.key + octave
        )
    for octave in range(texture.grain_amplitude.size):
        s = 1.0 / texture.grain_mm[octave]
        total += texture.grain_amplitude[octave] * gradient_noise(
            x * s, y * s, z * s, texture.key + 64 + octave
        )
    return min(max(total, -texture.noise_limit), texture.noise_limit)


@kernel
def _net_frame(block: Block, channel: int, coarse_mm: float) -> float:
    """Slope and centre of net coordinates over a block; the radius of the block in them, mm."""
    for axis in range(3):
        c = block.corner[channel + axis]
        block.centre[axis] = c.sum() / 8.0
        block.slope[axis, 0] = (c[4] + c[5] + c[6] + c[7] - c[0] - c[1] - c[2] - c[3]) / 4.0
        block.slope[axis, 1] = (c[2] + c[3] + c[6] + c[7] - c[0] - c[1] - c[4] - c[5]) / 4.0
        block.slope[axis, 2] = (c[1] + c[3] + c[5] + c[7] - c[0] - c[2] - c[4] - c[6]) / 4.0
        for direction in range(3):
            block.slope[axis, direction] /= coarse_mm
    radius = 0.0
    for n in range(8):
        squared = 0.0
        for axis in range(3):
            squared += (block.corner[channel + axis, n] - block.centre[axis]) ** 2
        radius = max(radius, squared)
    return np.sqrt(radius)


@kernel
def _stretch(slope: NDArray[np.float64]) -> float:
    """A bound of the largest change of net coordinates a real mm (Gershgorin, of slope^T slope)."""
    most = 0.0
    for a in range(3):
        row = 0.0
        for b in range(3):
            row += abs(
                slope[0, a] * slope[0, b] + slope[1, a] * slope[1, b] + slope[2, a] * slope[2, b]
            )
        most = max(most, row)
    return np.sqrt(most)


@merged_kernel
def _potential_at(
    texture: Texture, block: Block, n: int, at: NDArray[np.float64], origin: NDArray[np.float64],
    coarse_mm: float,
) -> float:  # fmt: skip
    """Full potential at a place (u, v, w) of a block whose walls have been gathered."""
    u, v, w = at[0], at[1], at[2]
    net = texture.coarse
    total = trilinear(block.corner, POTENTIAL, u, v, w)
    total += strands(
        texture, origin[0] + u * coarse_mm, origin[1] + v * coarse_mm, origin[2] + w * coarse_mm
    )
    if n > 0:
        gap, inside = wall_distance(
            block.coarse.place, block.coarse.pair, n,
            (trilinear(block.corner, NET, u, v, w) - net.origin_mm[0]) / net.cell_mm,
            (trilinear(block.corner, NET + 1, u, v, w) - net.origin_mm[1]) / net.cell_mm,
            (trilinear(block.corner, NET + 2, u, v, w) - net.origin_mm[2]) / net.cell_mm,
        )  # fmt: skip
        fatness = block.coarse.fatness[inside]
        part = min(gap / texture.lobule_mm, 1.0)
        total -= texture.lobule_amplitude * fatness * part * (2.0 - part)
    return total


@kernel
def _gather_lobules(texture: Texture, block: Block, coarse_mm: float) -> int:
    radius = _net_frame(block, NET, coarse_mm)
    reach = texture.lobule_mm * _stretch(block.slope)
    return gather(texture.coarse, block.centre, radius, reach, block.slope, block.coarse)


@merged_kernel
def _beyond_cut(paint: Paint, y: float, z: float) -> bool:
    return y * paint.cut[0] + z * paint.cut[1] > paint.cut[2]


@kernel
def in_nipple(
    x: float, y: float, z: float, depth: float, thick: float, nipple: NDArray[np.float64]
) -> bool:
    """Whether a point lies in the nipple: an irregular, blunt and tilted cone on the areola.

    `nipple` is foot x, height, radius at the foot, part of the radius lost at the tip, tilt
    (lateral and superior, mm a mm of height), exponent of the dome, amplitude of lumps (mm) and
    their place in the noise. It goes as deep as the skin.
    """
    s, height = x - nipple[0], max(nipple[1], 0.2)
    rise = min(max(s, 0.0), height)
    across = y - nipple[4] * rise
    up = z - nipple[5] * rise
    lumps = nipple[7] * gradient_noise(x / 4.0, y / 4.0, z / 4.0 + nipple[8], 17)
    wide = nipple[2] * (1.0 - nipple[3] * rise / height) + lumps
    if depth > 0.0:
        return depth < thick and across * across + up * up < wide * wide
    if s > height or s < -4.0:
        return False
    wide = wide * (1.0 - (rise / height) ** nipple[6]) + 1.2 * np.exp(-max(s, 0.0))
    return wide > 0.0 and across * across + up * up < wide * wide


@merged_kernel
def _areola(paint: Paint, y: float, z: float) -> float:
    """Extra thickness of the skin at the areola, mm."""
    near = (y * y + z * z) / (paint.areola_mm[1] * paint.areola_mm[1])
    return paint.areola_mm[0] * np.exp(-near * near)


@parallel_kernel
def sample_potential(
    thread: Thread, order: NDArray[np.int64], labels: NDArray[np.uint8], lattice: Lattice,
    texture: Texture, paint: Paint, out_potential: NDArray[np.float32],
    out_state: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Potential at four places of every block, and what is there whatever the threshold.

    Outputs are (x, lateral, superior, 4) over blocks. `order` is that of the layers of blocks.
    """
    h, origin = lattice.coarse_mm, np.empty(3)
    block, at = _new_block(), np.empty(3)
    for turn in share(thread, 0, order.size):
        i = order[turn]
        for j in range(out_state.shape[1]):
            for k in range(out_state.shape[2]):
                _load(texture.fields, i, j, k, block.corner)
                deepest = block.corner[SKIN_DEPTH].max()
                if deepest < 0.0:
                    continue
                n = _gather_lobules(texture, block, h)
                for axis, place in enumerate((i, j, k)):
                    origin[axis] = lattice.coarse_origin_mm[axis] + place * h
                _sub_cell(texture, block, n, lattice_hash(i, j, k, 11), origin, h, at)
                for s in range(4):
                    bits = lattice_hash(i, j, k, 12 + s)
                    for axis in range(3):
                        part = ((bits >> (10 * axis)) & 1023) / 1024.0
                        block.centre[axis] = part
                        at[axis] = (block.low[axis] + part) / SUB_STEPS
                    out_state[i, j, k, s] = _state(labels, lattice, paint, block, at, origin)
                    out_potential[i, j, k, s] = trilinear(
                        block.corner, SEPTUM, block.centre[0], block.centre[1], block.centre[2]
                    )


@kernel
def _sub_cell(
    texture: Texture, block: Block, n: int, bits: int, origin: NDArray[np.float64], h: float,
    at: NDArray[np.float64],
) -> None:  # fmt: skip
    """Potential at the corners of a cell of the sub-grid, in place of SEPTUM; its place, `low`."""
    for axis in range(3):
        block.low[axis] = ((bits >> (10 * axis)) & 1023) * SUB_STEPS // 1024
    for corner in range(8):
        at[0] = (block.low[0] + (corner >> 2)) / SUB_STEPS
        at[1] = (block.low[1] + ((corner >> 1) & 1)) / SUB_STEPS
        at[2] = (block.low[2] + (corner & 1)) / SUB_STEPS
        block.corner[SEPTUM, corner] = _potential_at(texture, block, n, at, origin, h)


@kernel
def _state(
    labels: NDArray[np.uint8], lattice: Lattice, paint: Paint, block: Block,
    at: NDArray[np.float64], origin: NDArray[np.float64],
) -> int:  # fmt: skip
    """What is at a place of a block whatever the threshold."""
    u, v, w = at[0], at[1], at[2]
    h, voxel = lattice.coarse_mm, lattice.x_mm[1] - lattice.x_mm[0]
    x, y, z = origin[0] + u * h, origin[1] + v * h, origin[2] + w * h
    depth = trilinear(block.corner, SKIN_DEPTH, u, v, w)
    thick = trilinear(block.corner, SKIN_MM, u, v, w) + _areola(paint, y, z)
    if x < 0.0 or depth < thick or _beyond_cut(paint, y, z):
        return NOT_COUNTED
    if trilinear(block.corner, MUSCLE_DEPTH, u, v, w) > 0.0 and depth > paint.cover_mm:
        return NOT_COUNTED
    i = int((x - lattice.x_mm[0]) / voxel + 0.5)
    j = int((y - lattice.lateral_mm[0]) / voxel + 0.5)
    k = int((z - lattice.superior_mm[0]) / voxel + 0.5)
    i, j = min(max(i, 0), labels.shape[0] - 1), min(max(j, 0), labels.shape[1] - 1)
    k = min(max(k, 0), labels.shape[2] - 1)
    label = labels[i, j, k]
    if label == 0:
        return UNDECIDED
    return TUBE if label == 95 or label == 125 else SEPTUM_STATE


@parallel_kernel
def paint_tissue(
    thread: Thread, order: NDArray[np.int64], labels: NDArray[np.uint8], lattice: Lattice,
    texture: Texture, paint: Paint,
) -> None:  # fmt: skip
    """Give every voxel its label; tubes already there stay where they are inside the breast.

    `order` is that in which layers of blocks are dealt to threads.
    """
    block = _new_block()
    for turn in share(thread, 0, order.size):
        i = order[turn]
        if lattice.x_start[i] == lattice.x_start[i + 1]:
            continue
        for j in range(lattice.lateral_start.size - 1):
            if lattice.lateral_start[j] == lattice.lateral_start[j + 1]:
                continue
            for k in range(lattice.superior_start.size - 1):
                if lattice.superior_start[k] < lattice.superior_start[k + 1]:
                    _paint_block(labels, lattice, texture, paint, block, (i, j, k))


@kernel
def _clear(labels: NDArray[np.uint8], lattice: Lattice, at: tuple[int, int, int]) -> None:
    """No tissue in a block; pages that hold none are only read."""
    for i in range(lattice.x_start[at[0]], lattice.x_start[at[0] + 1]):
        for j in range(lattice.lateral_start[at[1]], lattice.lateral_start[at[1] + 1]):
            for k in range(lattice.superior_start[at[2]], lattice.superior_start[at[2] + 1]):
                if labels[i, j, k] != 0:
                    labels[i, j, k] = 0


@kernel
def _paint_block(
    labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint, block: Block,
    at: tuple[int, int, int],
) -> None:  # fmt: skip
    fields, h, corner = texture.fields, lattice.coarse_mm, block.corner
    voxel = lattice.x_mm[1] - lattice.x_mm[0]
    x = lattice.coarse_origin_mm[0] + at[0] * h
    y = lattice.coarse_origin_mm[1] + at[1] * h
    z = lattice.coarse_origin_mm[2] + at[2] * h
    deepest = np.float32(-9.0)
    for a in range(2):
        for b in range(2):
            for c in range(2):
                deepest = max(deepest, fields[at[0] + a, at[1] + b, at[2] + c, SKIN_DEPTH])
    reach = paint.nipple[2] + 2.0 * abs(paint.nipple[1]) + 3.0
    nipple = x + h > paint.nipple[0] - 5.0 and abs(y + 0.5 * h) < reach and abs(z + 0.5 * h) < reach
    nearest = min(y * paint.cut[0], (y + h) * paint.cut[0])
    nearest += min(z * paint.cut[1], (z + h) * paint.cut[1])
    if (deepest < -voxel and not nipple) or nearest > paint.cut[2]:
        _clear(labels, lattice, at)
        return
    _load(fields, at[0], at[1], at[2], corner)
    shallow = nipple or corner[SKIN_DEPTH].min() < (
        corner[SKIN_MM].max() + paint.areola_mm[0] + voxel
    )
    most = corner[MUSCLE_DEPTH].max()
    muscle = most > 0.0 and deepest > paint.cover_mm
    only_muscle = corner[MUSCLE_DEPTH].min() > 0.0 and corner[SKIN_DEPTH].min() > paint.cover_mm
    _wanted_nodes(lattice, at, block.wanted)
    gland = _decide_gland(texture, paint, block, np.array([x, y, z]), h, only_muscle)
    walls = _gather_walls(texture, block, h, voxel, only_muscle, gland)
    _fill_block(labels, lattice, texture, paint, block, at, (shallow, muscle, gland, walls))


@kernel
def _wanted_nodes(lattice: Lattice, at: tuple[int, int, int], wanted: NDArray[np.bool_]) -> None:
    """Which planes of a block's sub-grid its voxels lie between; large voxels leave some out."""
    wanted[:] = False
    origin, h = lattice.coarse_origin_mm, lattice.coarse_mm
    for i in range(lattice.x_start[at[0]], lattice.x_start[at[0] + 1]):
        _mark(wanted, 0, (lattice.x_mm[i] - origin[0]) / h - at[0])
    for j in range(lattice.lateral_start[at[1]], lattice.lateral_start[at[1] + 1]):
        _mark(wanted, 1, (lattice.lateral_mm[j] - origin[1]) / h - at[1])
    for k in range(lattice.superior_start[at[2]], lattice.superior_start[at[2] + 1]):
        _mark(wanted, 2, (lattice.superior_mm[k] - origin[2]) / h - at[2])


@kernel
def _mark(wanted: NDArray[np.bool_], axis: int, part: float) -> None:
    first = min(int(part * SUB_STEPS), SUB_STEPS - 1)
    wanted[axis, first] = wanted[axis, first + 1] = True


@kernel
def _decide_gland(
    texture: Texture, paint: Paint, block: Block, origin: NDArray[np.float64], h: float,
    only_muscle: bool,
) -> int:  # fmt: skip
    """0 where a block holds no gland, 2 where it is all gland, 1 with its sub-grid filled."""
    lowest, highest = block.corner[POTENTIAL].min(), block.corner[POTENTIAL].max()
    if only_muscle or highest + texture.noise_limit <= paint.threshold:
        return 0
    n = _gather_lobules(texture, block, h)
    pull = 0.0
    for a in range(n):
        pull = max(pull, texture.lobule_amplitude * block.coarse.fatness[a])
    if lowest - texture.noise_limit - pull > paint.threshold:
        return 2
    at, some, all_of_it = np.empty(3), False, True
    wanted = block.wanted
    for a in range(SUB_STEPS + 1):
        for b in range(SUB_STEPS + 1):
            for c in range(SUB_STEPS + 1):
                if not (wanted[0, a] and wanted[1, b] and wanted[2, c]):
                    continue
                at[0], at[1], at[2] = a / SUB_STEPS, b / SUB_STEPS, c / SUB_STEPS
                value = _potential_at(texture, block, n, at, origin, h) - paint.threshold
                block.sub[a, b, c] = value
                some, all_of_it = some or value > 0.0, all_of_it and value > 0.0
    return (2 if all_of_it else 1) if some else 0


@kernel
def _gather_walls(
    texture: Texture, block: Block, h: float, voxel: float, only_muscle: bool, gland: int
) -> tuple[int, int]:
    """Cells of the nets whose walls cross a block: of both septa, or of bundles in muscle."""
    if only_muscle:
        radius = _net_frame(block, FIBRE, h)
        reach = (1.8 * MUSCLE_FAT + 0.5 * voxel) * _stretch(block.slope)
        return gather(texture.bundles, block.centre, radius, reach, block.slope, block.coarse), -1
    thick = block.corner[SEPTUM].max()
    if gland == 2 or thick <= 0.0:
        return 0, 0
    radius = _net_frame(block, NET, h)
    reach = (1.8 * thick + 0.5 * voxel) * _stretch(block.slope)
    n = gather(texture.coarse, block.centre, radius, reach, block.slope, block.coarse)
    return n, gather(texture.fine, block.centre, radius, reach, block.slope, block.fine)


@merged_kernel
def _row(corner: NDArray[np.float64], channel: int, u: float, v: float, w: int) -> float:
    """Value of a channel at an end of a row of the block."""
    near = (1.0 - v) * corner[channel, w] + v * corner[channel, 2 + w]
    return (1.0 - u) * near + u * ((1.0 - v) * corner[channel, 4 + w] + v * corner[channel, 6 + w])


@kernel
def _sub_row(sub: NDArray[np.float64], u: float, v: float, out: NDArray[np.float64]) -> None:
    """The sub-grid's values along a row of the block."""
    a, b = min(int(u * SUB_STEPS), SUB_STEPS - 1), min(int(v * SUB_STEPS), SUB_STEPS - 1)
    p, q = u * SUB_STEPS - a, v * SUB_STEPS - b
    for c in range(SUB_STEPS + 1):
        low = (1.0 - q) * sub[a, b, c] + q * sub[a, b + 1, c]
        high = (1.0 - q) * sub[a + 1, b, c] + q * sub[a + 1, b + 1, c]
        out[c] = (1.0 - p) * low + p * high


@kernel
def _fill_block(
    labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint, block: Block,
    at: tuple[int, int, int], kind: tuple[bool, bool, int, tuple[int, int]],
) -> None:  # fmt: skip
    """Label the voxels of a block that is not air.

    What is in the tuples is taken out of them first: within the loops each access would count its
    references, which costs more than all else.
    """
    shallow, muscle, gland, walls = kind
    h, origin = lattice.coarse_mm, lattice.coarse_origin_mm
    cover = paint.cover_mm
    x_mm, y_mm, z_mm = lattice.x_mm, lattice.lateral_mm, lattice.superior_mm
    voxel, key = x_mm[1] - x_mm[0], texture.key
    low, step, corner, sub, sub_row = block.low, block.step, block.corner, block.sub, block.sub_row
    coarse, fine, numbers, name = block.coarse, block.fine, paint.nipple, paint.labels
    place, pair, thin_place, thin_pair = coarse.place, coarse.pair, fine.place, fine.pair
    cut_y, cut_z, cut_mm = paint.cut[0], paint.cut[1], paint.cut[2]
    areola, areola_mm = paint.areola_mm[0], paint.areola_mm[1]
    net, thin, net_at = texture.coarse, texture.fine, NET
    only_muscle = walls[1] == -1
    if only_muscle:
        net, net_at = texture.bundles, FIBRE
    o0, o1, o2, per = net.origin_mm[0], net.origin_mm[1], net.origin_mm[2], 1.0 / net.cell_mm
    t0, t1, t2, thin_per = (thin.origin_mm[0], thin.origin_mm[1], thin.origin_mm[2],
                            1.0 / thin.cell_mm)  # fmt: skip
    thin_share = texture.fine_septum
    first_k, last_k = lattice.superior_start[at[2]], lattice.superior_start[at[2] + 1]
    first_j, last_j = lattice.lateral_start[at[1]], lattice.lateral_start[at[1] + 1]
    for i in range(lattice.x_start[at[0]], lattice.x_start[at[0] + 1]):
        x = x_mm[i]
        u = (x - origin[0]) / h - at[0]
        for j in range(first_j, last_j):
            y = y_mm[j]
            v = (y - origin[1]) / h - at[1]
            for channel in range(CHANNELS):
                low[channel] = _row(corner, channel, u, v, 0)
                step[channel] = _row(corner, channel, u, v, 1) - low[channel]
            if gland == 1:
                _sub_row(sub, u, v, sub_row)
            for k in range(first_k, last_k):
                z = z_mm[k]
                if y * cut_y + z * cut_z > cut_mm:
                    labels[i, j, k] = 0
                    continue
                w = (z - origin[2]) / h - at[2]
                depth = low[SKIN_DEPTH] + w * step[SKIN_DEPTH]
                if shallow:
                    near = (y * y + z * z) / (areola_mm * areola_mm)
                    thick = low[SKIN_MM] + w * step[SKIN_MM] + areola * np.exp(-near * near)
                    if abs(depth) < voxel or abs(depth - thick) < voxel:
                        depth += voxel * dither(i, j, k, corner)
                    if depth < thick:
                        if in_nipple(x, y, z, depth, thick, numbers):
                            if labels[i, j, k] == 0:
                                labels[i, j, k] = name[NIPPLE]
                        else:
                            labels[i, j, k] = name[SKIN] if depth >= 0.0 else 0
                        continue
                in_muscle = (
                    muscle and depth > cover and low[MUSCLE_DEPTH] + w * step[MUSCLE_DEPTH] > 0.0
                )
                if not in_muscle:
                    if labels[i, j, k] != 0:
                        continue
                    if gland == 2 or (gland == 1 and _on_sub_row(sub_row, w) > 0.0):
                        labels[i, j, k] = name[GLAND]
                        continue
                fill = 0.0
                if in_muscle == only_muscle and (walls[0] > 1 or walls[1] > 1):
                    p = low[net_at] + w * step[net_at]
                    q = low[net_at + 1] + w * step[net_at + 1]
                    r = low[net_at + 2] + w * step[net_at + 2]
                    thick = MUSCLE_FAT if in_muscle else low[SEPTUM] + w * step[SEPTUM]
                    fill = wall_fill(
                        place, pair, walls[0], (p - o0) * per, (q - o1) * per, (r - o2) * per,
                        thick, voxel,
                    )  # fmt: skip
                    if walls[1] > 1:
                        fill += wall_fill(
                            thin_place, thin_pair, walls[1], (p - t0) * thin_per,
                            (q - t1) * thin_per, (r - t2) * thin_per, thin_share * thick, voxel,
                        )  # fmt: skip
                if fill <= 0.0:
                    labels[i, j, k] = name[MUSCLE] if in_muscle else name[ADIPOSE]
                    continue
                lot = lattice_hash(i, j, k, key + 7) / 4294967296.0
                if in_muscle:
                    labels[i, j, k] = name[ADIPOSE] if lot < fill else name[MUSCLE]
                else:
                    labels[i, j, k] = name[_step(fill, lot)]


@merged_kernel
def _on_sub_row(sub_row: NDArray[np.float64], w: float) -> float:
    c = min(int(w * SUB_STEPS), SUB_STEPS - 1)
    part = w * SUB_STEPS - c
    return (1.0 - part) * sub_row[c] + part * sub_row[c + 1]


@kernel
def _step(fill: float, lot: float) -> int:
    """Place in `Paint.labels` of a filling: the step below or above, so that its mean is right."""
    if fill < 0.125:
        return EIGHTH if lot < fill / 0.125 else ADIPOSE
    if fill < 0.25:
        return QUARTER if lot < (fill - 0.125) / 0.125 else EIGHTH
    if fill < 0.5:
        return HALF if lot < (fill - 0.25) / 0.25 else QUARTER
    return LIGAMENT if lot < (fill - 0.5) / 0.5 else HALF
