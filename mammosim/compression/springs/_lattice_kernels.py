"""Kernels on the spring lattice itself.

Arrays are [x, y, z] with one layer of air around, so that every node has 26 neighbours in memory;
``span[i, j]`` holds the first and one past the last z index with tissue in a column; kernels visit
only that. `springs` is either the modulus of each node [x, y, z], 0 in air, a spring having the
smaller of its two: nothing is stored then; or the stiffness of each spring [13, x, y, z], from a
node to those of its neighbours that lie ahead in the order ``9 (dx+1) + 3 (dy+1) + (dz+1)``. The
compiler sees which from the number of axes. `u` is one component of the displacement in lattice
units.

Speed here is a matter of what the compiler makes into vector instructions. Indices are unsigned,
which spares it the test for negative ones; a node's 26 springs stand in one expression, so that
nothing is stored in between; and rows are visited in whole vectors where the array has room for
them, beyond the tissue if need be: what is left over of a row otherwise takes as long as the rest.
"""

import numpy as np

from mammosim._jit import (
    contracting_kernel,
    contracting_parallel_kernel,
    inlined_kernel,
    share,
    sized_kernel,
)
from mammosim.compression.multigrid._row_kernels import column_stiffness, visited
from mammosim.compression.plates._straight_kernels import foremost, lies_between

_ONE = np.uint64(1)


@inlined_kernel
def _pull(springs, u, i, j, k):
    """Sum over the 26 springs of node (i, j, k) of w (u_m - u_n)."""
    if springs.ndim == 3:
        return _pull_of_moduli(springs, u, i, j, k)
    return _pull_of_springs(springs, u, i, j, k)


@inlined_kernel
def _pull_of_moduli(modulus, u, i, j, k):
    """The same where a spring is as stiff as the softer of its two nodes."""
    total = u.dtype.type(0.0)
    for a in range(3):
        for b in range(3):
            for c in range(3):
                x, y, z = i + np.uint64(a) - _ONE, j + np.uint64(b) - _ONE, k + np.uint64(c) - _ONE
                total += min(modulus[x, y, z], modulus[i, j, k]) * (u[x, y, z] - u[i, j, k])
    return total


@inlined_kernel
def _pull_of_springs(stiffness, u, i, j, k):
    """The same where the stiffness of each spring is given."""
    total = u.dtype.type(0.0)
    for a in range(3):
        for b in range(3):
            for c in range(3):
                x, y, z = i + np.uint64(a) - _ONE, j + np.uint64(b) - _ONE, k + np.uint64(c) - _ONE
                flat = 9 * a + 3 * b + c
                if flat > 13:
                    total += stiffness[flat - 14, i, j, k] * (u[x, y, z] - u[i, j, k])
                elif flat < 13:
                    total += stiffness[12 - flat, x, y, z] * (u[x, y, z] - u[i, j, k])
    return total


@contracting_parallel_kernel
def lattice_residual(thread, springs, span, free, u, load, out):
    """``out = free * (load - A u)``: net force on each free node, lattice units x kPa; no load if
    None.

    It is summed in the precision of `u`, whatever that of `out`.
    """
    for layer in share(thread, 1, u.shape[0] - 1):
        i = np.uint64(layer)
        for j in range(_ONE, np.uint64(u.shape[1] - 1)):
            first, last = visited(span, i, j, u.shape[2])
            if load is None:
                for k in range(first, last):
                    out[i, j, k] = free[i, j, k] * _pull(springs, u, i, j, k)
            else:
                for k in range(first, last):
                    force = load[i, j, k] + _pull(springs, u, i, j, k)
                    out[i, j, k] = free[i, j, k] * force


@contracting_parallel_kernel
def lattice_smooth(thread, springs, span, inverse_diagonal, u, load, keep, gain, direction, out):
    """``direction = keep direction + gain D^-1 (load - A u)``; ``out = u + direction``.

    `inverse_diagonal` is 0 where a node may not move.
    """
    for layer in share(thread, 1, u.shape[0] - 1):
        i = np.uint64(layer)
        for j in range(_ONE, np.uint64(u.shape[1] - 1)):
            first, last = visited(span, i, j, u.shape[2])
            for k in range(first, last):
                force = load[i, j, k] + _pull(springs, u, i, j, k)
                step = keep * direction[i, j, k] + gain * inverse_diagonal[i, j, k] * force
                direction[i, j, k] = step
                out[i, j, k] = u[i, j, k] + step


