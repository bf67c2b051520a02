"""Compiled count of a phantom's labels, layer by layer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, parallel_kernel, share


@parallel_kernel
def count_labels(thread: Thread, labels: NDArray[np.uint8], out_counts: NDArray[np.int64]) -> None:
    """Add to `out_counts` [x, 256] how many voxels of each label each layer of constant x holds.

    Voxels of one label in a row are counted together.
    """
    nx, ny, nz = labels.shape
    for x in share(thread, 0, nx):
        for y in range(ny):
            label, first = labels[x, y, 0], 0
            for z in range(1, nz):
                if labels[x, y, z] != label:
                    out_counts[x, label] += z - first
                    label, first = labels[x, y, z], z
            out_counts[x, label] += nz - first
