"""Kernels of the coarse levels: 27-point stencils, transfer between levels, Galerkin product.

A stencil is symmetric; of its 27 coefficients the 14 from the centre onwards in the order
``9 (dx+1) + 3 (dy+1) + (dz+1)`` are stored as ``stencil[o, x, y, z]``, the others being those of
the neighbour. Arrays have one empty layer around. Coarse node J lies on fine node 2 J - 1 along
each axis, so that the first tissue layer (index 1) is a coarse layer too; a fine node with an even
index lies half-way between two coarse ones (trilinear interpolation).
"""

import numpy as np
from numba import prange

from mammosim._jit import contracting_kernel, sized_kernel
from mammosim.compression.springs._lattice_kernels import column_stiffness

_ONE = np.uint64(1)


@contracting_kernel
def _row_residual(stencil, u, load, i, j, out):
    """``out = load - A u`` for one row along z; no load if None."""
    last = np.uint64(u.shape[2] - 1)
    here, centre = u[i, j], stencil[0, i, j]
    for k in range(_ONE, last):
        out[k] = -centre[k] * here[k]
    if load is not None:
        column_load = load[i, j]
        for k in range(_ONE, last):
            out[k] += column_load[k]
    for offset in range(1, 14):
        flat = offset + 13
        di, dj, dk = flat // 9 - 1, (flat // 3) % 3 - 1, flat % 3 - 1
        shift = np.uint64(dk + 1)
        ahead, behind = u[i + di, j + dj], u[i - di, j - dj]
        own, other = stencil[offset, i, j], stencil[offset, i - di, j - dj]
        for k in range(_ONE, last):
            back = k + _ONE - shift
            out[k] -= own[k] * ahead[k + shift - _ONE] + other[back] * behind[back]


@sized_kernel
def stencil_residual(stencil, u, load, out):
    """``out = load - A u``."""
    for i in prange(1, u.shape[0] - 1):
        for j in range(1, u.shape[1] - 1):
            _row_residual(stencil, u, load, i, j, out[i, j])


@sized_kernel
def stencil_smooth(stencil, inverse_diagonal, u, load, keep, gain, direction, out):
    """``direction = keep direction + gain D^-1 (load - A u)``; ``out = u + direction``."""
    for i in prange(1, u.shape[0] - 1):
        force = np.empty(u.shape[2], u.dtype)
        for j in range(1, u.shape[1] - 1):
            _row_residual(stencil, u, load, i, j, force)
            here, row = u[i, j], out[i, j]
            step, scale = direction[i, j], inverse_diagonal[i, j]
            for k in range(_ONE, np.uint64(u.shape[2] - 1)):
                step[k] = keep * step[k] + gain * scale[k] * force[k]
                row[k] = here[k] + step[k]


@sized_kernel
def restrict(fine, out):
    """Transpose of the trilinear interpolation: fine residual to coarse load."""
    for i in prange(1, out.shape[0] - 1):
        row = np.empty(fine.shape[2], fine.dtype)
        for j in range(1, out.shape[1] - 1):
            _gather_row(fine, i, j, row)
            for k in range(1, out.shape[2] - 1):
                centre = 2 * k - 1
                total = row[centre] if centre < row.size else row.dtype.type(0.0)
                total += row.dtype.type(0.5) * row[centre - 1]
                if centre + 1 < row.size:
                    total += row.dtype.type(0.5) * row[centre + 1]
                out[i, j, k] = total


@contracting_kernel
def _gather_row(fine, i, j, row):
    """Weighted sum of the nine fine rows around coarse row (i, j)."""
    row[:] = 0.0
    for di in range(-1, 2):
        fi = 2 * i - 1 + di
        for dj in range(-1, 2):
            fj = 2 * j - 1 + dj
            if fi < fine.shape[0] and fj < fine.shape[1]:
                weight = row.dtype.type((1.0 - 0.5 * abs(di)) * (1.0 - 0.5 * abs(dj)))
                source = fine[fi, fj]
                for k in range(row.size):
                    row[k] += weight * source[k]


