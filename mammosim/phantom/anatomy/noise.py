"""Smooth noise on the coarse grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame


def smooth_noise(
    rng: np.random.Generator, frame: VoxelFrame, wavelength_mm: float
) -> NDArray[np.float64]:
    """Noise of mean 0 and variance 1 without detail below a wavelength."""
    sigma = wavelength_mm / (2.0 * np.pi) / float(frame.spacing_mm[0])
    noise = ndimage.gaussian_filter(rng.standard_normal(frame.shape), sigma, mode="wrap")
    return (noise - noise.mean()) / noise.std()
