"""Kernels of the finite elements: energy and force of trilinear hexahedra, one a voxel.

Lengths are in units of the element's edge, moduli in kPa, so that energies are in kPa times the
element's volume. Node ``[i, j, k]`` has the displacement ``u[:, i, j, k]``; element ``[i, j, k]``
lies between nodes i and i + 1, and so on. ``span[i, j]`` bounds the elements of a row along z.

The deviatoric energy is integrated with the centre and the eight corners, where the deformation
gradient is made of the element's edges alone. Its columns are the edges e_x, e_y, e_z that meet in
the corner; at the centre they are the mean of the four parallel edges. Weights 2/3 and 1/24
integrate every quadratic exactly, and the volume of a trilinear hexahedron too: J has no monomial
of even degree beyond the squares.

The energy of a change of shape is a law's (`laws`). Of the bulk modulus, `local_part` shear moduli
act at each of the nine points, by a penalty that is a barrier against folding; the rest acts on the
mean over the element, so that nothing locks.
"""

from typing import NamedTuple

import numpy as np

from mammosim._jit import (
    alternating_kernel,
    contracting_parallel_kernel,
    inlined_kernel,
    merged_kernel,
    share,
)
from mammosim.compression.hyperelastic.laws._law_kernels import law_stress

CENTRE_VOLUME = 2.0 / 3.0
CORNER_VOLUME = 1.0 / 24.0
"""Parts of an element's volume that its centre and each of its eight corners stand for."""

TILE = 64
"""Elements of a row that are worked on together, from buffers that stay in the nearest cache."""

LOW, HIGH = np.intp(0), np.intp(1)
"""Side of an element along an axis."""

NODE = tuple(np.intp(3 * node) for node in range(8))
"""First of the three rows of each node's force."""

_ONE = np.uint64(1)


class ElementRule(NamedTuple):
    """How an element's energy is summed: see the constants of these names in `body`."""

    corner_weight: float
    local_part: float
    least_volume: float


@inlined_kernel
def determinant(a, b, c):
    """a . (b x c)."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@inlined_kernel
def cross(a, b):
    """a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inlined_kernel
def squared(a, b, c):
    """I1, the sum of the squares of all components."""
    return (
        a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
        + b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
        + c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    )  # fmt: skip


@inlined_kernel
def volume_penalty(volume, least):
    """(J - 1)^2 / (2 J) and its first two derivatives, continued by its parabola below `least`.

    It is that of a bulk modulus of 1 for small changes of volume, and a barrier against folding.
    """
    bounded = max(volume, least)
    inverse = 1.0 / bounded
    value = 0.5 * (bounded - 1.0) * (bounded - 1.0) * inverse
    slope = 0.5 - 0.5 * inverse * inverse
    curvature = inverse * inverse * inverse
    below = volume - bounded
    return (
        value + below * (slope + 0.5 * below * curvature),
        slope + below * curvature,
        curvature,
    )


@inlined_kernel
def edge_x(columns, k, b):
    """Edge along x of element k of a tile at corner (., b, .) of the node layer k."""
    p, q = 3 * b, 6 + 3 * b
    return (
        1.0 + (columns[q, k] - columns[p, k]),
        columns[q + 1, k] - columns[p + 1, k],
        columns[q + 2, k] - columns[p + 2, k],
    )


@inlined_kernel
def edge_y(columns, k, a):
    """Edge along y of element k of a tile at corner (a, ., .) of the node layer k."""
    p, q = 6 * a, 6 * a + 3
    return (
        columns[q, k] - columns[p, k],
        1.0 + (columns[q + 1, k] - columns[p + 1, k]),
        columns[q + 2, k] - columns[p + 2, k],
    )


@inlined_kernel
def edge_z(columns, k, a, b):
    """Edge along z of element k of a tile at corner (a, b, .)."""
    p, above = 6 * a + 3 * b, k + _ONE
    return (
        columns[p, above] - columns[p, k],
        columns[p + 1, above] - columns[p + 1, k],
        1.0 + (columns[p + 2, above] - columns[p + 2, k]),
    )


@inlined_kernel
def mean_of_four(a, b, c, d):
    """Mean of four vectors."""
    return (
        0.25 * (a[0] + b[0] + c[0] + d[0]),
        0.25 * (a[1] + b[1] + c[1] + d[1]),
        0.25 * (a[2] + b[2] + c[2] + d[2]),
    )


@inlined_kernel
def _point_force(a, b, c, law, shear, pressure, weight, volume_weight, local, least):
    """Weighted first Piola-Kirchhoff stress (its columns) and energy at one point."""
    volume = determinant(a, b, c)
    shape, p, along_c = law_stress(law, weight * shear, squared(a, b, c), volume)
    penalty, push, _ = volume_penalty(volume, least)
    energy = shape + volume_weight * local * penalty
    q = along_c + volume_weight * (pressure + local * push)
    x, y, z = cross(b, c), cross(c, a), cross(a, b)
    return (
        energy,
        (p * a[0] + q * x[0], p * a[1] + q * x[1], p * a[2] + q * x[2]),
        (p * b[0] + q * y[0], p * b[1] + q * y[1], p * b[2] + q * y[2]),
        (p * c[0] + q * z[0], p * c[1] + q * z[1], p * c[2] + q * z[2]),
    )


