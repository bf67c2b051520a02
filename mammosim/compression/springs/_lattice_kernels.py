"""Kernels on the spring lattice itself.

Arrays are [x, y, z] with one layer of air around, so that every node has 26 neighbours in memory;
``span[i, j]`` holds the first and one past the last z index with tissue in a column; kernels visit
only that. `springs` is either the modulus of each node [x, y, z], 0 in air, a spring having the
smaller of its two: nothing is stored then; or the stiffness of each spring [13, x, y, z], from a
node to those of its neighbours that lie ahead in the order ``9 (dx+1) + 3 (dy+1) + (dz+1)``. The
compiler sees which from the number of axes. `u` is one component of the displacement in lattice
units. Indices along z are unsigned, which spares the compiler the test for negative ones and lets
it vectorise.
"""

import numpy as np
from numba import prange

from mammosim._jit import contracting_kernel, contracting_parallel_kernel, inlined_kernel
from mammosim.compression.springs._plate_kernels import foremost

_ONE = np.uint64(1)


@contracting_kernel
def _column_residual(springs, u, load, i, j, first, last, out):
    """``out = load + sum over 26 springs of w (u_m - u_n)`` for one column; no load if None."""
    if load is None:
        for k in range(first, last):
            out[k] = 0.0
    else:
        column_load = load[i, j]
        for k in range(first, last):
            out[k] = column_load[k]
    if springs.ndim == 3:
        _add_pulls_of_moduli(springs, u, i, j, first, last, out)
    else:
        _add_pulls_of_springs(springs, u, i, j, first, last, out)


@contracting_kernel
def _add_pulls_of_moduli(modulus, u, i, j, first, last, out):
    """Add what the springs of each node of a column pull, each as stiff as its softer node."""
    own = modulus[i, j]
    here = u[i, j]
    for di in range(-1, 2):
        for dj in range(-1, 2):
            other = modulus[i + di, j + dj]
            there = u[i + di, j + dj]
            for k in range(first, last):
                e = own[k]
                below = other[k - _ONE]
                level = other[k]
                above = other[k + _ONE]
                below = below if below < e else e
                level = level if level < e else e
                above = above if above < e else e
                out[k] += (
                    below * (there[k - _ONE] - here[k])
                    + level * (there[k] - here[k])
                    + above * (there[k + _ONE] - here[k])
                )


@contracting_kernel
def _add_pulls_of_springs(stiffness, u, i, j, first, last, out):
    """The same where the stiffness of each spring is given."""
    here = u[i, j]
    for number in range(13):
        di, dj, shift = _ahead(number)
        ahead, behind = u[i + di, j + dj], u[i - di, j - dj]
        own, other = stiffness[number, i, j], stiffness[number, i - di, j - dj]
        for k in range(first, last):
            up, down = k + shift - _ONE, k + _ONE - shift
            out[k] += own[k] * (ahead[up] - here[k]) + other[down] * (behind[down] - here[k])


@contracting_kernel
def _ahead(number):
    """(dx, dy, dz + 1) of the neighbour that stored spring `number` leads to."""
    flat = number + 14
    return flat // 9 - 1, (flat // 3) % 3 - 1, np.uint64(flat % 3)


