"""Looks of the For Presentation image."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """How strongly details are shown.

    Parameters
    ----------
    gain : float
        Contrast of details finer than half a window of 5 mm over that of the base.
    noise_sigma_mm : float
        Width of the smoothing that takes out the finest noise, mm.
    sharpness : float
        Part by which what is finer than `SHARP_MM` is raised before all else, to make up for what
        focal spot, detector and voxels have blurred.
    """

    gain: float
    noise_sigma_mm: float
    sharpness: float


SHARP_MM = 0.2
"""Width of the Gaussian above which sharpness does nothing, mm."""

SHARP_LIMIT = 0.02
"""Details (ln) well below this are raised in full, those above not at all."""

LOOKS = {"crisp": Look(1.5, 0.055, 0.8), "soft": Look(1.2, 0.06, 0.2)}
"""Scanners differ in how far they enhance local contrast and suppress noise; these are two ends of
what is seen on clinical images, of no manufacturer in particular."""
