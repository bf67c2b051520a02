"""Kernel of the thesis' iteration: one sweep that moves each node to its local equilibrium."""

import numpy as np

from mammosim._jit import contracting_kernel, kernel


@contracting_kernel
def sweep(modulus, visited, x, y, z, order_x, order_y, order_z, plates, sums):
    """Visit every free tissue node once and move it; in place, one after another.

    `visited` comes from `mark_nodes`; `plates` is (lower, upper, edge, chest wall); `x`, `y`, `z`
    are places in lattice units.
    `sums` receives the summed |dx|, |dy|, |dz| of the counted nodes (between the plates and
    touching neither) and their number. The step is F / W where W sums the stiffness of all 27
    terms, the node's own included.
    """
    lower, upper, edge, chest = plates
    stretch = np.empty((2, 2, 2))
    length = np.empty((3, 3, 3))
    sums[:] = 0.0
    for i in order_x:
        for j in order_y:
            for k in order_z:
                if visited[i, j, k] == 0:
                    continue
                if visited[i, j, k] == 2:
                    _lengths_inside(z, i, j, k, length)
                else:
                    _cells_around(modulus, z, i, j, k, stretch)
                    _lengths_at_surface(stretch, length)
                fx, fy, fz, weight = _net_force(modulus, x, y, z, i, j, k, length)
                dx, dy, dz = fx / weight, fy / weight, fz / weight
                x[i, j, k] = max(x[i, j, k] + dx, chest)
                y[i, j, k] += dy
                place = z[i, j, k] + dz
                if x[i, j, k] > edge:
                    place = min(max(place, lower), upper)
                z[i, j, k] = place
                if lower < place < upper and x[i, j, k] > edge:
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


@contracting_kernel
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


@contracting_kernel
def _net_force(modulus, x, y, z, i, j, k, length):
    """Net force of the 26 springs of a node, and the sum of its 27 stiffnesses."""
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
    return fx, fy, fz, weight


@kernel
def mark_nodes(modulus, fixed, visited):
    """``visited`` is 0 in air and where fixed, 2 where all 27 nodes are tissue, else 1."""
    for i in range(1, modulus.shape[0] - 1):
        for j in range(1, modulus.shape[1] - 1):
            for k in range(1, modulus.shape[2] - 1):
                if modulus[i, j, k] > 0.0 and not fixed[i, j, k]:
                    around = modulus[i - 1 : i + 2, j - 1 : j + 2, k - 1 : k + 2]
                    visited[i, j, k] = 2 if (around > 0.0).all() else 1
