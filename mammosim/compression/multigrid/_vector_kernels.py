"""Kernels of vectors: sums a slab at a time, in one order for any thread count."""

import numpy as np

from mammosim._jit import share, sized_kernel


@sized_kernel
def slab_dots(thread, a, b, out):
    """``out[i] = sum of a[i] b[i]`` in double precision; along z last, so that rows add up fast."""
    for i in share(thread, 0, a.shape[0]):
        total = np.zeros(a.shape[2])
        for j in range(a.shape[1]):
            row_a, row_b = a[i, j], b[i, j]
            for k in range(total.size):
                total[k] += row_a[k] * row_b[k]
        out[i] = total.sum()


@sized_kernel
def add_scaled(thread, factor, a, out):
    """``out += factor a``."""
    for i in share(thread, 0, out.shape[0]):
        for j in range(out.shape[1]):
            row_a, row = a[i, j], out[i, j]
            for k in range(row.size):
                row[k] += factor * row_a[k]


@sized_kernel
def scale_and_add(thread, factor, a, out):
    """``out = a + factor out``."""
    for i in share(thread, 0, out.shape[0]):
        for j in range(out.shape[1]):
            row_a, row = a[i, j], out[i, j]
            for k in range(row.size):
                # Not factor * row alone: 0 * what an earlier call left might be NaN.
                row[k] = row_a[k] + factor * row[k] if factor != 0.0 else row_a[k]


@sized_kernel
def slab_largest(thread, a, out):
    """``out[i] = largest |a[i]|``."""
    for i in share(thread, 0, a.shape[0]):
        largest = np.zeros(a.shape[2], a.dtype)
        for j in range(a.shape[1]):
            row = a[i, j]
            for k in range(largest.size):
                size = abs(row[k])
                largest[k] = size if size > largest[k] else largest[k]
        out[i] = largest.max()


@sized_kernel
def scaled_twice(thread, scale, a, factor, out, copy):
    """``out = copy = factor scale a``."""
    for i in share(thread, 0, out.shape[0]):
        for j in range(out.shape[1]):
            row_s, row_a, row, other = scale[i, j], a[i, j], out[i, j], copy[i, j]
            for k in range(row.size):
                row[k] = factor * row_s[k] * row_a[k]
                other[k] = row[k]


@sized_kernel
def masked_inverse(thread, mask, a, out):
    """``out = mask / a``, 0 where a is not positive."""
    for i in share(thread, 0, out.shape[0]):
        for j in range(out.shape[1]):
            row_m, row_a, row = mask[i, j], a[i, j], out[i, j]
            for k in range(row.size):
                row[k] = row_m[k] / row_a[k] if row_a[k] > 0.0 else 0.0
