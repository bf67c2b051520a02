"""The breast's outline in coarse voxels, with patches of gland in place of what is inside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel
from mammosim.phantom.anatomy._block_kernels import (
    ADIPOSE,
    GLAND,
    MUSCLE,
    NIPPLE,
    SKIN,
    Lattice,
    Paint,
)
from mammosim.phantom.anatomy._noise_kernels import lattice_hash
from mammosim.phantom.anatomy._surface_kernels import areola, beyond_cut, in_nipple, in_root


@kernel
def paint_outline(
    labels: NDArray[np.uint8], lattice: Lattice, paint: Paint, depth_mm: NDArray[np.float64],
    muscle_mm: NDArray[np.float64], gland: NDArray[np.float64], skin_mm: float,
    muscle_fat: float,
) -> None:  # fmt: skip
    """Skin, nipple, muscle, gland where its potential exceeds the threshold, and fat elsewhere.

    `muscle_fat` is the share of fat within muscle.
    """
    for i in range(labels.shape[0]):
        x = lattice.x_mm[i]
        for j in range(labels.shape[1]):
            y = lattice.lateral_mm[j]
            for k in range(labels.shape[2]):
                z = lattice.superior_mm[k]
                if beyond_cut(paint, y, z):
                    continue
                depth = depth_mm[i, j, k]
                thick = skin_mm + areola(paint, y, z)
                if depth < thick:
                    if in_nipple(x, y, z, depth, thick, paint.nipple):
                        labels[i, j, k] = paint.labels[NIPPLE]
                    elif depth >= 0.0:
                        labels[i, j, k] = paint.labels[SKIN]
                elif in_root(x, y, z, depth - thick, paint.nipple):
                    labels[i, j, k] = paint.labels[NIPPLE]
                elif depth > paint.cover_mm and muscle_mm[i, j, k] > 0.0:
                    fat = lattice_hash(i, j, k, 0) / 4294967296.0 < muscle_fat
                    labels[i, j, k] = paint.labels[ADIPOSE if fat else MUSCLE]
                elif gland[i, j, k] > paint.threshold:
                    labels[i, j, k] = paint.labels[GLAND]
                else:
                    labels[i, j, k] = paint.labels[ADIPOSE]
