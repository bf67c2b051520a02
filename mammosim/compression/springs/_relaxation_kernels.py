"""Kernel of the thesis' iteration: one sweep that moves each node to its local equilibrium."""

import numpy as np

from mammosim._jit import contracting_kernel


@contracting_kernel
def sweep(modulus, fixed, x, y, z, order_x, order_y, order_z, plates, sums):
    """Visit every free tissue node once and move it; in place, one after another.

    `plates` is (lower, upper, edge, chest wall); `x`, `y`, `z` are places in lattice units.
    `sums` receives the summed |dx|, |dy|, |dz| of the counted nodes (between the plates and
    touching neither) and their number. The step is F / W where W sums the stiffness of all 27
    terms, the node's own included.
    """
    lower, upper, edge, chest = plates
    stretch = np.empty((2, 2, 2))
    sums[:] = 0.0
    for i in order_x:
        for j in order_y:
            for k in order_z:
                if modulus[i, j, k] == 0.0 or fixed[i, j, k]:
                    continue
                _cells_around(modulus, z, i, j, k, stretch)
                fx, fy, fz, weight = _net_force(modulus, x, y, z, i, j, k, stretch)
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
def _net_force(modulus, x, y, z, i, j, k, stretch):
    """Net force of the 26 springs of a node, and the sum of its 27 stiffnesses."""
    own = modulus[i, j, k]
    fx = fy = fz = 0.0
    weight = own
    here_x, here_y, here_z = x[i, j, k], y[i, j, k], z[i, j, k]
    for a in range(-1, 2):
        for b in range(-1, 2):
            for c in range(-1, 2):
                w = min(own, modulus[i + a, j + b, k + c])
                if w == 0.0 or (a == 0 and b == 0 and c == 0):
                    continue
                length = 1.0
                if a != 0 or b != 0:
                    total = 0.0
                    cells = 0
                    for ci in range(a == 1, 2 - (a == -1)):
                        for cj in range(b == 1, 2 - (b == -1)):
                            for ck in range(c == 1, 2 - (c == -1)):
                                if stretch[ci, cj, ck] > 0.0:
                                    total += stretch[ci, cj, ck]
                                    cells += 1
                    if cells > 0:
                        length = total / cells
                fx += w * (x[i + a, j + b, k + c] - here_x - a * length)
                fy += w * (y[i + a, j + b, k + c] - here_y - b * length)
                fz += w * (z[i + a, j + b, k + c] - here_z - c)
                weight += w
    return fx, fy, fz, weight
