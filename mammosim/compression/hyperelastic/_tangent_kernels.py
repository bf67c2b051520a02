"""Kernels that assemble the tangent stiffness of the elements into block stencils.

``stencil[x, y, 9 o + 3 r + c, z]`` couples displacement r of a node to displacement c of its
neighbour o, one of the 14 from the node itself onwards in the order ``9 (dx+1) + 3 (dy+1) +
(dz+1)``; the other 13 blocks are the transposes of those of the neighbours. Loops over the nine
entries of a block end where the stencil's shape says, as in `_block_kernels`.
"""

import numpy as np

from mammosim._jit import (
    alternating_kernel,
    contracting_kernel,
    inlined_kernel,
    merged_kernel,
    share,
)
from mammosim.compression.hyperelastic._element_kernels import (
    CENTRE_VOLUME,
    CORNER_VOLUME,
    cross,
    determinant,
    squared,
    volume_penalty,
)
from mammosim.compression.hyperelastic.laws._law_kernels import law_curvature

X, Y, Z = np.intp(0), np.intp(3), np.intp(6)
"""First of the three rows of a vector along each edge."""

XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ = (np.intp(first) for first in range(0, 81, 9))
"""First of the nine rows of each block of a point's second derivative."""

STRIDE = 48
"""Elements of a row that are worked on together, and the distance of rows in a tile's buffers."""


@contracting_kernel
def _corner_edges(columns, a, b, c, count, edges):
    """The three edges that meet in a corner, ``edges[3 i + d, k]``."""
    low_x, low_y, low_z = 3 * b, 6 * a, 6 * a + 3 * b
    layer, above, zero, one = np.uint64(c), np.uint64(1), np.float32(0.0), np.float32(1.0)
    for d in range(3):
        for k in range(np.uint64(0), np.uint64(count)):
            p = k + layer
            edges[_at(d, k)] = columns[6 + low_x + d, p] - columns[low_x + d, p]
            edges[_at(3 + d, k)] = columns[3 + low_y + d, p] - columns[low_y + d, p]
            edges[_at(6 + d, k)] = columns[low_z + d, k + above] - columns[low_z + d, k]
        for k in range(np.uint64(0), np.uint64(count)):
            edges[_at(d, k)] += one if d == 0 else zero
            edges[_at(3 + d, k)] += one if d == 1 else zero
            edges[_at(6 + d, k)] += one if d == 2 else zero


@inlined_kernel
def _at(row, k):
    """Place of element k in a row of a flat buffer; the compiler knows how far rows are apart."""
    return np.uint64(row * STRIDE) + k


@inlined_kernel
def _vector(rows, first, k):
    return rows[_at(first, k)], rows[_at(first + 1, k)], rows[_at(first + 2, k)]


@contracting_kernel
def _add_volume(edges, weight, count, signs, volume, gradient):
    """Add a point's part of the volume, and of its derivative by node n, ``gradient[3 n + d]``."""
    cofactors = np.empty(9 * STRIDE, np.float32)
    for k in range(np.uint64(0), np.uint64(count)):
        x, y, z = _vector(edges, X, k), _vector(edges, Y, k), _vector(edges, Z, k)
        volume[k] += weight * determinant(x, y, z)
        _store(cofactors, X, k, cross(y, z))
        _store(cofactors, Y, k, cross(z, x))
        _store(cofactors, Z, k, cross(x, y))
    for node in range(8):
        for i in range(3):
            if signs[node, i] != 0.0:
                factor = np.float32(weight * signs[node, i])
                for d in range(3):
                    target, row = gradient[3 * node + d], np.uint64((3 * i + d) * STRIDE)
                    for k in range(np.uint64(0), np.uint64(count)):
                        target[k] += factor * cofactors[row + k]


@inlined_kernel
def _store(rows, first, k, a):
    rows[_at(first, k)] = a[0]
    rows[_at(first + 1, k)] = a[1]
    rows[_at(first + 2, k)] = a[2]


