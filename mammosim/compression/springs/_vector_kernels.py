"""Kernels of the conjugate gradients: sums a slab at a time, in one order for any thread count."""

import numpy as np
from numba import prange

from mammosim._jit import sized_kernel


@sized_kernel
def slab_dots(a, b, out):
    """``out[i] = sum of a[i] b[i]`` in double precision."""
    for i in prange(a.shape[0]):
        total = 0.0
        for j in range(a.shape[1]):
            row_a, row_b = a[i, j], b[i, j]
            part = 0.0
            for k in range(row_a.size):
                part += row_a[k] * row_b[k]
            total += part
        out[i] = total


@sized_kernel
def add_scaled(factor, a, out):
    """``out += factor a``."""
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            row_a, row = a[i, j], out[i, j]
            for k in range(row.size):
                row[k] += factor * row_a[k]


@sized_kernel
def scale_and_add(factor, a, out):
    """``out = a + factor out``."""
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            row_a, row = a[i, j], out[i, j]
            for k in range(row.size):
                # Not factor * row alone: 0 * what an earlier call left might be NaN.
                row[k] = row_a[k] + factor * row[k] if factor != 0.0 else row_a[k]


@sized_kernel
def slab_largest(a, out):
    """``out[i] = largest |a[i]|``."""
    for i in prange(a.shape[0]):
        largest = 0.0
        for j in range(a.shape[1]):
            for k in range(a.shape[2]):
                largest = max(largest, abs(a[i, j, k]))
        out[i] = largest


@sized_kernel
def scaled_rows(scale, a, factor, out):
    """``out = factor scale a``."""
    for i in prange(out.shape[0]):
        for j in range(out.shape[1]):
            row_s, row_a, row = scale[i, j], a[i, j], out[i, j]
            for k in range(row.size):
                row[k] = factor * row_s[k] * row_a[k]


def dot(a: np.ndarray, b: np.ndarray) -> float:
    """Inner product of two arrays, the same to the last bit for any number of threads."""
    parts = np.empty(a.shape[0])
    slab_dots(a, b, parts)
    return float(parts.sum())


def largest(a: np.ndarray) -> float:
    """Largest absolute value of an array."""
    parts = np.empty(a.shape[0])
    slab_largest(a, parts)
    return float(parts.max())
