"""Gland and septa of a block: its potential, its lobules, and the walls that cross it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import borrowing_kernel, merged_kernel
from mammosim.phantom.anatomy._block_kernels import (
    FIBRE,
    NET,
    POTENTIAL,
    SEPTUM,
    SUB_STEPS,
    Block,
    Paint,
    Places,
    Texture,
    least_and_most,
    trilinear,
)
from mammosim.phantom.anatomy._grain_kernels import MOST_GLAND_GRAIN, MOST_UNEVEN
from mammosim.phantom.anatomy._net_kernels import (
    Near,
    Net,
    gather,
    walls_between,
)
from mammosim.phantom.anatomy._noise_kernels import add_noise
from mammosim.phantom.anatomy._wall_kernels import (
    ROUNDING_REACH,
    border_reach,
    wall_distance,
    wall_reach,
)

MUSCLE_FAT = 0.11
"""Mean thickness of the fat between bundles of muscle, mm. Chosen."""

BORDER_MM = 1.1
"""Size of the fillets between walls of mean thickness, mm: how far along each wall they reach.
Chosen by eye."""


@borrowing_kernel
def strands(texture: Texture, places: Places, count: int) -> None:
    """Strands towards the nipple and isotropic grain at places, within the noise's limit."""
    at_mm, seen, noise, fan = places.at_mm, places.seen, places.noise, places.fan
    gradients, span = places.gradients, places.span
    apex_x, apex_y, apex_z = texture.apex_mm[0], texture.apex_mm[1], texture.apex_mm[2]
    for n in range(count):
        noise[n] = 0.0
        # Strands run towards the nipple: noise in direction and, three times slower, distance.
        dx, dy, dz = apex_x - at_mm[n, 0], at_mm[n, 1] - apex_y, at_mm[n, 2] - apex_z
        r = np.sqrt(dx * dx + dy * dy + dz * dz) + 1.0
        fan[n, 0], fan[n, 1], fan[n, 2] = np.log(r) / 3.0, dy / r, dz / r
    fans = texture.fan_amplitude.size
    for octave in range(fans + texture.grain_amplitude.size):
        if octave < fans:
            per, key = texture.fan_per_radian[octave], texture.key + octave
            amplitude = texture.fan_amplitude[octave]
            for n in range(count):
                for axis in range(3):
                    seen[n, axis] = fan[n, axis] * per
        else:
            per, key = 1.0 / texture.grain_mm[octave - fans], texture.key + 64 + octave - fans
            amplitude = texture.grain_amplitude[octave - fans]
            for n in range(count):
                for axis in range(3):
                    seen[n, axis] = at_mm[n, axis] * per
        add_noise(seen, count, key, amplitude, gradients, span, noise)
    limit = texture.noise_limit
    for n in range(count):
        noise[n] = min(max(noise[n], -limit), limit)


@borrowing_kernel
def _net_frame(block: Block, channel: int, coarse_mm: float) -> float:
    """Slope and centre of net coordinates over a block; the radius of the block in them, mm."""
    for axis in range(3):
        c = block.corner[channel + axis]
        total = 0.0
        for n in range(8):
            total += c[n]
        block.centre[axis] = total / 8.0
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


@borrowing_kernel
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


@borrowing_kernel
def add_potential(texture: Texture, block: Block, n: int, count: int) -> None:
    """Add to the noise at places of a block the rest of the potential there.

    Its first n cells of lobules that are listed push gland aside. What is in the tuples is taken
    out of them first: within the loop each access would count its references.
    """
    corner, near, net = block.corner, block.near, texture.lobules
    place, pair, cells, fatness = near.place, near.pair, near.block, near.fatness
    holding, c, depth_mm, amplitude = (
        near.holding[0], net.cell_mm, texture.lobule_mm, texture.lobule_amplitude,
    )  # fmt: skip
    o0, o1, o2 = net.origin_mm[0], net.origin_mm[1], net.origin_mm[2]
    part, total = block.places.part, block.places.noise
    for m in range(count):
        u, v, w = part[m, 0], part[m, 1], part[m, 2]
        total[m] += trilinear(corner, POTENTIAL, u, v, w)
        if n > 0:
            p = trilinear(corner, NET, u, v, w)
            q = trilinear(corner, NET + 1, u, v, w)
            r = trilinear(corner, NET + 2, u, v, w)
            gap, inside = wall_distance(
                place, pair, cells, holding, n, (p - o0) / c, (q - o1) / c, (r - o2) / c, depth_mm
            )
            way = min(max(gap / depth_mm, 0.0), 1.0)
            total[m] -= amplitude * (fatness[inside] * way * (2.0 - way))


@borrowing_kernel
def gather_lobules(
    texture: Texture, block: Block, coarse_mm: float, part: float, at: NDArray[np.float64]
) -> int:
    """Cells that push gland aside within a block, or within a part of it, the cell of its sub-grid
    about a place (u, v, w)."""
    net, reach = texture.lobules, ROUNDING_REACH * texture.lobule_mm
    radius, stretch = _net_frame(block, NET, coarse_mm), _stretch(block.slope)
    if part < 1.0:
        for axis in range(3):
            block.centre[axis] = trilinear(block.corner, NET + axis, at[0], at[1], at[2])
        radius *= part
    n = gather(net, block.centre, radius, reach * stretch, block.slope, block.near)
    return _listed(block, net, n, reach) if part == 1.0 else n


