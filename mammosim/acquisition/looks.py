"""Looks of the For Presentation image."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """How strongly details are shown.

    Parameters
    ----------
    gains : tuple of float
        Contrast of details over that of the base, which is wider than half a window of 5 mm: of
        those down to half a window of 1.5 mm, and of finer ones.
    noise_sigma_mm : float
        Width of the smoothing that takes out the finest noise, mm.
    sharpness : float
        Part by which what is finer than `SHARP_MM` is raised before all else, to make up for what
        focal spot, detector and voxels have blurred.
    """

    gains: tuple[float, float]
    noise_sigma_mm: float
    sharpness: float


SHARP_MM = 0.2
"""Width of the Gaussian above which sharpness does nothing, mm."""

SHARP_LIMIT = 0.02
"""Details (ln) well below this are raised in full, those above not at all."""

LOOKS = {"crisp": Look((1.35, 1.9), 0.055, 0.7), "soft": Look((1.1, 1.35), 0.06, 0.2)}
"""Scanners differ in how far they enhance local contrast and suppress noise; these are two ends of
what is seen on clinical images, of no manufacturer in particular."""
