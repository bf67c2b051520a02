"""Kernel of the thesis' iteration: one sweep that moves each node to its local equilibrium."""

from typing import Any, NamedTuple

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel, kernel
from mammosim.compression.plates._straight_kernels import foremost, lies_between
from mammosim.compression.springs._exponential_kernels import (
    SHORTEST,
    spring_strain,
    stiffened,
)


class Springs(NamedTuple):
    """What a sweep needs to know of the lattice; arrays are [x, y, z], see `SpringProblem`."""

    modulus: Any
    stiffening: Any
    """Enl of each node; None where springs are linear.

    A spring then has the smaller stiffness of its two nodes at its strain."""
    force: Any
    """Along x, y and z, each an array or None."""
    visited: Any
    """From `mark_nodes`."""


@contracting_kernel
def sweep(springs, x, y, z, orders, plates, chest, sums):
    """Visit every free tissue node once and move it; in place, one after another.

    `orders` are the indices along x, y and z in the order of their visit; `plates` is a
    `StraightGap` and `chest` the x of the chest wall; `x`, `y`, `z` are places in lattice units.
    `sums` receives the summed |dx|, |dy|, |dz| of the counted nodes (between the plates and
    touching neither) and their number. The step is F / W where W sums the stiffness of all 27
    terms, the node's own included; of springs that stiffen, the slope of their force.
    """
    modulus, stiffening, visited = springs.modulus, springs.stiffening, springs.visited
    force_x, force_y, force_z = springs.force
    lower, upper = plates.lower, plates.upper
    stretch = np.empty((2, 2, 2))
    length = np.empty((3, 3, 3))
    sums[:] = 0.0
    for i in orders[0]:
        between = lies_between(i, plates)
        for j in orders[1]:
            for k in orders[2]:
                if visited[i, j, k] == 0:
                    continue
                if visited[i, j, k] == 2:
                    _lengths_inside(z, i, j, k, length)
                else:
                    _cells_around(modulus, z, i, j, k, stretch)
                    _lengths_at_surface(stretch, length)
                fx, fy, fz, wx, wy, wz = _springs_force(
                    modulus, stiffening, x, y, z, i, j, k, length
                )
                dx = (fx + _outer(force_x, i, j, k)) / wx
                dy = (fy + _outer(force_y, i, j, k)) / wy
                dz = (fz + _outer(force_z, i, j, k)) / wz
                front, place = x[i, j, k] + dx, z[i, j, k] + dz
                if between:
                    place = min(max(place, lower), upper)
                else:
                    front = min(front, foremost(place, plates))
                x[i, j, k] = max(front, chest)
                y[i, j, k] += dy
                z[i, j, k] = place
                if between and lower < place < upper:
                    sums[0] += abs(dx)
                    sums[1] += abs(dy)
                    sums[2] += abs(dz)
                    sums[3] += 1.0


@contracting_kernel
def _cells_around(modulus, z, i, j, k, stretch):
    """In-plane stretch of the eight cells around a node; 0 where a cell takes no part."""
    for ci in range(2):
        for cj in range(2):
            for ck in range(2):
                total = 0.0
                edges = 0
                bottom = k - 1 + ck
                for a in range(i - 1 + ci, i + 1 + ci):
                    for b in range(j - 1 + cj, j + 1 + cj):
                        if modulus[a, b, bottom] > 0.0 and modulus[a, b, bottom + 1] > 0.0:
                            total += z[a, b, bottom + 1] - z[a, b, bottom]
                            edges += 1
                stretch[ci, cj, ck] = 1.0 / np.sqrt(max(total / edges, 0.1)) if edges else 0.0


@contracting_kernel
def _lengths_at_surface(stretch, length):
    """In-plane equilibrium length of each spring: mean of the participating cells beside it."""
    for a in range(3):
        for b in range(3):
            for c in range(3):
                total = 0.0
                cells = 0
                for ci in range(a == 2, 1 + (a > 0)):
                    for cj in range(b == 2, 1 + (b > 0)):
                        for ck in range(c == 2, 1 + (c > 0)):
                            if stretch[ci, cj, ck] > 0.0:
                                total += stretch[ci, cj, ck]
                                cells += 1
                length[a, b, c] = total / cells if cells > 0 else 1.0


