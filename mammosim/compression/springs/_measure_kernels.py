"""Kernel of the volume of the lattice's cells, as the thesis' listing has it."""

import numpy as np

from mammosim._jit import parallel_kernel, share


@parallel_kernel
def cell_volumes(thread, modulus, ux, uy, uz, out):
    """Per layer of x: number of cells of eight tissue nodes, their volume, and those inverted.

    A cell's volume is the product of the means of its four edges along each axis, in lattice
    units; it counts as inverted where its first node lies beyond its neighbour along an axis
    (`volumeBugs` of the listing). `out` is [x, 3].
    """
    nx, ny, nz = modulus.shape
    for i in share(thread, 1, nx - 2):
        for j in range(1, ny - 2):
            for k in range(1, nz - 2):
                tissue = True
                for n in range(8):
                    if modulus[i + n // 4, j + (n // 2) % 2, k + n % 2] == 0.0:
                        tissue = False
                if not tissue:
                    continue
                x_edge = 4.0
                y_edge = 4.0
                z_edge = 4.0
                for a in range(2):
                    for b in range(2):
                        x_edge += ux[i + 1, j + a, k + b] - ux[i, j + a, k + b]
                        y_edge += uy[i + a, j + 1, k + b] - uy[i + a, j, k + b]
                        z_edge += uz[i + a, j + b, k + 1] - uz[i + a, j + b, k]
                out[i, 0] += 1.0
                out[i, 1] += x_edge * y_edge * z_edge / 64.0
                if (
                    ux[i, j, k] > ux[i + 1, j, k] + 1.0
                    or uy[i, j, k] > uy[i, j + 1, k] + 1.0
                    or uz[i, j, k] > uz[i, j, k + 1] + 1.0
                ):
                    out[i, 2] += 1.0


@parallel_kernel
def held_columns(thread, contact, ux, uy, side, place, touching):
    """In-plane place of the outermost tissue node of each column a plate holds.

    `contact` is -1, 0 or 1; `side` chooses the plate. `place` is [x, y, 2], `touching` [x, y].
    """
    nx, ny, nz = contact.shape
    for i in share(thread, 0, nx):
        for j in range(ny):
            for step in range(nz):
                k = nz - 1 - step if side > 0 else step
                if contact[i, j, k] == side:
                    touching[i, j] = True
                    place[i, j, 0] = i + ux[i, j, k]
                    place[i, j, 1] = j + uy[i, j, k]
                    break


def touching_area(place: np.ndarray, touching: np.ndarray) -> float:
    """Area of the columns that touch a plate, lattice units: sum over quadrilaterals of columns.

    A quadrilateral with four touching columns counts whole. At the rim, where some do not touch,
    each touching column has the mean area of a column for what is missing of its four quarters.
    """
    whole = touching[:-1, :-1] & touching[1:, :-1] & touching[:-1, 1:] & touching[1:, 1:]
    diagonal_a = place[1:, 1:] - place[:-1, :-1]
    diagonal_b = place[:-1, 1:] - place[1:, :-1]
    areas = 0.5 * np.abs(
        diagonal_a[..., 0] * diagonal_b[..., 1] - diagonal_a[..., 1] * diagonal_b[..., 0]
    )
    columns = int(np.count_nonzero(touching))
    quads = int(np.count_nonzero(whole))
    if quads == 0:
        return float(columns)
    covered = float(areas[whole].sum())
    return covered * columns / quads
