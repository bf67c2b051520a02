"""The skin's thickness over a breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import mesh

LOWER_SHARE, MEDIAL_SHARE = 0.20, 0.10
"""How much thicker skin is in the lower and in the medial part of the breast, and thinner in the
upper and the lateral one, relative (Willson et al. 1982, Clin Radiol 33:691: thickest below and
medially; the numbers are a choice)."""

UNEVEN_SHARE = ((0.20, 40.0), (0.12, 11.0))
"""Relative amplitude and wavelength (mm) of the skin's unevenness. Chosen."""


def skin_mm(mean_mm: float, frame: VoxelFrame, rng: np.random.Generator) -> NDArray[np.float64]:
    """Thickness of the skin without the areola's, on the coarse grid, mm."""
    _, lateral, superior = mesh(frame)
    share = 1.0 - LOWER_SHARE * np.tanh(superior / 40.0) - MEDIAL_SHARE * np.tanh(lateral / 40.0)
    for amplitude, wavelength in UNEVEN_SHARE:
        share = share + amplitude * smooth_noise(rng, frame, wavelength)
    thickness: NDArray[np.float64] = mean_mm * np.clip(share, 0.5, 1.7)
    return thickness
