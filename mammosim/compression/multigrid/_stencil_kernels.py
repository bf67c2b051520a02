"""Kernels of scalar 27-point stencils: product, smoothing, Galerkin coarsening.

A stencil is symmetric; of its 27 coefficients the 14 from the centre onwards in the order
``9 (dx+1) + 3 (dy+1) + (dz+1)`` are stored as ``stencil[o, x, y, z]``, the others being those of
the neighbour. Arrays have one empty layer around; coarse nodes lie as `_transfer_kernels` says.
Indices are unsigned, as in `_row_kernels`.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel, share, sized_kernel
from mammosim.compression.multigrid._row_kernels import column_stiffness, visited

_ONE = np.uint64(1)


@inlined_kernel
def _coefficient(stencil, i, j, k, a, b, c):
    """Coefficient of node (i, j, k) for its neighbour (i + a - 1, j + b - 1, k + c - 1)."""
    flat = 9 * a + 3 * b + c
    if flat >= 13:
        return stencil[flat - 13, i, j, k]
    return stencil[
        13 - flat, i + np.uint64(a) - _ONE, j + np.uint64(b) - _ONE, k + np.uint64(c) - _ONE
    ]


@inlined_kernel
def _product(stencil, u, i, j, k):
    """``A u`` at one node."""
    total = u.dtype.type(0.0)
    for a in range(3):
        for b in range(3):
            for c in range(3):
                there = u[i + np.uint64(a) - _ONE, j + np.uint64(b) - _ONE, k + np.uint64(c) - _ONE]
                total += _coefficient(stencil, i, j, k, a, b, c) * there
    return total


@sized_kernel
def stencil_residual(thread, stencil, span, u, load, out):
    """``out = load - A u``; no load if None. Only what `span` holds is visited."""
    for layer in share(thread, 1, u.shape[0] - 1):
        i = np.uint64(layer)
        for j in range(_ONE, np.uint64(u.shape[1] - 1)):
            first, last = visited(span, i, j, u.shape[2])
            if load is None:
                for k in range(first, last):
                    out[i, j, k] = -_product(stencil, u, i, j, k)
            else:
                for k in range(first, last):
                    out[i, j, k] = load[i, j, k] - _product(stencil, u, i, j, k)


@sized_kernel
def stencil_smooth(thread, stencil, span, inverse_diagonal, u, load, keep, gain, direction, out):
    """``direction = keep direction + gain D^-1 (load - A u)``; ``out = u + direction``."""
    for layer in share(thread, 1, u.shape[0] - 1):
        i = np.uint64(layer)
        for j in range(_ONE, np.uint64(u.shape[1] - 1)):
            first, last = visited(span, i, j, u.shape[2])
            for k in range(first, last):
                force = load[i, j, k] - _product(stencil, u, i, j, k)
                step = keep * direction[i, j, k] + gain * inverse_diagonal[i, j, k] * force
                direction[i, j, k] = step
                out[i, j, k] = u[i, j, k] + step


@sized_kernel
def galerkin_of_lattice(thread, springs, diagonal, free, span, out):
    """Stencil of ``P^T A P`` on the first coarse level, A being the lattice among free nodes."""
    for i in share(thread, 1, out.shape[1] - 1):
        _collapse_layer(springs, diagonal, free, span, i, out)


@sized_kernel
def galerkin_of_stencil(thread, stencil, span, out):
    """Stencil of ``P^T A P`` on the next coarse level."""
    for i in share(thread, 1, out.shape[1] - 1):
        _collapse_layer(stencil, None, None, span, i, out)


@contracting_kernel
def _collapse_layer(operator, diagonal, free, span, i, out):
    """The 14 coefficients of coarse layer `i`: sums over fine x, then y, then z.

    `operator` is a stencil, or the springs of a lattice if `free` is not None. A fine row's
    coefficients are `rows`, [dx, (dy, dz), z]. Summed over x they are `half`, [fine y modulo 3, X,
    (dy, dz), z], X = 0, 1 being the coarse neighbour along x; then over y `quarter`, [(X, Y), dz,
    z] with (X, Y) = (0, 0), (0, 1), (1, -1), (1, 0), (1, 1). What leads back is left to the
    neighbour. Where `span` is empty nothing is summed.
    """
    size = max(operator.shape[-1], 2 * out.shape[3])
    rows = np.zeros((3, 9, size), np.float32)
    half = np.zeros((3, 2, 3, 3 * size), np.float32)
    quarter = np.zeros((5, 3 * size), np.float32)
    filled = np.zeros(3, np.bool_)
    for j in range(1, out.shape[2] - 1):
        for fj in range(2 * j - 2 if j == 1 else 2 * j - 1, 2 * j + 1):
            sums = half[fj % 3].reshape(2, 9 * size)
            sums[:] = 0.0
            filled[fj % 3] = False
            for t in range(-1, 2):
                fi = 2 * i - 1 + t
                if fi < span.shape[0] and fj < span.shape[1] and span[fi, fj, 1] > 0:
                    filled[fj % 3] = True
                    for pair in range(9):
                        di, dj = pair // 3 - 1, pair % 3 - 1
                        target = rows[pair // 3, 3 * (dj + 1) : 3 * (dj + 1) + 3]
                        _operator_row(operator, diagonal, free, fi, fj, di, dj, target)
                    _add_collapsed(t, rows.reshape(3, 9 * size), None, sums[0], sums[1])
        if filled.any():
            quarter[:] = 0.0
            for t in range(-1, 2):
                level, ahead = half[(2 * j - 1 + t) % 3]
                _add_collapsed(t, level, None, quarter[0], quarter[1])
                _add_collapsed(t, ahead, quarter[2], quarter[3], quarter[4])
            for pair in range(5):
                _collapse_z(quarter[pair].reshape(3, size), 3 * pair, i, j, out)


@inlined_kernel
def _add_collapsed(t, rows, behind, level, ahead):
    """Add a fine layer at t = -1, 0, 1 from a coarse one to the coarse springs along that axis.

    `rows` are the fine springs to layers t - 1, t and t + 1. The weight is that of the
    interpolation at either end: 1 on a coarse layer, 1/2 beside it.
    """
    back, here, on = rows[0], rows[1], rows[2]
    own_back = np.float32(0.0 if t < 0 else 0.5)
    own_here = np.float32(1.0 if t == 0 else 0.25)
    own_on = np.float32(0.0 if t > 0 else 0.5)
    far_here = np.float32(0.25 if t != 0 else 0.0)
    if t >= 0:
        far_here = np.float32(0.25 if t > 0 else 0.0)
        for k in range(np.uint64(level.size)):
            level[k] += own_back * back[k] + own_here * here[k] + own_on * on[k]
            ahead[k] += far_here * here[k] + np.float32(0.5) * on[k]
    else:
        for k in range(np.uint64(level.size)):
            level[k] += own_here * here[k] + own_on * on[k]
    if behind is not None and t <= 0:
        for k in range(np.uint64(level.size)):
            behind[k] += np.float32(0.5) * back[k] + far_here * here[k]


@contracting_kernel
def _collapse_z(rows, number, i, j, out):
    """The same along z: coefficients `number` - 1 to `number` + 1 of a column of coarse nodes."""
    half, quarter = np.float32(0.5), np.float32(0.25)
    back, here, on = rows[0], rows[1], rows[2]
    level, ahead = out[number, i, j], out[number + 1, i, j]
    for k in range(_ONE, np.uint64(out.shape[3] - 1)):
        f = k + k - _ONE
        low, high = f - _ONE, f + _ONE
        level[k] = (here[f] + half * (back[f] + on[f] + on[low] + back[high])) + quarter * (
            here[low] + here[high]
        )
        ahead[k] = half * (on[f] + on[high]) + quarter * here[high]
    if number > 0:
        behind = out[number - 1, i, j]
        for k in range(_ONE, np.uint64(out.shape[3] - 1)):
            f = k + k - _ONE
            behind[k] = half * (back[f] + back[f - _ONE]) + quarter * here[f - _ONE]


@inlined_kernel
def _operator_row(operator, diagonal, free, i, j, di, dj, out):
    """Coefficients of neighbours (di, dj, -1 .. 1) along one row, `out` being [3, z]."""
    if operator.ndim == 3:  # a test by itself, so that the compiler leaves the others out
        _lattice_row(operator, diagonal, free, i, j, di, dj, out)
    elif free is None:
        _stencil_row(operator, i, j, di, dj, out)
    else:
        _lattice_row(operator, diagonal, free, i, j, di, dj, out)


@inlined_kernel
def _stencil_row(stencil, i, j, di, dj, out):
    """Coefficients of a stored stencil."""
    last = np.uint64(stencil.shape[3] - 1)
    for c in range(3):
        flat = 9 * (di + 1) + 3 * (dj + 1) + c
        source, shift = stencil[abs(flat - 13), i, j], _ONE
        if flat < 13:
            source, shift = stencil[13 - flat, i + di, j + dj], np.uint64(c)
        row = out[c]
        for k in range(_ONE, last):
            row[k] = source[k + shift - _ONE]


@inlined_kernel
def _lattice_row(springs, diagonal, free, i, j, di, dj, out):
    """Coefficients of the lattice among its free nodes."""
    last = np.uint64(free.shape[2] - 1)
    own, other = free[i, j], free[i + di, j + dj]
    below, level, above = out[0], out[1], out[2]
    if springs.ndim == 3:
        here, there = springs[i, j], springs[i + di, j + dj]
        for k in range(_ONE, last):
            low, high = k - _ONE, k + _ONE
            e = here[k] * own[k]
            below[k] = -min(e, there[low] * other[low])
            level[k] = -min(e, there[k] * other[k])
            above[k] = -min(e, there[high] * other[high])
    else:
        column_stiffness(springs, i, j, di, dj, _ONE, last, out)
        for k in range(_ONE, last):
            below[k] *= -own[k] * other[k - _ONE]
            level[k] *= -own[k] * other[k]
            above[k] *= -own[k] * other[k + _ONE]
    if di == 0 and dj == 0:
        diag, row = diagonal[i, j], out[1]
        for k in range(_ONE, last):
            row[k] = own[k] * diag[k]
