"""The tissue of each voxel from coarse fields and fine structure.

What a block's corners decide is not asked of its voxels: air is skipped, fat without walls is
filled, and noise is evaluated on a sub-grid of `SUB_STEPS` only where it decides between gland and
fat.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, borrowing_kernel, parallel_kernel, share
from mammosim.phantom.anatomy._block_kernels import (
    ADIPOSE,
    FIBRE,
    GLAND,
    MUSCLE,
    MUSCLE_DEPTH,
    NET,
    NIPPLE,
    SEPTUM,
    SKIN,
    SKIN_DEPTH,
    SKIN_MM,
    Block,
    Lattice,
    Paint,
    Texture,
    along_row,
    layer_sides,
    least_and_most,
    load_corners,
    new_block,
    on_sub_row,
    sub_index,
    sub_row_values,
)
from mammosim.phantom.anatomy._fill_kernels import fill_of, fill_step
from mammosim.phantom.anatomy._grain_kernels import (
    MOST_GLAND_GRAIN,
    MOST_UNEVEN,
    gland_grain_at,
    muscle_grain_at,
    wall_unevenness,
)
from mammosim.phantom.anatomy._net_kernels import three_nearest, walls_between
from mammosim.phantom.anatomy._noise_kernels import lattice_hash
from mammosim.phantom.anatomy._parenchyma_kernels import (
    BORDER_MM,
    MUSCLE_FAT,
    decide_gland,
    gather_walls,
)
from mammosim.phantom.anatomy._surface_kernels import areola, dither, in_nipple, in_root
from mammosim.phantom.anatomy._wall_kernels import (
    border_reach,
    fillet_span,
    free_of_fillets,
    wall_fill,
    wall_reach,
)

APPROACH = 1.3
"""A step along a row comes nearer to a wall by no more than this many times its length: above 1
where coordinates are not linear within a block."""

NO_DUCTS_MM = 2.0
"""Voxels above this, mm, show the nipple without ducts, each of which fills a voxel's width: they
would leave nothing of it."""


@parallel_kernel
def paint_tissue(
    thread: Thread, order: NDArray[np.int64], labels: NDArray[np.uint8], lattice: Lattice,
    texture: Texture, paint: Paint,
) -> None:  # fmt: skip
    """Give every voxel its label; tubes already there stay where they are inside the breast.

    `order` is that in which layers of blocks are dealt to threads.
    """
    block = new_block()
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


@borrowing_kernel
def _clear(labels: NDArray[np.uint8], lattice: Lattice, at: tuple[int, int, int]) -> None:
    """No tissue in a block; pages that hold none are only read."""
    for i in range(lattice.x_start[at[0]], lattice.x_start[at[0] + 1]):
        for j in range(lattice.lateral_start[at[1]], lattice.lateral_start[at[1] + 1]):
            for k in range(lattice.superior_start[at[2]], lattice.superior_start[at[2] + 1]):
                if labels[i, j, k] != 0:
                    labels[i, j, k] = 0


@borrowing_kernel
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
    nipple = (
        x + h > paint.nipple[0] - 5.0 - paint.nipple[9]
        and abs(y + 0.5 * h) < reach
        and abs(z + 0.5 * h) < reach
    )
    nearest = min(y * paint.cut[0], (y + h) * paint.cut[0])
    nearest += min(z * paint.cut[1], (z + h) * paint.cut[1])
    if (deepest < -voxel and not nipple) or nearest > paint.cut[2]:
        _clear(labels, lattice, at)
        return
    load_corners(fields, at[0], at[1], at[2], corner)
    shallowest = least_and_most(corner, SKIN_DEPTH)[0]
    thickest = least_and_most(corner, SKIN_MM)[1]
    shallow = nipple or shallowest < thickest + paint.areola_mm[0] + voxel
    least, most = least_and_most(corner, MUSCLE_DEPTH)
    muscle = most > 0.0 and deepest > paint.cover_mm
    only_muscle = least > 0.0 and shallowest > paint.cover_mm
    _wanted_nodes(lattice, at, block.wanted)
    block.origin[0], block.origin[1], block.origin[2] = x, y, z
    gland = decide_gland(texture, paint, block, h, only_muscle)
    walls = gather_walls(texture, block, h, voxel, only_muscle, gland)
    _fill_block(
        labels, lattice, texture, paint, block, at, (shallow, muscle, only_muscle, gland, walls)
    )


@borrowing_kernel
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


@borrowing_kernel
def _mark(wanted: NDArray[np.bool_], axis: int, part: float) -> None:
    first = sub_index(part)
    wanted[axis, first] = wanted[axis, first + 1] = True


@borrowing_kernel
def _fill_block(
    labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint, block: Block,
    at: tuple[int, int, int], kind: tuple[bool, bool, bool, int, int],
) -> None:  # fmt: skip
    """Label the voxels of a block that is not air.

    What is in the tuples is taken out of them first: within the loops each access would count its
    references, which costs more than all else.
    """
    shallow, muscle, only_muscle, gland, walls = kind
    h, origin = lattice.coarse_mm, lattice.coarse_origin_mm
    cover = paint.cover_mm
    x_mm, y_mm, z_mm = lattice.x_mm, lattice.lateral_mm, lattice.superior_mm
    voxel, key = x_mm[1] - x_mm[0], texture.key
    corner, side, sub, sub_row = block.corner, block.side, block.sub, block.sub_row
    numbers, name = paint.nipple, paint.labels
    near, ends, place, pair = block.near, block.ends, block.near.place, block.near.pair
    scale, closest, around, cells, at_ends = near.scale, near.closest, near.block, near.row, near.q
    cut_y, cut_z, cut_mm = paint.cut[0], paint.cut[1], paint.cut[2]
    thicker = paint.areola_mm[0]
    net, net_at, border = texture.lobules, NET, BORDER_MM
    reach = wall_reach(MOST_UNEVEN * least_and_most(corner, SEPTUM)[1], voxel)
    if only_muscle:
        net, net_at, border = texture.bundles, FIBRE, 0.0
        reach = wall_reach(MOST_UNEVEN * MUSCLE_FAT, voxel)
    far, span = border_reach(border, voxel), fillet_span(border, voxel)
    per_step = 1.0 / (APPROACH * voxel)
    o0, o1, o2, per = net.origin_mm[0], net.origin_mm[1], net.origin_mm[2], 1.0 / net.cell_mm
    tile, gland_scale, cap = texture.grain_tile, texture.gland_scale, texture.gland_cap
    streaks, most_grain = texture.muscle_streaks, MOST_GLAND_GRAIN * gland_scale
    near_axis = 4.0 * numbers[2] * numbers[2]
    first_k, last_k = lattice.superior_start[at[2]], lattice.superior_start[at[2] + 1]
    first_i, last_i = lattice.x_start[at[0]], lattice.x_start[at[0] + 1]
    first_j, last_j = lattice.lateral_start[at[1]], lattice.lateral_start[at[1] + 1]
    first_w = (z_mm[first_k] - origin[2]) / h - at[2]
    last_w = (z_mm[last_k - 1] - origin[2]) / h - at[2]
    for j in range(first_j, last_j):
        y = y_mm[j]
        v = (y - origin[1]) / h - at[1]
        layer_sides(corner, v, side)
        for i in range(first_i, last_i):
            x = x_mm[i]
            u = (x - origin[0]) / h - at[0]
            depth_0, depth_1 = along_row(side, SKIN_DEPTH, u)
            muscle_0, muscle_1 = along_row(side, MUSCLE_DEPTH, u)
            septum_0, septum_1 = along_row(side, SEPTUM, u)
            skin_0, skin_1 = along_row(side, SKIN_MM, u)
            p_0, p_1 = along_row(side, net_at, u)
            q_0, q_1 = along_row(side, net_at + 1, u)
            r_0, r_1 = along_row(side, net_at + 2, u)
            if gland == 1:
                sub_row_values(sub, u, v, sub_row)
            free_k, listed = first_k, -1
            for k in range(first_k, last_k):
                z = z_mm[k]
                if y * cut_y + z * cut_z > cut_mm:
                    labels[i, j, k] = 0
                    continue
                w = (z - origin[2]) / h - at[2]
                depth = depth_0 + w * depth_1
                skin = skin_0 + w * skin_1
                # Twice a voxel below the areola there is at most the nipple's root.
                if shallow and (depth < skin + thicker + 2.0 * voxel or y * y + z * z <= near_axis):
                    thick = skin + areola(paint, y, z)
                    smooth = depth
                    # Not at the chest wall, where no voxel behind would hold one that stands out.
                    if i > 0 and (abs(depth) < voxel or abs(depth - thick) < voxel):
                        depth += voxel * dither(i, j, k, corner)
                    if depth < thick:
                        if in_nipple(x, y, z, smooth, thick, numbers):
                            here = labels[i, j, k]
                            if here == 0 or fill_of(here, name) > 0.0 or voxel > NO_DUCTS_MM:
                                labels[i, j, k] = name[NIPPLE]
                        else:
                            labels[i, j, k] = name[SKIN] if depth >= 0.0 else 0
                        continue
                    if in_root(x, y, z, depth - thick, numbers):
                        here = labels[i, j, k]
                        if here == 0 or fill_of(here, name) > 0.0:
                            labels[i, j, k] = name[NIPPLE]
                        continue
                in_muscle = muscle and depth > cover and muscle_0 + w * muscle_1 > 0.0
                held = 0.0
                if not in_muscle:
                    here = labels[i, j, k]
                    held = fill_of(here, name)
                    if here != 0 and here != name[ADIPOSE] and held == 0.0:
                        continue  # a tube
                p, q, r = p_0 + w * p_1, q_0 + w * q_1, r_0 + w * r_1
                if gland > 0 and not in_muscle:
                    above = min(on_sub_row(sub_row, w), cap) if gland == 1 else cap
                    if (
                        above > -most_grain
                        and above + gland_grain_at(tile, gland_scale, p, q, r) > 0.0
                    ):
                        labels[i, j, k] = name[GLAND]
                        continue
                fill = held
                if in_muscle == only_muscle and walls > 1:
                    if listed < 0:
                        for end, part in enumerate((first_w, last_w)):
                            ends[end, 0] = (p_0 + part * p_1 - o0) * per
                            ends[end, 1] = (q_0 + part * q_1 - o1) * per
                            ends[end, 2] = (r_0 + part * r_1 - o2) * per
                        listed = walls_between(
                            place, closest, around, walls, ends, max(reach, far), at_ends, cells
                        )
                    if listed > 1 and k >= free_k:
                        x_cell, y_cell, z_cell = (p - o0) * per, (q - o1) * per, (r - o2) * per
                        inside, least, second, third = three_nearest(
                            place, cells, listed, x_cell, y_cell, z_cell
                        )
                        gap = (second - least) * scale[inside]
                        filleted = free_of_fillets(gap, (third - least) * scale[inside], far, span)
                        free = min(gap - reach, filleted)
                        free_k = k + 1 + int(max(free, -voxel) * per_step)
                        if free < 0.0:
                            thick = MUSCLE_FAT if in_muscle else septum_0 + w * septum_1
                            thick *= wall_unevenness(tile, p, q, r)
                            if filleted < 0.0 or gap < wall_reach(thick, voxel):
                                fill += wall_fill(
                                    place, pair, cells, listed, inside, least,
                                    (x_cell, y_cell, z_cell), thick, voxel, border,
                                )  # fmt: skip
                    if in_muscle and muscle_grain_at(tile, p, q, r) > streaks:
                        fill = 1.0
                if fill <= 0.0:
                    labels[i, j, k] = name[MUSCLE] if in_muscle else name[ADIPOSE]
                    continue
                lot = lattice_hash(i, j, k, key + 7) / 4294967296.0
                if in_muscle:
                    labels[i, j, k] = name[ADIPOSE] if lot < fill else name[MUSCLE]
                else:
                    labels[i, j, k] = name[fill_step(fill, lot)]