@inlined_kernel
def _sum(a, b, c):
    """a + b + c / 4 of three vectors: an edge's force from its two corners and the centre."""
    return (
        a[0] + b[0] + 0.25 * c[0],
        a[1] + b[1] + 0.25 * c[1],
        a[2] + b[2] + 0.25 * c[2],
    )


@merged_kernel
def _tile_forces(columns, shear, bulk, rule, law, count, out):
    """Forces on the nodes of a tile of elements, the elements' energy, and their smallest J.

    `out` is [26, k]: force of node (a, b, c) along axis d in row ``3 (4 a + 2 b + c) + d``, then
    energy and smallest determinant.
    """
    corner_weight, local_part, least = rule.corner_weight, rule.local_part, rule.least_volume
    centre_weight = 1.0 - 8.0 * corner_weight
    for k in range(np.uint64(0), np.uint64(count)):
        above = k + _ONE
        x00, x01 = edge_x(columns, k, LOW), edge_x(columns, above, LOW)
        x10, x11 = edge_x(columns, k, HIGH), edge_x(columns, above, HIGH)
        y00, y01 = edge_y(columns, k, LOW), edge_y(columns, above, LOW)
        y10, y11 = edge_y(columns, k, HIGH), edge_y(columns, above, HIGH)
        z00, z01 = edge_z(columns, k, LOW, LOW), edge_z(columns, k, LOW, HIGH)
        z10, z11 = edge_z(columns, k, HIGH, LOW), edge_z(columns, k, HIGH, HIGH)
        xm = mean_of_four(x00, x01, x10, x11)
        ym = mean_of_four(y00, y01, y10, y11)
        zm = mean_of_four(z00, z01, z10, z11)
        j000, j001 = determinant(x00, y00, z00), determinant(x01, y01, z00)
        j010, j011 = determinant(x10, y00, z01), determinant(x11, y01, z01)
        j100, j101 = determinant(x00, y10, z10), determinant(x01, y11, z10)
        j110, j111 = determinant(x10, y10, z11), determinant(x11, y11, z11)
        centre = determinant(xm, ym, zm)
        volume = CENTRE_VOLUME * centre + CORNER_VOLUME * (
            j000 + j001 + j010 + j011 + j100 + j101 + j110 + j111
        )
        out[25, k] = min(
            min(min(min(j000, j001), min(j010, j011)), min(min(j100, j101), min(j110, j111))),
            centre,
        )
        mu = shear[k]
        local = local_part * mu
        p = (bulk[k] - local) * (volume - 1.0)
        w, v = corner_weight, CORNER_VOLUME
        em, xc, yc, zc = _point_force(
            xm, ym, zm, law, mu, p, centre_weight, CENTRE_VOLUME, local, least
        )
        e0, xa, ya, za = _point_force(x00, y00, z00, law, mu, p, w, v, local, least)
        e1, xb, yb, zb = _point_force(x01, y01, z00, law, mu, p, w, v, local, least)
        e2, xd, yd, zd = _point_force(x10, y00, z01, law, mu, p, w, v, local, least)
        e3, xe, ye, ze = _point_force(x11, y01, z01, law, mu, p, w, v, local, least)
        e4, xf, yf, zf = _point_force(x00, y10, z10, law, mu, p, w, v, local, least)
        e5, xg, yg, zg = _point_force(x01, y11, z10, law, mu, p, w, v, local, least)
        e6, xh, yh, zh = _point_force(x10, y10, z11, law, mu, p, w, v, local, least)
        e7, xi, yi, zi = _point_force(x11, y11, z11, law, mu, p, w, v, local, least)
        out[24, k] = 0.5 * p * (volume - 1.0) + em + (e0 + e1 + e2 + e3) + (e4 + e5 + e6 + e7)
        x00, x01, x10, x11 = _sum(xa, xf, xc), _sum(xb, xg, xc), _sum(xd, xh, xc), _sum(xe, xi, xc)
        y00, y01, y10, y11 = _sum(ya, yd, yc), _sum(yb, ye, yc), _sum(yf, yh, yc), _sum(yg, yi, yc)
        z00, z01, z10, z11 = _sum(za, zb, zc), _sum(zd, ze, zc), _sum(zf, zg, zc), _sum(zh, zi, zc)
        _store(out, k, NODE[0], -1.0, x00, -1.0, y00, -1.0, z00)
        _store(out, k, NODE[1], -1.0, x01, -1.0, y01, 1.0, z00)
        _store(out, k, NODE[2], -1.0, x10, 1.0, y00, -1.0, z01)
        _store(out, k, NODE[3], -1.0, x11, 1.0, y01, 1.0, z01)
        _store(out, k, NODE[4], 1.0, x00, -1.0, y10, -1.0, z10)
        _store(out, k, NODE[5], 1.0, x01, -1.0, y11, 1.0, z10)
        _store(out, k, NODE[6], 1.0, x10, 1.0, y10, -1.0, z11)
        _store(out, k, NODE[7], 1.0, x11, 1.0, y11, 1.0, z11)


