"""Kernels that carry a field between levels of the multigrid: restriction and interpolation.

Arrays are [x, y, z] with one empty layer around. Coarse node J lies on fine node 2 J - 1 along each
axis, so that the first tissue layer (index 1) is a coarse layer too; a fine node with an even index
lies half-way between two coarse ones (trilinear interpolation). ``span[i, j]`` holds the first and
one past the last z index of a row. Indices are unsigned, as in `_row_kernels`.
"""

import numpy as np

from mammosim._jit import contracting_kernel, share, sized_kernel

_ONE = np.uint64(1)


@sized_kernel
def restrict(thread, fine, out):
    """Transpose of the trilinear interpolation: fine residual to coarse load."""
    for i in share(thread, 1, out.shape[0] - 1):
        row = np.zeros(max(fine.shape[2], 2 * out.shape[2]), fine.dtype)
        half = row.dtype.type(0.5)
        for j in range(1, out.shape[1] - 1):
            _gather_row(fine, i, j, row)
            column = out[i, j]
            for k in range(_ONE, np.uint64(out.shape[2] - 1)):
                centre = k + k - _ONE
                column[k] = row[centre] + half * (row[centre - _ONE] + row[centre + _ONE])


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
                for k in range(source.size):
                    row[k] += weight * source[k]


@sized_kernel
def add_interpolated(thread, coarse, span, free, fine):
    """``fine += free * P coarse``."""
    for i in share(thread, 1, fine.shape[0] - 1):
        row = np.empty(coarse.shape[2], coarse.dtype)
        between = np.zeros(2 * coarse.shape[2], coarse.dtype)
        quarter, half = row.dtype.type(0.25), row.dtype.type(0.5)
        for j in range(1, fine.shape[1] - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first >= last:
                continue
            i_low, i_high = (i + 1) // 2, i // 2 + 1
            j_low, j_high = (j + 1) // 2, j // 2 + 1
            for k in range(row.size):
                row[k] = quarter * (
                    coarse[i_low, j_low, k]
                    + coarse[i_low, j_high, k]
                    + coarse[i_high, j_low, k]
                    + coarse[i_high, j_high, k]
                )
            for k in range(_ONE, np.uint64(row.size - 1)):
                between[k + k - _ONE] = row[k]
                between[k + k] = half * (row[k] + row[k + _ONE])
            mask, column = free[i, j], fine[i, j]
            for k in range(first, last):
                column[k] += mask[k] * between[k]