@inlined_kernel
def _block(out, first, k, a, b, d, c_i, c_j, f_i, f_j):
    """``a C_i C_j^T - b (C_i F_j^T + F_i C_j^T) + d F_i F_j^T`` (d may be None)."""
    left = (a * c_i[0] - b * f_i[0], a * c_i[1] - b * f_i[1], a * c_i[2] - b * f_i[2])
    right = (b * c_i[0], b * c_i[1], b * c_i[2])
    out[_at(first, k)] = left[0] * c_j[0] - right[0] * f_j[0]
    out[_at(first + 1, k)] = left[0] * c_j[1] - right[0] * f_j[1]
    out[_at(first + 2, k)] = left[0] * c_j[2] - right[0] * f_j[2]
    out[_at(first + 3, k)] = left[1] * c_j[0] - right[1] * f_j[0]
    out[_at(first + 4, k)] = left[1] * c_j[1] - right[1] * f_j[1]
    out[_at(first + 5, k)] = left[1] * c_j[2] - right[1] * f_j[2]
    out[_at(first + 6, k)] = left[2] * c_j[0] - right[2] * f_j[0]
    out[_at(first + 7, k)] = left[2] * c_j[1] - right[2] * f_j[1]
    out[_at(first + 8, k)] = left[2] * c_j[2] - right[2] * f_j[2]
    if d is not None:
        for r in range(3):
            for c in range(3):
                out[_at(first + 3 * r + c, k)] += d * f_i[r] * f_j[c]


@inlined_kernel
def _add_skew(out, first, k, f):
    """Add the matrix of the cross product with f, nine rows of `out`."""
    out[_at(first + 1, k)] -= f[2]
    out[_at(first + 2, k)] += f[1]
    out[_at(first + 3, k)] += f[2]
    out[_at(first + 5, k)] -= f[0]
    out[_at(first + 6, k)] -= f[1]
    out[_at(first + 7, k)] += f[0]


@inlined_kernel
def _add_diagonal(out, first, k, value):
    out[_at(first, k)] += value
    out[_at(first + 4, k)] += value
    out[_at(first + 8, k)] += value


@contracting_kernel
def _point_hessian(edges, law, shear, pressure, weight, volume_weight, rule, geometric, count, out):
    """Second derivative of a point's energy by its edges, blocks xx, xy, xz, yy, yz, zz.

    All of the law's part but its last term is positive definite (`law_curvature`). That term and
    the pressure's ``p dF:dC``, which may be negative, are scaled by `geometric`.
    """
    local_part = np.float32(rule.local_part)
    for k in range(np.uint64(0), np.uint64(count)):
        x, y, z = _vector(edges, X, k), _vector(edges, Y, k), _vector(edges, Z, k)
        cx, cy, cz = cross(y, z), cross(z, x), cross(x, y)
        volume = determinant(x, y, z)
        _, push, stiffness = volume_penalty(volume, rule.least_volume)
        scale, along_c, a, b, d = law_curvature(law, weight * shear[k], squared(x, y, z), volume)
        local = local_part * shear[k]
        a += volume_weight * local * np.float32(stiffness)
        s = geometric * (volume_weight * (pressure[k] + local * np.float32(push)) + along_c)
        _block(out, XX, k, a, b, d, cx, cx, x, x)
        _block(out, XY, k, a, b, d, cx, cy, x, y)
        _block(out, XZ, k, a, b, d, cx, cz, x, z)
        _block(out, YY, k, a, b, d, cy, cy, y, y)
        _block(out, YZ, k, a, b, d, cy, cz, y, z)
        _block(out, ZZ, k, a, b, d, cz, cz, z, z)
        _add_diagonal(out, XX, k, scale)
        _add_diagonal(out, YY, k, scale)
        _add_diagonal(out, ZZ, k, scale)
        _add_skew(out, XY, k, (-s * z[0], -s * z[1], -s * z[2]))
        _add_skew(out, XZ, k, (s * y[0], s * y[1], s * y[2]))
        _add_skew(out, YZ, k, (-s * x[0], -s * x[1], -s * x[2]))


@merged_kernel
def _fill_transposed(rows, source, target, count):
    """The block at `target` is the transpose of that at `source`."""
    for r in range(3):
        for c in range(3):
            for k in range(np.uint64(0), np.uint64(count)):
                rows[_at(target + 3 * r + c, k)] = rows[_at(source + 3 * c + r, k)]


@merged_kernel
def _add_rows(factor, source, first, target, start, size):
    """``target[start:] += factor source[first:]``, `size` numbers; both are flat."""
    a, b = np.uint64(first), np.uint64(start)
    for k in range(np.uint64(0), np.uint64(size)):
        target[b + k] += factor * source[a + k]


