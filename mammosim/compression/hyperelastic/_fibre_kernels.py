"""Kernels of fibres: each element is stiffer in tension along one direction.

With the deformation gradient F at the element's centre and a unit direction a at rest, the stretch
is ``L = |F a|``. The energy, zero for L <= 1, has a second derivative that rises from 0 to the
stiffness over `SMOOTHED` of stretch and stays there. It is convex in F.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel
from mammosim.compression.hyperelastic._corner_kernels import neighbour

SMOOTHED = 0.015
"""Stretch over which fibres take hold."""


@inlined_kernel
def _along(direction, n, node):
    """Derivative along a direction of the shape function of a node at the element's centre."""
    x = 0.25 if node & 4 else -0.25
    y = 0.25 if node & 2 else -0.25
    z = 0.25 if node & 1 else -0.25
    return x * direction[n, 0] + y * direction[n, 1] + z * direction[n, 2]


@inlined_kernel
def _stretched(u, cells, direction, n):
    """The fibre's vector ``F a``."""
    x, y, z = direction[n, 0], direction[n, 1], direction[n, 2]
    for node in range(8):
        i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
        k, slope = cells[n, 2] + node % 2, _along(direction, n, node)
        x += slope * u[0, i, j, k]
        y += slope * u[1, i, j, k]
        z += slope * u[2, i, j, k]
    return x, y, z


@inlined_kernel
def _tension(stretch):
    """Energy, its slope and its curvature at a stretch, for a stiffness of 1."""
    beyond = stretch - 1.0
    if beyond <= 0.0:
        return 0.0, 0.0, 0.0
    if beyond < SMOOTHED:
        return (
            beyond * beyond * beyond / (6.0 * SMOOTHED),
            beyond * beyond / (2.0 * SMOOTHED),
            beyond / SMOOTHED,
        )
    late = beyond - 0.5 * SMOOTHED
    return 0.5 * late * late + SMOOTHED * SMOOTHED / 24.0, late, 1.0


@contracting_kernel
def fibre_forces(u, cells, direction, stiffness, out_force):
    """Add the energy's derivative by each node's displacement to `out_force`; the energy."""
    total = 0.0
    for n in range(cells.shape[0]):
        x, y, z = _stretched(u, cells, direction, n)
        stretch = np.sqrt(x * x + y * y + z * z)
        energy, slope, _ = _tension(stretch)
        if slope == 0.0:
            continue
        total += stiffness[n] * energy
        pull = stiffness[n] * slope / stretch
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k, part = cells[n, 2] + node % 2, pull * _along(direction, n, node)
            out_force[0, i, j, k] += part * x
            out_force[1, i, j, k] += part * y
            out_force[2, i, j, k] += part * z
    return total


@contracting_kernel
def add_fibre_stiffness(u, cells, direction, stiffness, out_stencil):
    """Add the second derivative of the energy to a block stencil.

    With v = F a / L it is ``W'' v v^T + W'/L (1 - v v^T)``.
    """
    block = np.empty(9)
    for n in range(cells.shape[0]):
        x, y, z = _stretched(u, cells, direction, n)
        stretch = np.sqrt(x * x + y * y + z * z)
        _, slope, curvature = _tension(stretch)
        if slope == 0.0:
            continue
        across = stiffness[n] * slope / stretch
        ahead = (stiffness[n] * curvature - across) / (stretch * stretch)
        vector = (x, y, z)
        for r in range(3):
            for c in range(3):
                block[3 * r + c] = ahead * vector[r] * vector[c] + (across if r == c else 0.0)
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k, own = cells[n, 2] + node % 2, _along(direction, n, node)
            for other in range(node, 8):
                offset = neighbour(node, other)
                both = own * _along(direction, n, other)
                for entry in range(9):
                    out_stencil[i, j, 9 * offset + entry, k] += both * block[entry]