@contracting_parallel_kernel
def lattice_residual(springs, span, free, u, load, out):
    """``out = free * (load - A u)``: net force on each free node, lattice units x kPa.

    It is summed in the precision of `u`, whatever that of `out`.
    """
    for i in prange(1, u.shape[0] - 1):
        force = np.empty(u.shape[2], u.dtype)
        for j in range(1, u.shape[1] - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first < last:
                _column_residual(springs, u, load, i, j, first, last, force)
                row, mask = out[i, j], free[i, j]
                for k in range(first, last):
                    row[k] = mask[k] * force[k]


@contracting_parallel_kernel
def lattice_smooth(springs, span, inverse_diagonal, u, load, keep, gain, direction, out):
    """``direction = keep direction + gain D^-1 (load - A u)``; ``out = u + direction``.

    `inverse_diagonal` is 0 where a node may not move.
    """
    for i in prange(1, u.shape[0] - 1):
        force = np.empty(u.shape[2], u.dtype)
        for j in range(1, u.shape[1] - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first < last:
                _column_residual(springs, u, load, i, j, first, last, force)
                here, row = u[i, j], out[i, j]
                step, scale = direction[i, j], inverse_diagonal[i, j]
                for k in range(first, last):
                    step[k] = keep * step[k] + gain * scale[k] * force[k]
                    row[k] = here[k] + step[k]


@contracting_parallel_kernel
def lattice_diagonal(springs, span, out):
    """``out = sum of the stiffness of the 26 springs of each tissue node``, 0 in air."""
    for i in prange(1, out.shape[0] - 1):
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


@contracting_kernel
def column_stiffness(springs, i, j, di, dj, first, last, out):
    """Stiffness of the springs (di, dj, -1 .. 1) of each node of a column, `out` being [3, z].

    The spring of a node to itself is 0.
    """
    if springs.ndim == 3:
        own, other = springs[i, j], springs[i + di, j + dj]
        for k in range(first, last):
            e = own[k]
            out[0, k] = min(e, other[k - _ONE])
            out[1, k] = min(e, other[k])
            out[2, k] = min(e, other[k + _ONE])
    else:
        for step in range(3):
            flat = 9 * (di + 1) + 3 * (dj + 1) + step
            row = out[step]
            if flat > 13:
                own = springs[flat - 14, i, j]
                for k in range(first, last):
                    row[k] = own[k]
            elif flat < 13:
                other, shift = springs[12 - flat, i + di, j + dj], np.uint64(step)
                for k in range(first, last):
                    row[k] = other[k + shift - _ONE]
    if di == 0 and dj == 0:
        out[1, first:last] = 0.0


@contracting_parallel_kernel
def spring_stiffness(modulus, out):
    """``out[13, x, y, z] = min(E(n), E(m))``: the stiffness of each spring from nodes' moduli."""
    for i in prange(1, modulus.shape[0] - 1):
        for number in range(13):
            di, dj, shift = _ahead(number)
            for j in range(1, modulus.shape[1] - 1):
                own, other, row = modulus[i, j], modulus[i + di, j + dj], out[number, i, j]
                for k in range(_ONE, np.uint64(modulus.shape[2] - 1)):
                    row[k] = min(own[k], other[k + shift - _ONE])


@contracting_parallel_kernel
def cell_stretch(modulus, z_displacement, out):
    """In-plane stretch 1/sqrt(lambda) of each cell; 0 where a cell takes no part.

    Cell [i, j, k] lies between nodes [i, j, k] and [i+1, j+1, k+1]; lambda is the mean of
    z_upper - z_lower over those of its four z-edges whose two nodes are tissue, at least 0.1.
    """
    nx, ny, nz = modulus.shape
    for i in prange(nx - 1):
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
def stretch_loads(springs, span, stretch, out_x, out_y):
    """Loads along x and y of springs that are longer than at rest by the stretch S - 1.

    The spring to neighbour (a, b, c) has S, the mean of `stretch` over the participating cells
    that contain both nodes (1 where there is none), and pulls n with w a (1 - S) along x.
    """
    nx, ny, nz = stretch.shape
    for i in prange(1, nx - 1):
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
def hold_between_faces(u, force, diagonal, free, plates, slack, contact):
    """Set which nodes the plates' faces hold along z, and put those on the face.

    A free node beyond the plates' edge at rest is held where its local equilibrium, ``u + force /
    diagonal``, lies beyond a face, and let go where that lies inside by more than `slack`: nodes
    that a plate just touches would come and go for ever. `contact` becomes -1 (at the lower
    face), 0 or 1 (at the upper one).

    Returns
    -------
    int
        Number of nodes whose state changed.
    """
    changes = np.zeros(u.shape[0], np.int64)
    for i in prange(1, u.shape[0] - 1):
        if i <= plates.edge:
            continue
        for j in range(1, u.shape[1] - 1):
            for k in range(1, u.shape[2] - 1):
                if free[i, j, k] > 0.0:
                    place = k + u[i, j, k] + force[i, j, k] / diagonal[i, j, k]
                    before = contact[i, j, k]
                    after = _held(place, plates.lower, plates.upper, slack, before)
                    if after != 0:
                        u[i, j, k] = (plates.upper if after > 0 else plates.lower) - k
                    if after != before:
                        changes[i] += 1
                        contact[i, j, k] = after
    return changes.sum()


@contracting_parallel_kernel
def hold_before_ends(u, uz, force, diagonal, free, plates, chest, slack, contact):
    """Set which nodes the chest wall and the plates' ends hold along x; see `hold_between_faces`.

    `uz` is the displacement along z, and `chest` the x of the wall. `contact` becomes -1 (at the
    wall), 0 or 1 (at an end).
    """
    changes = np.zeros(u.shape[0], np.int64)
    for i in prange(1, u.shape[0] - 1):
        for j in range(1, u.shape[1] - 1):
            for k in range(1, u.shape[2] - 1):
                if free[i, j, k] > 0.0:
                    end = foremost(k + uz[i, j, k], plates) if i <= plates.edge else np.inf
                    place = i + u[i, j, k] + force[i, j, k] / diagonal[i, j, k]
                    before = contact[i, j, k]
                    after = _held(place, chest, end, slack, before)
                    if after != 0:
                        u[i, j, k] = (end if after > 0 else chest) - i
                    if after != before:
                        changes[i] += 1
                        contact[i, j, k] = after
    return changes.sum()


@inlined_kernel
def _held(place, lower, upper, slack, before):
    """-1, 0 or 1: which obstacle holds a node whose local equilibrium is at `place`."""
    if place > upper - (slack if before == 1 else 0.0):
        return 1
    if place < lower + (slack if before == -1 else 0.0):
        return -1
    return 0