@contracting_kernel
def _add_pairs(hessian, signs, size, half, matrix):
    """Add B^T H B of one point to the matrix of the element, all flat.

    ``hessian[3 i + j]``, ``half[j]`` and ``matrix[pair]`` are blocks of `size` numbers; pairs of
    nodes are counted as in `_flush`.
    """
    pair = 0
    for node in range(8):
        if signs[node, 0] == 0.0 and signs[node, 1] == 0.0 and signs[node, 2] == 0.0:
            pair += 8 - node
            continue
        for k in range(np.uint64(0), np.uint64(3 * size)):
            half[k] = np.float32(0.0)
        for i in range(3):
            if signs[node, i] != 0.0:
                _add_rows(np.float32(signs[node, i]), hessian, 3 * i * size, half, 0, 3 * size)
        for other in range(node, 8):
            start = np.uint64(pair * size)
            pair += 1
            if signs[other, 0] != 0.0 and signs[other, 1] != 0.0 and signs[other, 2] != 0.0:
                sx, sy = np.float32(signs[other, 0]), np.float32(signs[other, 1])
                sz, y, z = np.float32(signs[other, 2]), np.uint64(size), np.uint64(2 * size)
                for k in range(np.uint64(0), np.uint64(size)):
                    matrix[start + k] += sx * half[k] + sy * half[y + k] + sz * half[z + k]
                continue
            for j in range(3):
                if signs[other, j] != 0.0:
                    _add_rows(np.float32(signs[other, j]), half, j * size, matrix, start, size)


