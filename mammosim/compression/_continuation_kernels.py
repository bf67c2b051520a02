"""Kernel that continues a field from tissue nodes into the air around them."""

import numpy as np

from mammosim._jit import parallel_kernel, share


@parallel_kernel
def continue_one_layer(thread, field, layer, number):
    """Give nodes of `layer` 0 that touch a lower layer the mean of those neighbours.

    `layer` is 1 in tissue and 0 where nothing is known; nodes reached become `number`, and only
    neighbours with a layer below `number` are read, so that the order of visits does not matter.
    `field` is [component, x, y, z].
    """
    nx, ny, nz = layer.shape
    for i in share(thread, 0, nx):
        near = np.zeros(nz + 2, np.int32)  # known neighbours in the nine rows around; a rim of none
        for j in range(ny):
            near[:] = 0
            for a in range(max(i - 1, 0), min(i + 2, nx)):
                for b in range(max(j - 1, 0), min(j + 2, ny)):
                    for k in range(nz):
                        near[k + 1] += np.int32(0 < layer[a, b, k] < number)
            for k in range(nz):
                if layer[i, j, k] != 0 or near[k] + near[k + 1] + near[k + 2] == 0:
                    continue
                known = 0
                for a in range(max(i - 1, 0), min(i + 2, nx)):
                    for b in range(max(j - 1, 0), min(j + 2, ny)):
                        for c in range(max(k - 1, 0), min(k + 2, nz)):
                            if 0 < layer[a, b, c] < number:
                                known += 1
                                for f in range(field.shape[0]):
                                    field[f, i, j, k] += field[f, a, b, c]
                layer[i, j, k] = number
                for f in range(field.shape[0]):
                    field[f, i, j, k] /= known


@parallel_kernel
def extrapolate_one_layer(thread, field, layer, number):
    """Give nodes of `layer` 0 the mean of what lines of two known nodes along the axes lead to.

    As `continue_one_layer`, for a field that goes on as it comes; nodes at which no such line ends
    are left for that.
    """
    for i in share(thread, 0, layer.shape[0]):
        total = np.empty(field.shape[0])
        for j in range(layer.shape[1]):
            for k in range(layer.shape[2]):
                if layer[i, j, k] != 0:
                    continue
                lines = 0
                total[:] = 0.0
                for line in range(6):
                    step = 1 - 2 * (line % 2)
                    a, b, c = step * (line // 2 == 0), step * (line // 2 == 1), step * (line >= 4)
                    if not (
                        0 <= i + 2 * a < layer.shape[0]
                        and 0 <= j + 2 * b < layer.shape[1]
                        and 0 <= k + 2 * c < layer.shape[2]
                    ):
                        continue
                    near, far = layer[i + a, j + b, k + c], layer[i + 2 * a, j + 2 * b, k + 2 * c]
                    if 0 < near < number and 0 < far < number:
                        lines += 1
                        for f in range(field.shape[0]):
                            total[f] += 2.0 * field[f, i + a, j + b, k + c]
                            total[f] -= field[f, i + 2 * a, j + 2 * b, k + 2 * c]
                if lines > 0:
                    layer[i, j, k] = number
                    for f in range(field.shape[0]):
                        field[f, i, j, k] = total[f] / lines
