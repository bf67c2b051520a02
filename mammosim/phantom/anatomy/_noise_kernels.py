"""Noise at a point from hashes of lattice points: the same for any order of visits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel, merged_kernel

SCALE = 5.24 / 512.0
"""Makes the variance of the sum over gradients one."""

MOST_NOISE = 16.0
"""A bound of `gradient_noise`: three components of 511.5 at a distance of 1, times `SCALE`."""

MAX_CORNERS = 48
"""Lattice points that are hashed ahead for places close together; beyond it each place has its
own."""


@kernel
def lattice_hash(i: int, j: int, k: int, key: int) -> int:
    """32 well mixed bits of a lattice point; all products stay below 2^63."""
    h = (i * 73856093 ^ j * 19349663 ^ k * 83492791 ^ key * 2654435) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    h = ((h ^ (h >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return h ^ (h >> 15)


@merged_kernel
def _gradient(i: int, j: int, k: int, key: int) -> tuple[float, float, float]:
    """Gradient of the noise at a lattice point, in units of `SCALE`."""
    h = lattice_hash(i, j, k, key)
    return (h & 1023) - 511.5, ((h >> 10) & 1023) - 511.5, ((h >> 20) & 1023) - 511.5


@kernel
def _corner(i: int, j: int, k: int, key: int, x: float, y: float, z: float) -> float:
    gx, gy, gz = _gradient(i, j, k, key)
    return (gx * x + gy * y + gz * z) * SCALE


@merged_kernel
def _fade(t: float) -> float:
    """Weight of the further corner, whose first two derivatives vanish at both ends."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@kernel
def gradient_noise(x: float, y: float, z: float, key: int) -> float:
    """Gradient noise (Perlin 2002, ACM Trans Graph 21:681-682) of mean 0 and variance about 1.

    Lattice gradients are uniform in a cube instead of along its edges, and the sum is scaled so
    that the variance over space is one.
    """
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    x, y, z = x - i, y - j, z - k
    u, v, w = _fade(x), _fade(y), _fade(z)
    total = 0.0
    for a in range(2):
        wu = u if a == 1 else 1.0 - u
        for b in range(2):
            wv = v if b == 1 else 1.0 - v
            low = _corner(i + a, j + b, k, key, x - a, y - b, z)
            high = _corner(i + a, j + b, k + 1, key, x - a, y - b, z - 1.0)
            total += wu * wv * (low + w * (high - low))
    return total


@merged_kernel
def add_noise(
    places: NDArray[np.float64], count: int, key: int, amplitude: float,
    gradients: NDArray[np.float64], span: NDArray[np.int64], total: NDArray[np.float64],
) -> None:  # fmt: skip
    """Add `amplitude` times `gradient_noise` to the totals of places [n, 3] that lie together.

    Corners that they share are hashed once; `gradients` is room for `MAX_CORNERS` of them, `span`
    for the first of them and their number along each axis.
    """
    first, size, corners = span[0], span[1], 1
    for axis in range(3):
        low = high = places[0, axis]
        for n in range(1, count):
            low, high = min(low, places[n, axis]), max(high, places[n, axis])
        first[axis] = int(np.floor(low))
        size[axis] = int(np.floor(high)) - first[axis] + 2
        corners *= size[axis]
    together = corners <= MAX_CORNERS
    for n in range(count):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        if not together:
            first[0], first[1], first[2] = i, j, k
            size[:] = 2
        ny, nz = size[1], size[2]
        if n == 0 or not together:
            for a in range(size[0]):
                for b in range(ny):
                    for c in range(nz):
                        gx, gy, gz = _gradient(first[0] + a, first[1] + b, first[2] + c, key)
                        at = (a * ny + b) * nz + c
                        gradients[at, 0], gradients[at, 1], gradients[at, 2] = gx, gy, gz
        at = ((i - first[0]) * ny + j - first[1]) * nz + k - first[2]
        total[n] += amplitude * _between(gradients, at, ny, nz, x - i, y - j, z - k)


@merged_kernel
def _between(
    gradients: NDArray[np.float64], at: int, ny: int, nz: int, x: float, y: float, z: float
) -> float:
    """Noise within a cell whose first corner is `at`, as `gradient_noise` has it."""
    u, v, w = _fade(x), _fade(y), _fade(z)
    noise = 0.0
    for corner in range(4):
        a, b = corner >> 1, corner & 1
        wu = u if a == 1 else 1.0 - u
        wv = v if b == 1 else 1.0 - v
        c = at + (a * ny + b) * nz
        gx, gy, gz = gradients[c, 0], gradients[c, 1], gradients[c, 2]
        low = (gx * (x - a) + gy * (y - b) + gz * z) * SCALE
        gx, gy, gz = gradients[c + 1, 0], gradients[c + 1, 1], gradients[c + 1, 2]
        high = (gx * (x - a) + gy * (y - b) + gz * (z - 1.0)) * SCALE
        noise += wu * wv * (low + w * (high - low))
    return noise
