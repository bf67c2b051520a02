"""Noise at a point from hashes of lattice points: the same for any order of visits."""

from __future__ import annotations

import numpy as np

from mammosim._jit import kernel


@kernel
def lattice_hash(i: int, j: int, k: int, key: int) -> int:
    """32 well mixed bits of a lattice point; all products stay below 2^63."""
    h = (i * 73856093 ^ j * 19349663 ^ k * 83492791 ^ key * 2654435) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    h = ((h ^ (h >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return h ^ (h >> 15)


@kernel
def _corner(i: int, j: int, k: int, key: int, x: float, y: float, z: float) -> float:
    h = lattice_hash(i, j, k, key)
    return (
        ((h & 1023) - 511.5) * x + (((h >> 10) & 1023) - 511.5) * y
        + (((h >> 20) & 1023) - 511.5) * z
    ) * (5.24 / 512.0)  # fmt: skip


@kernel
def gradient_noise(x: float, y: float, z: float, key: int) -> float:
    """Gradient noise (Perlin 2002, ACM Trans Graph 21:681-682) of mean 0 and variance about 1.

    Lattice gradients are uniform in a cube instead of along its edges, and the sum is scaled so
    that the variance over space is one.
    """
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    x, y, z = x - i, y - j, z - k
    u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    v = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    w = z * z * z * (z * (z * 6.0 - 15.0) + 10.0)
    total = 0.0
    for a in range(2):
        wu = u if a == 1 else 1.0 - u
        for b in range(2):
            wv = v if b == 1 else 1.0 - v
            low = _corner(i + a, j + b, k, key, x - a, y - b, z)
            high = _corner(i + a, j + b, k + 1, key, x - a, y - b, z - 1.0)
            total += wu * wv * (low + w * (high - low))
    return total
