"""Kernels that leave out of a phantom's labels what a view does not hold between the plates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, parallel_kernel, share
from mammosim.phantom.anatomy._surface_kernels import even_shift


class CoarseDepth(NamedTuple):
    """Depth below the skin on a coarse grid, and where in it the voxels lie.

    Parameters
    ----------
    mm : ndarray of float32, [x, y, z]
        Depth, negative outside.
    skin_mm : float32
        Thickness of the skin.
    cells_x, part_x, cells_y, part_y, cells_z, part_z : ndarray
        Cell of the coarse grid and place in it, 0 to 1, of the voxels along each axis.
    """

    mm: NDArray[np.float32]
    skin_mm: np.float32
    cells_x: NDArray[np.int64]
    part_x: NDArray[np.float32]
    cells_y: NDArray[np.int64]
    part_y: NDArray[np.float32]
    cells_z: NDArray[np.int64]
    part_z: NDArray[np.float32]


@kernel
def _depth_of_column(
    depth: CoarseDepth, i: int, j: int, voxel_mm: np.float32, out_mm: NDArray[np.float32]
) -> np.float32:
    """Depth at the coarse grid's heights over voxels [i, j], and what is added to it there.

    The surface is moved by half a voxel to either side, column by column, so that it draws no
    contour lines.
    """
    coarse = depth.mm
    low_x, part_x = depth.cells_x[i], depth.part_x[i]
    low_y, part_y = depth.cells_y[j], depth.part_y[j]
    for k in range(coarse.shape[2]):
        below, above = coarse[low_x, low_y, k], coarse[low_x, low_y + 1, k]
        below += part_x * (coarse[low_x + 1, low_y, k] - below)
        above += part_x * (coarse[low_x + 1, low_y + 1, k] - above)
        out_mm[k] = below + part_y * (above - below)
    return voxel_mm * np.float32(even_shift(i, j))


@kernel
def _depth_at(
    depth: CoarseDepth, line: NDArray[np.float32], moved: np.float32, k: int
) -> np.float32:
    """Depth of voxel k of a column, from what `_depth_of_column` gives."""
    low = depth.cells_z[k]
    return line[low] + depth.part_z[k] * (line[low + 1] - line[low]) + moved


@parallel_kernel
def held_extent(
    thread: Thread,
    depth: CoarseDepth,
    box: NDArray[np.int64],
    voxel_mm: np.float32,
    nipple: np.uint8,
    labels: NDArray[np.uint8],
    out_rows: NDArray[np.bool_],
    out_columns: NDArray[np.bool_],
) -> None:
    """Where tissue is left if all outside of the held breast but the nipple is taken away.

    Only `box` (3, 2) is looked at for that. `out_rows` [x, y] and `out_columns` [x, z] become true.
    """
    for i in share(thread, 0, labels.shape[0]):
        line = np.empty(depth.mm.shape[2], np.float32)
        for j in range(labels.shape[1]):
            inside = box[0, 0] <= i < box[0, 1] and box[1, 0] <= j < box[1, 1]
            moved = np.float32(0.0)
            if inside:
                moved = _depth_of_column(depth, i, j, voxel_mm, line)
            some = False
            for k in range(labels.shape[2]):
                if labels[i, j, k] == 0 or (some and out_columns[i, k]):
                    continue
                checked = inside and box[2, 0] <= k < box[2, 1] and labels[i, j, k] != nipple
                if checked and _depth_at(depth, line, moved, k) < 0.0:
                    continue
                some = True
                out_columns[i, k] = True
            out_rows[i, j] = some


@parallel_kernel
def muscle_fronts(
    thread: Thread, labels: NDArray[np.uint8], muscle: np.uint8, out_layers: NDArray[np.int32]
) -> None:
    """Number of layers from the wall to the foremost muscle over each [y, z], 0 if none."""
    for j in share(thread, 0, labels.shape[1]):
        for i in range(labels.shape[0]):
            for k in range(labels.shape[2]):
                if labels[i, j, k] == muscle:
                    out_layers[j, k] = i + 1


@parallel_kernel
def copy_held(
    thread: Thread,
    depth: CoarseDepth,
    box: NDArray[np.int64],
    voxel_mm: np.float32,
    cover_mm: np.float32,
    standing: np.float32,
    fronts: NDArray[np.int32],
    names: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    first: NDArray[np.int64],
    out_held: NDArray[np.uint8],
) -> None:
    """Copy labels from [0, first, first] on, with air outside of the held breast, skin just inside.

    Muscle less than `cover_mm` below that skin becomes fat, and so does muscle beyond the part
    `standing` of the layers up to its front, `fronts` [y, z]. `names` are the labels of skin,
    nipple, muscle and fat. Only `box` (3, 2) is changed otherwise; the nipple stays.
    """
    skin, nipple, muscle, fat = names[0], names[1], names[2], names[3]
    for i in share(thread, 0, labels.shape[0]):
        line = np.empty(depth.mm.shape[2], np.float32)
        for j in range(first[0], first[0] + out_held.shape[1]):
            inside = box[0, 0] <= i < box[0, 1] and box[1, 0] <= j < box[1, 1]
            layer = np.float32(i + 0.5 + even_shift(i, j))
            moved = np.float32(0.0)
            if inside:
                moved = _depth_of_column(depth, i, j, voxel_mm, line)
            for k in range(first[1], first[1] + out_held.shape[2]):
                label = labels[i, j, k]
                if label == muscle and layer > standing * np.float32(fronts[j, k]):
                    label = fat
                kept = label == 0 or label == nipple
                if not kept and inside and box[2, 0] <= k < box[2, 1]:
                    here = _depth_at(depth, line, moved, k)
                    if here < 0.0:
                        label = np.uint8(0)
                    elif here < depth.skin_mm:
                        label = skin
                    elif here < cover_mm and label == muscle:
                        label = fat
                out_held[i, j - first[0], k - first[1]] = label


@parallel_kernel
def count_left_out(
    thread: Thread,
    depth: CoarseDepth,
    along_y_mm: NDArray[np.float64],
    along_z_mm: NDArray[np.float64],
    labels: NDArray[np.uint8],
    out_counts: NDArray[np.int64],
) -> None:
    """Add to `out_counts` [x, 256] the labels outside of the held breast, away from the open end.

    Those are voxels at which `along_y_mm` [y] and `along_z_mm` [z], the way to the open end, have a
    negative sum.
    """
    for i in share(thread, 0, labels.shape[0]):
        line = np.empty(depth.mm.shape[2], np.float32)
        for j in range(labels.shape[1]):
            loaded = False
            for k in range(labels.shape[2]):
                label = labels[i, j, k]
                if label == 0 or along_y_mm[j] + along_z_mm[k] >= 0.0:
                    continue
                if not loaded:
                    _depth_of_column(depth, i, j, np.float32(0.0), line)
                    loaded = True
                if _depth_at(depth, line, np.float32(0.0), k) < 0.0:
                    out_counts[i, label] += 1