@inlined_kernel
def _store(out, k, row, p, a, q, b, r, c):
    """Force of a node: its three edges' forces with their signs."""
    out[row, k] = p * a[0] + q * b[0] + r * c[0]
    out[row + 1, k] = p * a[1] + q * b[1] + r * c[1]
    out[row + 2, k] = p * a[2] + q * b[2] + r * c[2]


@inlined_kernel
def pack(u, i, j, first, count, columns):
    """Displacements of the four columns of nodes around a tile, ``columns[3 (2 a + b) + d, k]``."""
    for row in range(12):
        source, target = u[row % 3, i + row // 6, j + (row // 3) % 2], columns[row]
        for k in range(np.uint64(0), np.uint64(count + 1)):
            target[k] = source[np.uint64(first) + k]


@inlined_kernel
def pack_moduli(shear, bulk, i, j, first, count, moduli):
    """Shear and bulk modulus of a tile of elements."""
    for k in range(count):
        moduli[0, k] = shear[i, j, first + k]
        moduli[1, k] = bulk[i, j, first + k]


@alternating_kernel
def energy_and_forces(thread, u, shear, bulk, span, rule, law, out_force, out_layers):
    """Derivative of the elastic energy by each node's displacement, added to `out_force`.

    `rule` is an `ElementRule`, `law` the NamedTuple of a tissue law. ``out_layers[i]`` is the
    energy of the elements of layer i and their smallest determinant.
    """
    for i in share(thread, 0, out_layers.shape[0]):
        columns, rows = np.empty((12, TILE + 1)), np.empty((26, TILE))
        moduli = np.empty((2, TILE))
        energy, smallest = 0.0, np.inf
        for j in range(u.shape[2] - 1):
            for first in range(span[i, j, 0], span[i, j, 1], TILE):
                count = min(TILE, span[i, j, 1] - first)
                pack(u, i, j, first, count, columns)
                pack_moduli(shear, bulk, i, j, first, count, moduli)
                _tile_forces(columns, moduli[0], moduli[1], rule, law, count, rows)
                for k in range(count):
                    energy += rows[24, k]
                    smallest = min(smallest, rows[25, k])
                for row in range(24):
                    node, d = row // 3, row % 3
                    target = out_force[d, i + node // 4, j + (node // 2) % 2]
                    source, shift = rows[row], np.uint64(first + node % 2)
                    for k in range(np.uint64(0), np.uint64(count)):
                        target[k + shift] += source[k]
        out_layers[i, 0] = energy
        out_layers[i, 1] = smallest


@contracting_parallel_kernel
def element_volumes(thread, u, span, out_volume, out_smallest):
    """Volume of each element over that at rest, and the smallest J of its nine points."""
    for i in share(thread, 0, out_volume.shape[0] - 1):
        columns, volume, smallest = np.empty((12, TILE + 1)), np.empty(TILE), np.empty(TILE)
        for j in range(out_volume.shape[1] - 1):
            for first in range(span[i, j, 0], span[i, j, 1], TILE):
                count = min(TILE, span[i, j, 1] - first)
                pack(u, i, j, first, count, columns)
                _tile_volumes(columns, count, volume, smallest)
                for k in range(count):
                    out_volume[i, j, first + k] = volume[k]
                    out_smallest[i, j, first + k] = smallest[k]


@merged_kernel
def _tile_volumes(columns, count, volume, smallest):
    """Volume and smallest J of the elements of a tile."""
    for k in range(np.uint64(0), np.uint64(count)):
        total, least, above = 0.0, np.inf, k + _ONE
        xm = ym = zm = (0.0, 0.0, 0.0)
        for a in range(2):
            for b in range(2):
                z = edge_z(columns, k, a, b)
                for layer in (k, above):
                    x, y = edge_x(columns, layer, b), edge_y(columns, layer, a)
                    corner = determinant(x, y, z)
                    total += corner
                    least = min(least, corner)
                    xm, ym, zm = _plus_eighth(xm, x), _plus_eighth(ym, y), _plus_eighth(zm, z)
        centre = determinant(xm, ym, zm)
        volume[k] = CENTRE_VOLUME * centre + CORNER_VOLUME * total
        smallest[k] = min(least, centre)


@inlined_kernel
def _plus_eighth(a, b):
    return a[0] + 0.125 * b[0], a[1] + 0.125 * b[1], a[2] + 0.125 * b[2]
