"""Kernels that count the faces of tissue that no skin covers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, parallel_kernel, share


@kernel
def _air_beside(labels: NDArray[np.uint8], i: int, j: int, k: int, way: int) -> int:
    """What lies beside a voxel towards -y, +y, -z or +z: 0 tissue, 1 air, 2 the array's end."""
    step = 2 * (way % 2) - 1
    j, k = (j + step, k) if way < 2 else (j, k + step)
    if j < 0 or k < 0 or j >= labels.shape[1] or k >= labels.shape[2]:
        return 2
    return 1 if labels[i, j, k] == 0 else 0


@parallel_kernel
def count_faces(
    thread: Thread,
    labels: NDArray[np.uint8],
    covers: NDArray[np.bool_],
    out_faces: NDArray[np.int64],
) -> None:
    """Add to `out_faces` [x, 4, 3] how many faces of tissue lead out, layer by layer.

    The second axis is towards -y, +y, -z and +z; the third tells faces of what `covers` [256] the
    breast (skin) on air, other tissue on air, and other tissue on the array's end.
    """
    nx, ny, nz = labels.shape
    for i in share(thread, 0, nx):
        for j in range(ny):
            for k in range(nz):
                if labels[i, j, k] == 0:
                    continue
                for way in range(4):
                    beside = _air_beside(labels, i, j, k, way)
                    if beside == 0:
                        continue
                    if not covers[labels[i, j, k]]:
                        out_faces[i, way, beside] += 1
                    elif beside == 1:
                        out_faces[i, way, 0] += 1


@parallel_kernel
def count_places(
    thread: Thread,
    labels: NDArray[np.uint8],
    covers: NDArray[np.bool_],
    along_y: NDArray[np.float64],
    along_z: NDArray[np.float64],
    out_places: NDArray[np.int64],
) -> None:
    """Add to `out_places` [x, place] where faces of uncovered tissue on air lie along a direction.

    A voxel's place is ``along_y[j] + along_z[k]``, rounded down.
    """
    nx, ny, nz = labels.shape
    for i in share(thread, 0, nx):
        for j in range(ny):
            for k in range(nz):
                label = labels[i, j, k]
                if label == 0 or covers[label]:
                    continue
                for way in range(4):
                    if _air_beside(labels, i, j, k, way) == 1:
                        out_places[i, int(along_y[j] + along_z[k])] += 1
