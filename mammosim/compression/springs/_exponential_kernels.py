"""Formulas of springs that stiffen as they are strained, E = Ec exp(Enl e), and their kernels."""

import numpy as np

from mammosim._jit import contracting_parallel_kernel, inlined_kernel, share

LARGEST_STRAIN = 0.6
"""Strain from which on a spring stiffens no further, so that its modulus stays finite: that of fat
is then 90 times, that of an abnormality 160 000 times the one at rest. Assumed."""

SHORTEST = 1e-3
"""Length of a spring at least, lattice units, where its slope is taken."""


@inlined_kernel
def spring_strain(rx, ry, rz, dx, dy, dz):
    """Strain |L / L0 - 1| of a spring that reaches over r and is at rest over D, then L and L0."""
    length = np.sqrt(rx * rx + ry * ry + rz * rz)
    at_rest = np.sqrt(dx * dx + dy * dy + dz * dz)
    return abs(length / at_rest - 1.0), length, at_rest


@inlined_kernel
def stiffened(own, own_stiffening, other, other_stiffening, strain):
    """Stiffness of a spring, the smaller of its two nodes' E(e), and the stiffening of that node.

    Beyond the largest strain the force no longer stiffens. The coefficient is still returned:
    a step by the smaller slope there would lead back over the kink, and again.
    """
    e = min(strain, LARGEST_STRAIN)
    if own <= other and own_stiffening <= other_stiffening:
        stiffness, stiffening = own * np.exp(own_stiffening * e), own_stiffening
    elif own >= other and own_stiffening >= other_stiffening:
        stiffness, stiffening = other * np.exp(other_stiffening * e), other_stiffening
    else:
        here, there = own * np.exp(own_stiffening * e), other * np.exp(other_stiffening * e)
        stiffness, stiffening = (
            min(here, there),
            own_stiffening if here <= there else other_stiffening,
        )
    return stiffness, stiffening


@inlined_kernel
def mean_stretch(stretch, i, j, k, a, b, c):
    """Mean stretch S of the participating cells that hold both node (i, j, k) and (a, b, c) on.

    `stretch` is from `cell_stretch`; 1 where no cell takes part.
    """
    total = 0.0
    cells = 0
    for ci in range(i - (a <= 0), i + (a >= 0)):
        for cj in range(j - (b <= 0), j + (b >= 0)):
            for ck in range(k - (c <= 0), k + (c >= 0)):
                if stretch[ci, cj, ck] > 0.0:
                    total += stretch[ci, cj, ck]
                    cells += 1
    return total / cells if cells > 0 else 1.0


@contracting_parallel_kernel
def strain_springs(thread, modulus, stiffening, ux, uy, uz, stretch, axis, stiffness, slope):
    """Stiffness of each spring at its strain, and the slope of its force along an axis.

    `stiffness` and `slope` are [13, x, y, z], from a node to those ahead of it, 0 where either is
    air; no slope is told if that is None. From F = w(e) (r - D) with e = |L / L0 - 1|:
    dF/dr = w + w Enl |r (r - D)| / (L L0), taken as not below w even where a spring that turns away
    would give less.
    """
    nx, ny, nz = modulus.shape
    for i in share(thread, 1, nx - 1):
        for number in range(13):
            flat = number + 14
            a, b, c = flat // 9 - 1, (flat // 3) % 3 - 1, flat % 3 - 1
            for j in range(1, ny - 1):
                for k in range(1, nz - 1):
                    m, n, o = i + a, j + b, k + c
                    own, other = modulus[i, j, k], modulus[m, n, o]
                    if own == 0.0 or other == 0.0:
                        stiffness[number, i, j, k] = 0.0
                        if slope is not None:
                            slope[number, i, j, k] = 0.0
                        continue
                    wide = mean_stretch(stretch, i, j, k, a, b, c)
                    dx, dy, dz = a * wide, b * wide, float(c)
                    rx = a + ux[m, n, o] - ux[i, j, k]
                    ry = b + uy[m, n, o] - uy[i, j, k]
                    rz = c + uz[m, n, o] - uz[i, j, k]
                    e, reach, at_rest = spring_strain(rx, ry, rz, dx, dy, dz)
                    w, rise = stiffened(own, stiffening[i, j, k], other, stiffening[m, n, o], e)
                    stiffness[number, i, j, k] = w
                    if slope is not None:
                        pull = rx * (rx - dx) if axis == 0 else ry * (ry - dy)
                        pull = rz * (rz - dz) if axis == 2 else pull
                        rise *= abs(pull) / (max(reach, SHORTEST) * at_rest)
                        slope[number, i, j, k] = w + rise * w
