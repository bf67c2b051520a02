"""Kernel that leaves out of a phantom's labels what a view does not hold between the plates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, parallel_kernel, share
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


@parallel_kernel
def leave_out(
    thread: Thread,
    depth: CoarseDepth,
    box: NDArray[np.int64],
    voxel_mm: np.float32,
    cover_mm: np.float32,
    names: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    out_rows: NDArray[np.bool_],
    out_columns: NDArray[np.bool_],
) -> None:
    """Turn tissue outside of the held breast into air, and that just inside into skin.

    Muscle less than `cover_mm` below that skin becomes fat. `names` are the labels of skin, nipple,
    muscle and fat. Only `box` (3, 2) is looked at for that; the nipple stays. `out_rows` [x, y] and
    `out_columns` [x, z] become true where tissue is left. The surface is moved by half a voxel to
    either side, column by column, so that it draws no contour lines.
    """
    skin, nipple, muscle, fat = names[0], names[1], names[2], names[3]
    coarse = depth.mm
    for i in share(thread, 0, labels.shape[0]):
        line = np.empty(coarse.shape[2], np.float32)
        low_x, part_x = depth.cells_x[i], depth.part_x[i]
        for j in range(labels.shape[1]):
            if box[0, 0] <= i < box[0, 1] and box[1, 0] <= j < box[1, 1]:
                low_y, part_y = depth.cells_y[j], depth.part_y[j]
                for k in range(coarse.shape[2]):
                    below, above = coarse[low_x, low_y, k], coarse[low_x, low_y + 1, k]
                    below += part_x * (coarse[low_x + 1, low_y, k] - below)
                    above += part_x * (coarse[low_x + 1, low_y + 1, k] - above)
                    line[k] = below + part_y * (above - below)
                moved = voxel_mm * np.float32(even_shift(i, j))
                for k in range(box[2, 0], box[2, 1]):
                    if labels[i, j, k] == 0 or labels[i, j, k] == nipple:
                        continue
                    low_z = depth.cells_z[k]
                    here = line[low_z] + depth.part_z[k] * (line[low_z + 1] - line[low_z]) + moved
                    if here < 0.0:
                        labels[i, j, k] = 0
                    elif here < depth.skin_mm:
                        labels[i, j, k] = skin
                    elif here < cover_mm and labels[i, j, k] == muscle:
                        labels[i, j, k] = fat
            some = False
            for k in range(labels.shape[2]):
                if labels[i, j, k] != 0:
                    some = True
                    out_columns[i, k] = True
            out_rows[i, j] = some
