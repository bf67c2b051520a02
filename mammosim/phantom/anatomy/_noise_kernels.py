"""Noise at a point from hashes of lattice points: the same for any order of visits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel

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


@kernel
def _gradient(i: int, j: int, k: int, key: int) -> tuple[float, float, float]:
    """Gradient at a lattice point, uniform in a cube."""
    h = lattice_hash(i, j, k, key)
    return (h & 1023) - 511.5, ((h >> 10) & 1023) - 511.5, ((h >> 20) & 1023) - 511.5


@kernel
def _slope(gradient: tuple[float, float, float], x: float, y: float, z: float) -> float:
    """What a corner's gradient comes to at a place relative to it."""
    return (gradient[0] * x + gradient[1] * y + gradient[2] * z) * (5.24 / 512.0)


@kernel
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
            low = _slope(_gradient(i + a, j + b, k, key), x - a, y - b, z)
            high = _slope(_gradient(i + a, j + b, k + 1, key), x - a, y - b, z - 1.0)
            total += wu * wv * (low + w * (high - low))
    return total


@kernel
def add_noise(
    places: NDArray[np.float64], count: int, key: int, amplitude: float,
    gradients: NDArray[np.float64], total: NDArray[np.float64],
) -> None:  # fmt: skip
    """Add `amplitude` times `gradient_noise` to the totals of places [n, 3] that lie together.

    Corners that they share are hashed once; `gradients` is room for `MAX_CORNERS` of them.
    """
    i0, i1 = _cells(places, count, 0)
    j0, j1 = _cells(places, count, 1)
    k0, k1 = _cells(places, count, 2)
    ny, nz = j1 - j0 + 2, k1 - k0 + 2
    if (i1 - i0 + 2) * ny * nz > MAX_CORNERS:
        for n in range(count):
            total[n] += amplitude * gradient_noise(places[n, 0], places[n, 1], places[n, 2], key)
        return
    for i in range(i0, i1 + 2):
        for j in range(j0, j1 + 2):
            for k in range(k0, k1 + 2):
                at = ((i - i0) * ny + j - j0) * nz + k - k0
                gradients[at, 0], gradients[at, 1], gradients[at, 2] = _gradient(i, j, k, key)
    for n in range(count):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        at = ((i - i0) * ny + j - j0) * nz + k - k0
        total[n] += amplitude * _between(gradients, at, ny, nz, x - i, y - j, z - k)


@kernel
def _cells(places: NDArray[np.float64], count: int, axis: int) -> tuple[int, int]:
    """First and last lattice cell of places along an axis."""
    low = high = places[0, axis]
    for n in range(1, count):
        low, high = min(low, places[n, axis]), max(high, places[n, axis])
    return int(np.floor(low)), int(np.floor(high))


@kernel
def _between(
    gradients: NDArray[np.float64], at: int, ny: int, nz: int, x: float, y: float, z: float
) -> float:
    """Noise within a cell whose first corner is `at`, as `gradient_noise` has it."""
    u, v, w = _fade(x), _fade(y), _fade(z)
    total = 0.0
    for a in range(2):
        wu = u if a == 1 else 1.0 - u
        for b in range(2):
            wv = v if b == 1 else 1.0 - v
            c = at + (a * ny + b) * nz
            low = _slope((gradients[c, 0], gradients[c, 1], gradients[c, 2]), x - a, y - b, z)
            c += 1
            high = _slope(
                (gradients[c, 0], gradients[c, 1], gradients[c, 2]), x - a, y - b, z - 1.0
            )
            total += wu * wv * (low + w * (high - low))
    return total