@sized_kernel
def add_interpolated(coarse, span, free, fine):
    """``fine += free * P coarse``."""
    for i in prange(1, fine.shape[0] - 1):
        row = np.empty(coarse.shape[2], coarse.dtype)
        for j in range(1, fine.shape[1] - 1):
            first, last = span[i, j, 0], span[i, j, 1]
            if first >= last:
                continue
            i_low, i_high = (i + 1) // 2, i // 2 + 1
            j_low, j_high = (j + 1) // 2, j // 2 + 1
            quarter = row.dtype.type(0.25)
            for k in range(row.size):
                row[k] = quarter * (
                    coarse[i_low, j_low, k]
                    + coarse[i_low, j_high, k]
                    + coarse[i_high, j_low, k]
                    + coarse[i_high, j_high, k]
                )
            half = row.dtype.type(0.5)
            for k in range(first, last):
                value = half * (row[(k + 1) // 2] + row[k // 2 + 1])
                fine[i, j, k] += free[i, j, k] * value


@sized_kernel
def galerkin_of_lattice(springs, diagonal, free, out):
    """Stencil of ``P^T A P`` on the first coarse level, A being the lattice among free nodes."""
    for i in prange(1, out.shape[1] - 1):
        half = np.zeros((27, free.shape[1], free.shape[2]), np.float32)
        _collapse_x(springs, diagonal, free, i, half)
        _collapse_yz(half, i, out)


@sized_kernel
def galerkin_of_stencil(stencil, out):
    """Stencil of ``P^T A P`` on the next coarse level."""
    for i in prange(1, out.shape[1] - 1):
        half = np.zeros((27, stencil.shape[2], stencil.shape[3]), np.float32)
        _collapse_x(stencil, None, None, i, half)
        _collapse_yz(half, i, out)


@contracting_kernel
def _coarse_weight(reach, step):
    """Weight along an axis, at fine distance `reach`, of the coarse node `step` away."""
    return max(0.0, 1.0 - 0.5 * abs(reach - 2 * step))


@contracting_kernel
def _collapse_x(operator, diagonal, free, i, half):
    """Sum over fine x around coarse layer `i`: stencil [27, y, z], still fine along y and z.

    `operator` is a stencil, or the springs of a lattice if `free` is not None.
    """
    ny, nz = half.shape[1], np.uint64(half.shape[2] - 1)
    fine_layers = operator.shape[-3]
    row = np.empty((3, half.shape[2]), np.float32)
    for ti in range(-1, 2):
        fi = 2 * i - 1 + ti
        if fi < 1 or fi > fine_layers - 2:
            continue
        for j in range(1, ny - 1):
            for pair in range(9):
                di, dj = pair // 3 - 1, pair % 3 - 1
                _operator_row(operator, diagonal, free, fi, j, di, dj, row)
                for step in range(-1, 2):
                    weight = np.float32((1.0 - 0.5 * abs(ti)) * _coarse_weight(ti + di, step))
                    if weight > 0.0:
                        for c in range(3):
                            source = row[c]
                            target = half[9 * (step + 1) + 3 * (dj + 1) + c, j]
                            for k in range(_ONE, nz):
                                target[k] += weight * source[k]


@contracting_kernel
def _operator_row(operator, diagonal, free, i, j, di, dj, out):
    """Coefficients of neighbours (di, dj, -1 .. 1) along one row, `out` being [3, z]."""
    if operator.ndim == 3:  # a test by itself, so that the compiler leaves the others out
        _lattice_row(operator, diagonal, free, i, j, di, dj, out)
    elif free is None:
        _stencil_row(operator, i, j, di, dj, out)
    else:
        _lattice_row(operator, diagonal, free, i, j, di, dj, out)


@contracting_kernel
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


@contracting_kernel
def _lattice_row(springs, diagonal, free, i, j, di, dj, out):
    """Coefficients of the lattice among its free nodes."""
    last = np.uint64(free.shape[2] - 1)
    column_stiffness(springs, i, j, di, dj, _ONE, last, out)
    own, other = free[i, j], free[i + di, j + dj]
    for c in range(3):
        row, shift = out[c], np.uint64(c)
        for k in range(_ONE, last):
            row[k] *= -own[k] * other[k + shift - _ONE]
    if di == 0 and dj == 0:
        diag, row = diagonal[i, j], out[1]
        for k in range(_ONE, last):
            row[k] = own[k] * diag[k]


@contracting_kernel
def _collapse_yz(half, i, out):
    """Sum over fine y, then z; store the 14 coefficients of coarse layer `i`."""
    quarter = np.zeros((27, half.shape[2]), np.float32)
    for j in range(1, out.shape[2] - 1):
        quarter[:] = 0.0
        for tj in range(-1, 2):
            fj = 2 * j - 1 + tj
            if fj < 1 or fj > half.shape[1] - 2:
                continue
            for offset in range(27):
                dj = (offset // 3) % 3 - 1
                for step in range(-1, 2):
                    weight = np.float32((1.0 - 0.5 * abs(tj)) * _coarse_weight(tj + dj, step))
                    if weight > 0.0:
                        row = quarter[offset - 3 * dj + 3 * step]
                        source = half[offset, fj]
                        for k in range(row.size):
                            row[k] += weight * source[k]
        for k in range(1, out.shape[3] - 1):
            for tk in range(-1, 2):
                fk = 2 * k - 1 + tk
                if fk < 1 or fk > half.shape[2] - 2:
                    continue
                for offset in range(27):
                    dk = offset % 3 - 1
                    for step in range(-1, 2):
                        target = offset - dk + step
                        weight = np.float32((1.0 - 0.5 * abs(tk)) * _coarse_weight(tk + dk, step))
                        if weight > 0.0 and target >= 13:
                            out[target - 13, i, j, k] += weight * quarter[offset, fk]
