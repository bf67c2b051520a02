"""Kernels that keep the corners of surface cells where the cell as a whole carries them.

A corner that sticks out of the breast belongs to one cell only, and little but the cell's twelve
hourglass modes holds it. Their energy is ``stiffness / 2 |(I - P) u|^2`` for each cell: P projects
the displacements of its eight nodes on those of a uniform deformation, rotations among them. A
smooth deformation has little of it: a part of the order of the square of the cell's edge.
"""

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


@contracting_kernel
def shape_forces(u, cells, stiffness, out_force):
    """Add the derivative of ``stiffness / 2 |(I - P) u|^2`` of cells to `out_force`; the energy."""
    energy = 0.0
    for n in range(cells.shape[0]):
        for d in range(3):
            for node in range(8):
                total = 0.0
                for other in range(8):
                    i, j = cells[n, 0] + other // 4, cells[n, 1] + (other // 2) % 2
                    k = cells[n, 2] + other % 2
                    total += _hourglass(node, other) * u[d, i, j, k]
                i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
                k = cells[n, 2] + node % 2
                out_force[d, i, j, k] += stiffness[n] * total
                energy += 0.5 * stiffness[n] * total * u[d, i, j, k]
    return energy


@contracting_kernel
def add_shape_stiffness(cells, stiffness, out_stencil):
    """Add the second derivative of `shape_forces`' energy to a block stencil."""
    for n in range(cells.shape[0]):
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k = cells[n, 2] + node % 2
            for other in range(node, 8):
                offset = neighbour(node, other)
                value = stiffness[n] * _hourglass(node, other)
                for d in range(3):
                    out_stencil[i, j, 9 * offset + 4 * d, k] += value
