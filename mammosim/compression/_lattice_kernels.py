"""Kernel that gathers a phantom's fine voxels into the nodes of the mechanical lattice."""

import numpy as np

from mammosim._jit import kernel, parallel_kernel, share


@parallel_kernel
def gather_blocks(
    thread, labels, modulus_of, muscle_of, to_voxel, samples, fraction, modulus, muscle
):
    """Tissue fraction, mean modulus of the tissue, and muscle's part of it, in each node's block.

    A node's block is sampled at ``samples ** 3`` points. `to_voxel` is (3, 4): it takes lattice
    indices to fractional voxel indices of `labels`, and turns about x alone. `modulus_of` and
    `muscle_of` are tables over labels; air has modulus 0. Outputs are 0 where a block holds no
    tissue.
    """
    nx, ny, nz = labels.shape
    layers = np.empty((fraction.shape[0], samples), np.int64)
    for i in range(fraction.shape[0]):
        for a in range(samples):
            layers[i, a] = _row(to_voxel, 0, i + (a + 0.5) / samples - 0.5, 0.0, 0.0)
    places = np.empty((2, samples**2), np.uint64)
    for j in share(thread, 0, fraction.shape[1]):
        for k in range(fraction.shape[2]):
            count = 0
            for b in range(samples):
                q = j + (b + 0.5) / samples - 0.5
                for c in range(samples):
                    r = k + (c + 0.5) / samples - 0.5
                    y, z = _row(to_voxel, 1, 0.0, q, r), _row(to_voxel, 2, 0.0, q, r)
                    if 0 <= y < ny and 0 <= z < nz:
                        places[0, count], places[1, count] = y, z
                        count += 1
            for i in range(fraction.shape[0]):
                tissue, muscles, total = 0, 0, 0.0
                for a in range(samples):
                    if not 0 <= layers[i, a] < nx:
                        continue
                    layer = labels[layers[i, a]]
                    for n in range(count):
                        label = layer[places[0, n], places[1, n]]
                        if modulus_of[label] > 0.0:
                            tissue += 1
                            total += modulus_of[label]
                            muscles += muscle_of[label]
                if tissue > 0:
                    fraction[i, j, k] = tissue / samples**3
                    modulus[i, j, k] = total / tissue
                    muscle[i, j, k] = muscles / tissue


@parallel_kernel
def tissue_outline(thread, labels, out):
    """``out[y, z]`` is true where any voxel along x is tissue."""
    for j in share(thread, 0, labels.shape[1]):
        for i in range(labels.shape[0]):
            for k in range(labels.shape[2]):
                if labels[i, j, k] != 0:
                    out[j, k] = True


@kernel
def _row(matrix, row, p, q, r):
    """Nearest voxel index along one axis of a lattice place."""
    return int(
        np.floor(
            matrix[row, 0] * p + matrix[row, 1] * q + matrix[row, 2] * r + matrix[row, 3] + 0.5
        )
    )
