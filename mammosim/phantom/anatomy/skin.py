"""The skin's thickness over a breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import mesh

SKIN_MEAN_MM, SKIN_RANGE_MM = (1.44, 0.25), (0.87, 2.34)
"""Mean and standard deviation over women of the skin's mean thickness, and its range, mm (Shi et
al. 2013, Med Phys 40(3): 136 women, breast CT)."""

LOWER_SHARE, MEDIAL_SHARE = 0.20, 0.10
"""How much thicker skin is in the lower and in the medial part of the breast, and thinner in the
upper and the lateral one, relative (Willson et al. 1982, Clin Radiol 33:691: thickest below and
medially, by up to 100 %; the numbers are a choice)."""

UNEVEN_SHARE = ((0.20, 40.0), (0.12, 11.0), (0.15, 7.0))
"""Relative amplitude and wavelength (mm) of the skin's unevenness. Chosen; the shortest is that of
the fat lobules that the skin's inner face follows, so that this face seen along its surface is no
sharp line. Over the breasts of 250 women skin is 0.5 to 2.7 mm thick, 1.5 on average above, 1.7
below, 1.5 medially and 1.3 laterally (middles of the ranges; Pope et al. 1984, J Can Assoc Radiol
35:365)."""


def skin_mm(mean_mm: float, frame: VoxelFrame, rng: np.random.Generator) -> NDArray[np.float64]:
    """Thickness of the skin without the areola's, on the coarse grid, mm."""
    _, lateral, superior = mesh(frame)
    share = 1.0 - LOWER_SHARE * np.tanh(superior / 40.0) - MEDIAL_SHARE * np.tanh(lateral / 40.0)
    streams = (rng, rng, *rng.spawn(1))
    for (amplitude, wavelength), stream in zip(UNEVEN_SHARE, streams, strict=True):
        share = share + amplitude * smooth_noise(stream, frame, wavelength)
    thickness: NDArray[np.float64] = mean_mm * np.clip(share, 0.5, 1.7)
    return thickness