@borrowing_kernel
def decide_gland(texture: Texture, paint: Paint, block: Block, h: float, only_muscle: bool) -> int:
    """0 where a block holds no gland, 2 where it is gland but for the grain's holes, 1 with its
    sub-grid filled."""
    lowest, highest = least_and_most(block.corner, POTENTIAL)
    grain = MOST_GLAND_GRAIN * texture.gland_scale
    highest += grain + texture.gland_push
    if only_muscle or highest + texture.noise_limit <= paint.threshold:
        return 0
    n = -1  # lobules are not gathered yet, and noise alone may decide
    if lowest - texture.noise_limit > paint.threshold + texture.gland_cap:
        n = gather_lobules(texture, block, h, 1.0, block.centre)
        pull = texture.lobule_amplitude * _strongest(block.near, n)
        if lowest - texture.noise_limit - pull > paint.threshold + texture.gland_cap:
            return 2
    wanted, sub, noise = block.wanted, block.sub, block.places.noise
    count = _place_sub_grid(wanted, block.places.at_mm, block.places.part, block.origin, h)
    strands(texture, block.places, count)
    most = noise[0]
    for place in range(1, count):
        most = max(most, noise[place])
    if highest + most <= paint.threshold:
        return 0
    if n < 0:
        n = gather_lobules(texture, block, h, 1.0, block.centre)
    add_potential(texture, block, n, count)
    some, all_of_it, threshold, cap = False, True, paint.threshold, texture.gland_cap
    count = 0
    for a in range(SUB_STEPS + 1):
        for b in range(SUB_STEPS + 1):
            for c in range(SUB_STEPS + 1):
                if not (wanted[0, a] and wanted[1, b] and wanted[2, c]):
                    continue
                value = noise[count] - threshold
                count += 1
                sub[a, b, c] = value
                some = some or value > -grain
                all_of_it = all_of_it and value >= cap
    return (2 if all_of_it else 1) if some else 0


@merged_kernel
def _place_sub_grid(
    wanted: NDArray[np.bool_], at_mm: NDArray[np.float64], part: NDArray[np.float64],
    origin: NDArray[np.float64], h: float,
) -> int:  # fmt: skip
    """Places of a block's sub-grid that are wanted, in generator coordinates and in parts of the
    block's side; how many."""
    step, count = h / SUB_STEPS, np.intp(0)
    for a in range(SUB_STEPS + 1):
        for b in range(SUB_STEPS + 1):
            for c in range(SUB_STEPS + 1):
                if wanted[0, a] and wanted[1, b] and wanted[2, c]:
                    at_mm[count, 0] = origin[0] + a * step
                    at_mm[count, 1] = origin[1] + b * step
                    at_mm[count, 2] = origin[2] + c * step
                    part[count, 0], part[count, 1] = a / SUB_STEPS, b / SUB_STEPS
                    part[count, 2] = c / SUB_STEPS
                    count += 1
    return int(count)


@borrowing_kernel
def _strongest(near: Near, n: int) -> float:
    """The largest fatness of the cells near a block."""
    most = 0.0
    for m in range(n):
        most = max(most, near.fatness[near.block[m]])
    return most


@borrowing_kernel
def gather_walls(
    texture: Texture, block: Block, h: float, voxel: float, only_muscle: bool, gland: int
) -> int:
    """Cells of the net whose walls cross a block: of lobules, or of bundles in muscle.

    Returns how many `block.near.block` lists; fewer than two are none.
    """
    if only_muscle:
        radius = _net_frame(block, FIBRE, h)
        reach = wall_reach(MOST_UNEVEN * MUSCLE_FAT, voxel) * _stretch(block.slope)
        return gather(texture.bundles, block.centre, radius, reach, block.slope, block.near)
    thick = MOST_UNEVEN * least_and_most(block.corner, SEPTUM)[1]
    if gland == 2 or thick <= 0.0:
        return 0
    radius = _net_frame(block, NET, h)
    reach = max(wall_reach(thick, voxel), border_reach(BORDER_MM, voxel))
    n = gather(
        texture.lobules, block.centre, radius, reach * _stretch(block.slope), block.slope,
        block.near,
    )  # fmt: skip
    return _listed(block, texture.lobules, n, reach)


@borrowing_kernel
def _listed(block: Block, net: Net, n: int, limit_mm: float) -> int:
    """List those of the gathered cells whose walls come within a limit of a block; how many."""
    near, corners = block.near, block.corners
    for c in range(8):
        for axis in range(3):
            at_mm = block.corner[NET + axis, c]
            corners[c, axis] = (at_mm - net.origin_mm[axis]) / net.cell_mm
    for m in range(n):
        near.row[m] = near.block[m]
    return walls_between(
        near.place, near.closest, near.row, n, corners, limit_mm, near.q, near.block
    )
