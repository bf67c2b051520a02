"""Kernel that continues a field from tissue nodes into the air around them."""

from numba import prange

from mammosim._jit import parallel_kernel


@parallel_kernel
def continue_one_layer(field, layer, number):
    """Give nodes of `layer` 0 that touch a lower layer the mean of those neighbours.

    `layer` is 1 in tissue and 0 where nothing is known; nodes reached become `number`, and only
    neighbours with a layer below `number` are read, so that the order of visits does not matter.
    `field` is [component, x, y, z].
    """
    nx, ny, nz = layer.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                if layer[i, j, k] != 0:
                    continue
                known = 0
                for a in range(max(i - 1, 0), min(i + 2, nx)):
                    for b in range(max(j - 1, 0), min(j + 2, ny)):
                        for c in range(max(k - 1, 0), min(k + 2, nz)):
                            if 0 < layer[a, b, c] < number:
                                known += 1
                                for f in range(field.shape[0]):
                                    field[f, i, j, k] += field[f, a, b, c]
                if known > 0:
                    layer[i, j, k] = number
                    for f in range(field.shape[0]):
                        field[f, i, j, k] /= known
