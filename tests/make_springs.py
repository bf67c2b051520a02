"""Small spring problems for tests."""

from __future__ import annotations

import numpy as np

from mammosim.compression.springs import SpringProblem


def half_ellipsoid(
    shape: tuple[int, int, int] = (16, 28, 26), gap: float = 0.55, stiff: bool = True
) -> SpringProblem:
    """A small breast with a stiffer core, compressed to a part of its height."""
    nx, ny, nz = shape
    i, j, k = np.ogrid[:nx, :ny, :nz]
    y, z = (ny - 1) / 2, (nz - 1) / 2
    inside = (i / (nx - 1)) ** 2 + ((j - y) / y) ** 2 + ((k - z) / z) ** 2 <= 1
    core = ((i - nx / 3) / 4) ** 2 + ((j - y) / 6) ** 2 + ((k - z) / 5) ** 2 <= 1
    modulus = np.zeros(np.add(shape, 2), np.float32)
    modulus[1:-1, 1:-1, 1:-1] = np.where(inside, np.where(core & stiff, 15.0, 4.5), 0.0)
    fixed = np.zeros(modulus.shape, bool)
    fixed[1] = modulus[1] > 0
    half = 0.5 * gap * (nz - 1)
    return SpringProblem(modulus, fixed, z + 1 - half, z + 1 + half, 1.0 + nx / 5)


def random_lattice(seed: int = 0, shape: tuple[int, int, int] = (6, 7, 8)) -> np.ndarray:
    """Moduli of a ragged lattice of three tissues, air around it."""
    rng = np.random.default_rng(seed)
    modulus = np.zeros(np.add(shape, 2), np.float32)
    modulus[1:-1, 1:-1, 1:-1] = rng.choice([0.0, 4.5, 15.0, 45.0], shape, p=[0.15, 0.5, 0.3, 0.05])
    return modulus
