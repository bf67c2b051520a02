"""Kernels that keep the corners of surface cells where the cell as a whole carries them.

A corner that sticks out of the breast belongs to one cell only, and little but the cell's twelve
hourglass modes holds it. Their energy is ``stiffness / 2 (q + growth q^2 / 2)`` for each cell, with
``q = |h|^2`` and ``h = (I - P) u``: P projects the displacements of its eight nodes on those of a
uniform deformation, rotations among them. A smooth deformation has little of it: q is of the order
of the square of the cell's edge.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel
from mammosim.compression.hyperelastic._corner_kernels import neighbour


@inlined_kernel
def _hourglass(node, other):
    """Part of a node's displacement in another's that no uniform deformation of a cell has.

    ``I - P``, P projecting the eight values at a cell's corners on those of linear functions.
    """
    x = 1.0 if node // 4 == other // 4 else -1.0
    y = 1.0 if (node // 2) % 2 == (other // 2) % 2 else -1.0
    z = 1.0 if node % 2 == other % 2 else -1.0
    return (1.0 if node == other else 0.0) - 0.125 * (1.0 + x + y + z)


@inlined_kernel
def _modes(u, cells, n, out):
    """``h`` of a cell, [3, node], and its square."""
    square = 0.0
    for d in range(3):
        for node in range(8):
            total = 0.0
            for other in range(8):
                i, j = cells[n, 0] + other // 4, cells[n, 1] + (other // 2) % 2
                k = cells[n, 2] + other % 2
                total += _hourglass(node, other) * u[d, i, j, k]
            out[d, node] = total
            square += total * total
    return square


@contracting_kernel
def shape_forces(u, cells, stiffness, growth, out_force):
    """Add the derivative of the cells' energy to `out_force`; the energy."""
    energy, modes = 0.0, np.empty((3, 8))
    for n in range(cells.shape[0]):
        square = _modes(u, cells, n, modes)
        energy += 0.5 * stiffness[n] * square * (1.0 + 0.5 * growth * square)
        factor = stiffness[n] * (1.0 + growth * square)
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k = cells[n, 2] + node % 2
            for d in range(3):
                out_force[d, i, j, k] += factor * modes[d, node]
    return energy


@contracting_kernel
def add_shape_stiffness(u, cells, stiffness, growth, out_stencil):
    """Add the second derivative of `shape_forces`' energy to a block stencil."""
    modes = np.empty((3, 8))
    for n in range(cells.shape[0]):
        square = _modes(u, cells, n, modes)
        factor, both = stiffness[n] * (1.0 + growth * square), 2.0 * stiffness[n] * growth
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k = cells[n, 2] + node % 2
            for other in range(node, 8):
                place = 9 * neighbour(node, other)
                same = factor * _hourglass(node, other)
                for r in range(3):
                    along = both * modes[r, node]
                    for c in range(3):
                        value = along * modes[c, other] + (same if r == c else 0.0)
                        out_stencil[i, j, place + 3 * r + c, k] += value