@inlined_kernel
def _lengths_inside(z, i, j, k, length):
    """The same where all 27 nodes are tissue, so that every cell has its four z-edges."""
    for c in range(2):
        for b in range(2):
            for a in range(2):
                total = 0.0
                for p in range(2):
                    for q in range(2):
                        m, n = i - 1 + a + p, j - 1 + b + q
                        total += z[m, n, k + c] - z[m, n, k - 1 + c]
                length[2 * a, 2 * b, 2 * c] = 1.0 / np.sqrt(max(0.25 * total, 0.1))
    for a in range(0, 3, 2):
        for b in range(0, 3, 2):
            length[a, b, 1] = 0.5 * (length[a, b, 0] + length[a, b, 2])
    for a in range(0, 3, 2):
        for c in range(3):
            length[a, 1, c] = 0.5 * (length[a, 0, c] + length[a, 2, c])
    for b in range(3):
        for c in range(3):
            length[1, b, c] = 0.5 * (length[0, b, c] + length[2, b, c])


@inlined_kernel
def _springs_force(modulus, stiffening, x, y, z, i, j, k, length):
    """Net force of the 26 springs of a node, and the sum of its 27 stiffnesses, along each axis."""
    if stiffening is None:
        return _linear_force(modulus, x, y, z, i, j, k, length)
    return _exponential_force(modulus, stiffening, x, y, z, i, j, k, length)


@inlined_kernel
def _outer(force, i, j, k):
    """Force from outside on a node along one axis."""
    if force is None:
        return 0.0
    return force[i, j, k]


@inlined_kernel
def _linear_force(modulus, x, y, z, i, j, k, length):
    """The same for linear springs."""
    own = modulus[i, j, k]
    fx = fy = fz = weight = 0.0
    here_x, here_y, here_z = x[i, j, k], y[i, j, k], z[i, j, k]
    for a in range(3):
        for b in range(3):
            for c in range(3):
                m, n, o = i - 1 + a, j - 1 + b, k - 1 + c
                w = min(own, modulus[m, n, o])
                fx += w * (x[m, n, o] - here_x - (a - 1) * length[a, b, c])
                fy += w * (y[m, n, o] - here_y - (b - 1) * length[a, b, c])
                fz += w * (z[m, n, o] - here_z - (c - 1))
                weight += w
    return fx, fy, fz, weight, weight, weight


@contracting_kernel
def _exponential_force(modulus, stiffening, x, y, z, i, j, k, length):
    """The same for springs that stiffen; what is summed is the slope of the force along each axis.

    From F = w(e) (r - D) with e = |L / L0 - 1|: dF/dr = w + w Enl |r (r - D)| / (L L0) along an
    axis. A step of F over the stiffness alone would be too long there, and the iteration unstable.
    """
    own, own_stiffening = modulus[i, j, k], stiffening[i, j, k]
    fx = fy = fz = 0.0
    wx = wy = wz = float(own)
    here_x, here_y, here_z = x[i, j, k], y[i, j, k], z[i, j, k]
    for a in range(3):
        for b in range(3):
            for c in range(3):
                m, n, o = i - 1 + a, j - 1 + b, k - 1 + c
                if modulus[m, n, o] == 0.0 or (a == 1 and b == 1 and c == 1):
                    continue
                rx, ry, rz = x[m, n, o] - here_x, y[m, n, o] - here_y, z[m, n, o] - here_z
                dx, dy, dz = (a - 1) * length[a, b, c], (b - 1) * length[a, b, c], c - 1.0
                e, reach, at_rest = spring_strain(rx, ry, rz, dx, dy, dz)
                w, rise = stiffened(own, own_stiffening, modulus[m, n, o], stiffening[m, n, o], e)
                rise *= w / (max(reach, SHORTEST) * at_rest)
                fx += w * (rx - dx)
                fy += w * (ry - dy)
                fz += w * (rz - dz)
                wx += w + rise * abs(rx * (rx - dx))
                wy += w + rise * abs(ry * (ry - dy))
                wz += w + rise * abs(rz * (rz - dz))
    return fx, fy, fz, wx, wy, wz


@kernel
def mark_nodes(modulus, fixed, visited):
    """``visited`` is 0 in air and where fixed, 2 where all 27 nodes are tissue, else 1."""
    for i in range(1, modulus.shape[0] - 1):
        for j in range(1, modulus.shape[1] - 1):
            for k in range(1, modulus.shape[2] - 1):
                if modulus[i, j, k] > 0.0 and not fixed[i, j, k]:
                    around = modulus[i - 1 : i + 2, j - 1 : j + 2, k - 1 : k + 2]
                    visited[i, j, k] = 2 if (around > 0.0).all() else 1