@contracting_kernel
def _flush(matrix, gradient, bulk, start, count, i, j, first, stencil):
    """Add the matrices and kappa g g^T of one row's elements to the stencils of their nodes.

    They are `count` elements of a tile, from `start` on, and of a row, from `first` on.
    `matrix` is [pair, entry, element], pairs of nodes in the order (0, 0), (0, 1) .. (7, 7); g is
    the derivative of the elements' volume by their nodes.
    """
    pair, begin = 0, np.uint64(start)
    for node in range(8):
        shift = np.uint64(first + node % 2)
        rows = stencil[i + node // 4, j + (node // 2) % 2]
        for other in range(node, 8):
            offset = 9 * _offset(node, other)
            for entry in range(stencil.shape[2] // 14):
                target, own = rows[offset + entry], matrix[pair, entry]
                left, right = gradient[3 * node + entry // 3], gradient[3 * other + entry % 3]
                for k in range(np.uint64(0), np.uint64(count)):
                    n = begin + k
                    target[k + shift] += own[n] + bulk[n] * left[n] * right[n]
            pair += 1


@contracting_kernel
def _offset(node, other):
    """Number of the stencil's neighbour that leads from one node of an element to a later one."""
    dx = other // 4 - node // 4
    dy = (other // 2) % 2 - (node // 2) % 2
    dz = other % 2 - node % 2
    return 9 * dx + 3 * dy + dz


@contracting_kernel
def _corner_signs(a, b, c, signs):
    """Derivative of a corner's edges by the element's nodes."""
    signs[:] = 0.0
    corner = 4 * a + 2 * b + c
    for i in range(3):
        step = 4 >> i
        far = corner ^ step
        sign = 1.0 if far > corner else -1.0
        signs[far, i] = sign
        signs[corner, i] = -sign


@contracting_kernel
def _centre_signs(signs):
    """Derivative of the mean edges by the element's nodes."""
    for node in range(8):
        for i in range(3):
            signs[node, i] = 0.25 if node & (4 >> i) else -0.25


@contracting_kernel
def _point_edges(columns, point, count, signs, edges, corner):
    """Edges and signs of a point: its corner's, or for point 8 the centre's."""
    if point < 8:
        a, b, c = point // 4, (point // 2) % 2, point % 2
        _corner_signs(a, b, c, signs)
        _corner_edges(columns, a, b, c, count, edges)
        return
    _centre_signs(signs)
    for k in range(np.uint64(0), np.uint64(edges.size)):
        edges[k] = np.float32(0.0)
    quarter = np.float32(0.125)
    for other in range(8):
        _corner_edges(columns, other // 4, (other // 2) % 2, other % 2, count, corner)
        for k in range(np.uint64(0), np.uint64(edges.size)):
            edges[k] += quarter * corner[k]


@merged_kernel
def _tile_tangent(columns, shear, bulk, rule, law, geometric, i, parts, number, count, stencil):
    """Assemble one tile of elements, of `number` parts of rows."""
    edges, corner = np.zeros(9 * STRIDE, np.float32), np.zeros(9 * STRIDE, np.float32)
    hessian, gradient = np.zeros(81 * STRIDE, np.float32), np.zeros((24, STRIDE), np.float32)
    matrix, half = np.zeros((36, 9, STRIDE), np.float32), np.empty(27 * STRIDE, np.float32)
    volume, pressure = np.zeros(STRIDE, np.float32), np.empty(STRIDE, np.float32)
    signs, corner_weight = np.empty((8, 3)), rule.corner_weight
    for point in range(9):
        part = CENTRE_VOLUME if point == 8 else CORNER_VOLUME
        _point_edges(columns, point, count, signs, edges, corner)
        _add_volume(edges, np.float32(part), count, signs, volume, gradient)
    mean_bulk = np.empty(STRIDE, np.float32)
    for k in range(count):
        mean_bulk[k] = bulk[k] - np.float32(rule.local_part) * shear[k]
        pressure[k] = mean_bulk[k] * (volume[k] - np.float32(1.0))
    for point in range(9):
        part = CENTRE_VOLUME if point == 8 else CORNER_VOLUME
        weight = 1.0 - 8.0 * corner_weight if point == 8 else corner_weight
        _point_edges(columns, point, count, signs, edges, corner)
        _point_hessian(
            edges, law, shear, pressure, np.float32(weight), np.float32(part), rule,
            np.float32(geometric), count, hessian,
        )  # fmt: skip
        _fill_transposed(hessian, XY, YX, count)
        _fill_transposed(hessian, XZ, ZX, count)
        _fill_transposed(hessian, YZ, ZY, count)
        _add_pairs(hessian, signs, 9 * STRIDE, half, matrix.reshape(324 * STRIDE))
    for n in range(number):
        start, size, j, first = parts[n, 0], parts[n, 1], parts[n, 2], parts[n, 3]
        _flush(matrix, gradient, mean_bulk, start, size, i, j, first, stencil)


@merged_kernel
def _pack_part(u, shear, bulk, i, j, first, start, count, columns, moduli):
    """Displacements and moduli of `count` elements of a row into a tile, from `start` on."""
    begin, source = np.uint64(start), np.uint64(first)
    for row in range(12):
        own, target = u[row % 3, i + row // 6, j + (row // 3) % 2], columns[row]
        for k in range(np.uint64(0), np.uint64(count + 1)):
            target[begin + k] = own[source + k]
    for k in range(count):
        moduli[0, start + k] = shear[i, j, first + k]
        moduli[1, start + k] = bulk[i, j, first + k]


@alternating_kernel
def tangent_stencil(thread, u, shear, bulk, span, rule, law, geometric, out):
    """Tangent stiffness of all elements, added to the stencil `out`.

    `rule` and `law` are as in `energy_and_forces`. `geometric`, 0 to 1, scales the terms that may
    make it indefinite. A tile takes rows, or parts of them, until it is full; between two rows is
    a place without an element, whose moduli are 0.
    """
    for i in share(thread, 0, u.shape[1] - 1):
        columns = np.empty((12, STRIDE + 1), np.float32)
        moduli = np.zeros((2, STRIDE), np.float32)
        parts, number, used = np.empty((STRIDE, 4), np.int64), 0, 0
        for j in range(u.shape[2]):
            # One turn more than there are rows: the last tile is worked on where they end.
            first, last = (span[i, j, 0], span[i, j, 1]) if j < u.shape[2] - 1 else (0, 0)
            while first < last or (j == u.shape[2] - 1 and number > 0):
                count = min(STRIDE - used, last - first)
                if count > 0:
                    _pack_part(u, shear, bulk, i, j, first, used, count, columns, moduli)
                    parts[number, 0], parts[number, 1] = used, count
                    parts[number, 2], parts[number, 3] = j, first
                    number, first, used = number + 1, first + count, used + count + 1
                if used < STRIDE - 1 and j < u.shape[2] - 1:
                    continue
                _tile_tangent(
                    columns, moduli[0], moduli[1], rule, law, geometric, i, parts, number,
                    min(used, STRIDE), out,
                )  # fmt: skip
                moduli[:] = np.float32(0.0)
                number = used = 0
