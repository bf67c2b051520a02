"""Smooth noise on the coarse grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame

TILE_EXPONENT = 2.4
"""Of the power spectrum over frequency of the finest noise, in three dimensions, as that of
projections, in which it is the same (Burgess 2003, Proc SPIE 5034, for projections)."""


def smooth_noise(
    rng: np.random.Generator, frame: VoxelFrame, wavelength_mm: float
) -> NDArray[np.float64]:
    """Noise of mean 0 and variance 1 without detail below a wavelength."""
    sigma = wavelength_mm / (2.0 * np.pi) / float(frame.spacing_mm[0])
    noise = ndimage.gaussian_filter(rng.standard_normal(frame.shape), sigma, mode="wrap")
    return (noise - noise.mean()) / noise.std()


def noise_over(
    rng: np.random.Generator, coordinates_mm: list[NDArray[np.float64]], wavelength_mm: float
) -> NDArray[np.float64]:
    """The same in given coordinates, which may be bent: linear between points of a lattice."""
    spacing = wavelength_mm / 6.0
    low = [float(part.min()) for part in coordinates_mm]
    shape = [
        int((part.max() - start) / spacing) + 2
        for part, start in zip(coordinates_mm, low, strict=True)
    ]
    lattice = ndimage.gaussian_filter(rng.standard_normal(shape), 6.0 / (2.0 * np.pi), mode="wrap")
    lattice /= lattice.std()
    at = [(part - start) / spacing for part, start in zip(coordinates_mm, low, strict=True)]
    noise: NDArray[np.float64] = ndimage.map_coordinates(lattice, at, order=1, mode="nearest")
    return noise


def noise_tile(rng: np.random.Generator, side: int, limit: float) -> NDArray[np.int8]:
    """Noise with a power law that repeats after `side` cells, (side, side, side).

    Parameters
    ----------
    rng : Generator
    side : int
    limit : float
        Where it is cut off, in standard deviations; this is 127 in the tile.

    Notes
    -----
    Wavelengths are 2.5 to 20 cells, and power falls with frequency to the `TILE_EXPONENT`.
    """
    spectrum = np.fft.rfftn(rng.standard_normal((side, side, side)))
    first, last = np.fft.fftfreq(side), np.fft.rfftfreq(side)
    squared = first[:, None, None] ** 2 + first[:, None] ** 2 + last**2
    band = (squared > 0.05**2) & (squared < 0.4**2)
    spectrum *= np.where(band, np.maximum(squared, 1e-6) ** (-0.25 * TILE_EXPONENT), 0.0)
    noise = np.fft.irfftn(spectrum, s=(side, side, side), axes=(0, 1, 2))
    scaled = np.clip(noise / noise.std() / limit, -1.0, 1.0)
    return np.rint(127.0 * scaled).astype(np.int8)