@contracting_kernel
def _ahead(number):
    """(dx, dy, dz + 1) of the neighbour that stored spring `number` leads to."""
    flat = number + 14
    return flat // 9 - 1, (flat // 3) % 3 - 1, np.uint64(flat % 3)


@contracting_parallel_kernel
def lattice_diagonal(thread, springs, span, out):
    """``out = sum of the stiffness of the 26 springs of each tissue node``, 0 in air."""
    for i in share(thread, 1, out.shape[0] - 1):
        stiffness = np.empty((3, out.shape[2]), np.float32)
        for j in range(1, out.shape[1] - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            row = out[i, j]
            for k in range(first, last):
                row[k] = 0.0
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    column_stiffness(springs, i, j, di, dj, first, last, stiffness)
                    for k in range(first, last):
                        row[k] += stiffness[0, k] + stiffness[1, k] + stiffness[2, k]


@contracting_parallel_kernel
def spring_stiffness(thread, modulus, out):
    """``out[13, x, y, z] = min(E(n), E(m))``: the stiffness of each spring from nodes' moduli."""
    for i in share(thread, 1, modulus.shape[0] - 1):
        for number in range(13):
            di, dj, shift = _ahead(number)
            for j in range(1, modulus.shape[1] - 1):
                own, other, row = modulus[i, j], modulus[i + di, j + dj], out[number, i, j]
                for k in range(_ONE, np.uint64(modulus.shape[2] - 1)):
                    row[k] = min(own[k], other[k + shift - _ONE])


@contracting_parallel_kernel
def cell_stretch(thread, modulus, z_displacement, out):
    """In-plane stretch 1/sqrt(lambda) of each cell; 0 where a cell takes no part.

    Cell [i, j, k] lies between nodes [i, j, k] and [i+1, j+1, k+1]; lambda is the mean of
    z_upper - z_lower over those of its four z-edges whose two nodes are tissue, at least 0.1.
    """
    nx, ny, nz = modulus.shape
    for i in share(thread, 0, nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                total = 0.0
                edges = 0
                for di in range(2):
                    for dj in range(2):
                        if (
                            modulus[i + di, j + dj, k] > 0.0
                            and modulus[i + di, j + dj, k + 1] > 0.0
                        ):
                            total += (
                                1.0
                                + z_displacement[i + di, j + dj, k + 1]
                                - z_displacement[i + di, j + dj, k]
                            )
                            edges += 1
                out[i, j, k] = 1.0 / np.sqrt(max(total / edges, 0.1)) if edges > 0 else 0.0


@contracting_parallel_kernel
def stretch_loads(thread, springs, span, stretch, out_x, out_y):
    """Loads along x and y of springs that are longer than at rest by the stretch S - 1.

    The spring to neighbour (a, b, c) has S, the mean of `stretch` over the participating cells
    that contain both nodes (1 where there is none), and pulls n with w a (1 - S) along x.
    """
    nx, ny, nz = stretch.shape
    for i in share(thread, 1, nx - 1):
        total = np.empty(nz)
        cells = np.empty(nz)
        stiffness = np.empty((3, nz), np.float32)
        for j in range(1, ny - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first >= last:
                continue
            row_x, row_y = out_x[i, j], out_y[i, j]
            row_x[:] = 0.0
            row_y[:] = 0.0
            for a in range(-1, 2):
                for b in range(-1, 2):
                    if a != 0 or b != 0:
                        _columns_stretch(stretch, i, j, a, b, first, last, total, cells)
                        column_stiffness(springs, i, j, a, b, first, last, stiffness)
                        _add_stretch_loads(stiffness, total, cells, a, b, first, last, row_x, row_y)


@contracting_kernel
def _columns_stretch(stretch, i, j, a, b, first, last, total, cells):
    """Per level: sum and number of participating cells beside the spring (a, b, .) of (i, j)."""
    for k in range(first - _ONE, last):
        total[k] = 0.0
        cells[k] = 0.0
    for ci in range(i - (a <= 0), i + (a >= 0)):
        for cj in range(j - (b <= 0), j + (b >= 0)):
            column = stretch[ci, cj]
            for k in range(first - _ONE, last):
                total[k] += column[k]
                cells[k] += 1.0 if column[k] > 0.0 else 0.0


@contracting_kernel
def _add_stretch_loads(stiffness, total, cells, a, b, first, last, row_x, row_y):
    """Add what the three springs (a, b, -1 .. 1) of each node of a column pull along x and y."""
    for k in range(first, last):
        below = k - _ONE
        both = cells[below] + cells[k]
        down = 1.0 - total[below] / cells[below] if cells[below] > 0.0 else 0.0
        up = 1.0 - total[k] / cells[k] if cells[k] > 0.0 else 0.0
        level = 1.0 - (total[below] + total[k]) / both if both > 0.0 else 0.0
        pull = down * stiffness[0, k] + level * stiffness[1, k] + up * stiffness[2, k]
        row_x[k] += a * pull
        row_y[k] += b * pull


@contracting_parallel_kernel
def hold_between_faces(thread, u, force, diagonal, free, plates, slack, contact, advance=0.0):
    """Set which nodes the plates' faces hold along z, and put those on the face.

    A free node beyond the plates' edge at rest is held where its local equilibrium, ``u + force /
    diagonal``, lies beyond a face, and let go where that lies inside by more than `slack`: nodes
    that a plate just touches would come and go for ever. `contact` becomes -1 (at the lower
    face), 0 or 1 (at the upper one). Free nodes that are not held move the part `advance` of the
    way to their local equilibrium.

    Returns
    -------
    int
        Number of nodes whose state changed, of each thread.
    """
    changes = 0
    for i in share(thread, 1, u.shape[0] - 1):
        lower = plates.lower if lies_between(i, plates) else -np.inf
        upper = plates.upper if lies_between(i, plates) else np.inf
        for j in range(1, u.shape[1] - 1):
            for k in range(1, u.shape[2] - 1):
                if free[i, j, k] > 0.0:
                    step = force[i, j, k] / diagonal[i, j, k]
                    before = contact[i, j, k]
                    after = _held(k + u[i, j, k] + step, lower, upper, slack, before)
                    if after != 0:
                        u[i, j, k] = (upper if after > 0 else lower) - k
                    else:
                        u[i, j, k] += advance * step
                    if after != before:
                        changes += 1
                        contact[i, j, k] = after
    return changes


@contracting_parallel_kernel
def plate_end_contact(
    thread, u, uz, force, diagonal, free, plates, chest, slack, contact, advance=0.0
):
    """Set which nodes the chest wall and the plates' ends hold along x; see `hold_between_faces`.

    `uz` is the displacement along z, and `chest` the x of the wall. `contact` becomes -1 (at the
    wall), 0 or 1 (at an end).
    """
    changes = 0
    for i in share(thread, 1, u.shape[0] - 1):
        for j in range(1, u.shape[1] - 1):
            for k in range(1, u.shape[2] - 1):
                if free[i, j, k] > 0.0:
                    end = np.inf
                    if not lies_between(i, plates):
                        end = foremost(k + uz[i, j, k], plates)
                    step = force[i, j, k] / diagonal[i, j, k]
                    before = contact[i, j, k]
                    after = _held(i + u[i, j, k] + step, chest, end, slack, before)
                    if after != 0:
                        u[i, j, k] = (end if after > 0 else chest) - i
                    else:
                        u[i, j, k] += advance * step
                    if after != before:
                        changes += 1
                        contact[i, j, k] = after
    return changes


@inlined_kernel
def _held(place, lower, upper, slack, before):
    """-1, 0 or 1: which obstacle holds a node whose local equilibrium is at `place`."""
    if place > upper - (slack if before == 1 else 0.0):
        return 1
    if place < lower + (slack if before == -1 else 0.0):
        return -1
    return 0


@sized_kernel
def unheld_nodes(thread, free, contact, out):
    """``out = free`` where `contact` is 0, else 0."""
    for i in share(thread, 0, out.shape[0]):
        for j in range(out.shape[1]):
            row_f, row_c, row = free[i, j], contact[i, j], out[i, j]
            for k in range(row.size):
                row[k] = row_f[k] if row_c[k] == 0 else 0.0
