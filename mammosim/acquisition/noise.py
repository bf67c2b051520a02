"""What the detector makes of the photons: quantum noise, blur, fixed pattern, electronic noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.blur import filter_image
from mammosim.acquisition.detectors import Detector

PATTERN_SEED = 20110131  # one detector has one fixed pattern, whatever the exposure's seed


def detect(
    signal_kev: NDArray[np.float32],
    variance_kev2: NDArray[np.float32] | None,
    detector: Detector,
    pixel_mm: float,
    rng: np.random.Generator,
) -> None:
    """Turn expected absorbed energy into a recorded image, in place.

    Parameters
    ----------
    signal_kev : ndarray of float32, [row, column]
        Expected energy a pixel, keV; overwritten with the recorded one.
    variance_kev2 : ndarray of float32, [row, column], or None
        Variance of the energy by quantum noise, keV2, overwritten; None for no noise at all.
    detector : Detector
    pixel_mm : float
    rng : numpy.random.Generator
        Source of the noise; the numbers drawn do not depend on the number of threads.

    Notes
    -----
    Quantum noise is drawn a pixel, normal, with the variance of a compound Poisson process, and
    blurred together with the signal by the converter alone: the pixel's aperture belongs to the
    sampling, and blurring pixel noise with it would remove 40 per cent of the variance. With some
    hundred photons a pixel and more the normal law holds. Electronic noise and the fixed pattern
    come after the blur: variance ``e + q p + s p^2``.
    """
    if variance_kev2 is not None:
        np.sqrt(variance_kev2, out=variance_kev2)
        variance_kev2 *= rng.standard_normal(signal_kev.shape, dtype=np.float32)
        signal_kev += variance_kev2
    filter_image(signal_kev, lambda u, v: detector.transfer(np.hypot(u, v)), pixel_mm)
    if variance_kev2 is not None:
        pattern = np.random.Generator(np.random.Philox(PATTERN_SEED))
        pattern.standard_normal(out=variance_kev2, dtype=np.float32)
        variance_kev2 *= np.float32(detector.structure_noise)
        variance_kev2 *= signal_kev
        signal_kev += variance_kev2
        rng.standard_normal(out=variance_kev2, dtype=np.float32)
        variance_kev2 *= np.float32(detector.electronic_noise_kev)
        signal_kev += variance_kev2


def noise_through_blur(detector: Detector, pixel_mm: float) -> float:
    """Share of white pixel noise's variance that the converter's blur leaves.

    Mean of the squared transfer function over the frequencies that pixels carry.
    """
    axis = (np.arange(256) + 0.5) / 512.0 / pixel_mm
    return float(np.mean(detector.transfer(np.hypot(axis[:, None], axis[None, :])) ** 2))
