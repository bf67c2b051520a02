"""The skin's thickness over a breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import mesh

LOWER_SHARE = 0.12
"""How much thicker skin is in the lower part of the breast, and thinner in the upper one, relative
(Willson et al. 1982, Clin Radiol 33:691: thickest below and medially)."""

UNEVEN_SHARE = ((0.17, 40.0), (0.11, 11.0))
"""Relative amplitude and wavelength (mm) of the skin's unevenness. Chosen."""


def skin_mm(mean_mm: float, frame: VoxelFrame, rng: np.random.Generator) -> NDArray[np.float64]:
    """Thickness of the skin without the areola's, on the coarse grid, mm."""
    _, _, superior = mesh(frame)
    share = 1.0 - LOWER_SHARE * np.tanh(superior / 40.0)
    for amplitude, wavelength in UNEVEN_SHARE:
        share = share + amplitude * smooth_noise(rng, frame, wavelength)
    thickness: NDArray[np.float64] = mean_mm * np.clip(share, 0.55, 1.6)
    return thickness
