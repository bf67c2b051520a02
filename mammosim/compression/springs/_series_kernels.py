"""Kernel of the starting state of springs in series."""

import numpy as np

from mammosim._jit import kernel

_LARGEST_COMPRESSION = 0.9
"""Of one spring, as in the thesis' listing."""


@kernel
def series_columns(modulus, span, chest, edge, lower, upper, z, widening):
    """Places along z of each column compressed into its gap, and 1/sqrt of the springs' stretch."""
    nx, ny, _ = modulus.shape
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            first, last = span[i, j, 0], span[i, j, 1] - 1
            if last <= first:
                continue
            share = min(max((i - chest) / max(edge - chest, 1e-9), 0.0), 1.0)
            chest_low, chest_high = first, last
            if span[chest, j, 1] > span[chest, j, 0]:
                chest_low, chest_high = span[chest, j, 0], span[chest, j, 1] - 1
            bottom = chest_low + share * (max(lower, chest_low) - chest_low)
            top = chest_high + share * (min(upper, chest_high) - chest_high)
            if share >= 1.0:
                bottom, top = lower, upper
            if last - first <= top - bottom:
                _shift(z, i, j, first, last, bottom, top)
            else:
                _squeeze(modulus, z, widening, i, j, first, last, bottom, top)


@kernel
def _shift(z, i, j, first, last, bottom, top):
    """Move a column that fits by as little as it must."""
    move = max(bottom - first, 0.0) + min(top - last, 0.0)
    for k in range(first, last + 1):
        z[i, j, k] = k + move


@kernel
def _squeeze(modulus, z, widening, i, j, first, last, bottom, top):
    """Share a column's compression among its springs as 1 / stiffness."""
    compliance = 0.0
    for k in range(first, last):
        stiffness = min(modulus[i, j, k], modulus[i, j, k + 1])
        if stiffness > 0.0:
            compliance += 1.0 / stiffness
    force = ((last - first) - (top - bottom)) / compliance if compliance > 0.0 else 0.0
    z[i, j, first] = bottom
    for k in range(first, last):
        stiffness = min(modulus[i, j, k], modulus[i, j, k + 1])
        length = 1.0
        if stiffness > 0.0:
            length = 1.0 - min(force / stiffness, _LARGEST_COMPRESSION)
            widening[i, j, k] = 1.0 / np.sqrt(length)
        z[i, j, k + 1] = z[i, j, k] + length
    if last > first:
        widening[i, j, last] = widening[i, j, last - 1]
