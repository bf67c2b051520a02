"""Kernel that exchanges the axes of a volume for files, in which x runs fastest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, parallel_kernel, share

BLOCK = 64
"""Side of the blocks in which axes are exchanged: 64 rows of a processor's cache at a time, since
whole columns would meet each line of it anew for every voxel."""


@parallel_kernel
def exchange_axes(thread: Thread, values: NDArray[Any], out_turned: NDArray[Any]) -> None:
    """Copy ``values`` [x, y, z] to ``out_turned`` [z, y, x]; each turn writes its own layers."""
    nx, ny, nz = values.shape
    for layers in share(thread, 0, (nz + BLOCK - 1) // BLOCK):
        low_k, high_k = layers * BLOCK, min((layers + 1) * BLOCK, nz)
        for low_i in range(0, nx, BLOCK):
            for j in range(ny):
                for k in range(low_k, high_k):
                    for i in range(low_i, min(low_i + BLOCK, nx)):
                        a, b, c = np.uint64(i), np.uint64(j), np.uint64(k)
                        out_turned[c, b, a] = values[a, b, c]
