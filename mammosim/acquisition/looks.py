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
    """

    gain: float
    noise_sigma_mm: float


LOOKS = {"crisp": Look(1.6, 0.07), "soft": Look(1.15, 0.11)}
"""Scanners differ in how far they enhance local contrast and suppress noise; these are two ends of
what is seen on clinical images, of no manufacturer in particular."""
