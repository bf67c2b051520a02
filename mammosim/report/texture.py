"""How steeply the power spectrum of the breast's texture falls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition import Mammogram

SQUARE_MM = 25.0
"""Side of the regions, as Burgess et al. 2001 (Med Phys 28:419) took them, mm."""

BAND_PER_MM = (0.15, 0.7)
"""Frequencies of the fit: below, the window's own shape; above, noise and blur, 1/mm."""

CLEAR_OF_SKIN_MM = 12.0
"""Squares keep this far from the skin line, where the thickness falls off, mm."""

_GRID_MM = 2.5  # on which squares are placed and distances from the skin taken


def power_law_exponent(mammogram: Mammogram) -> float:
    """Exponent b of the texture's power spectrum, P(f) proportional to 1/f^b.

    Parameters
    ----------
    mammogram : Mammogram

    Returns
    -------
    float
        Median over squares of 25 mm; NaN where no square lies inside the breast.

    Notes
    -----
    The logarithm of the for-processing picture, which is linear in thickness, is used. Squares
    overlap by half and keep clear of the skin line; the pectoral muscle is not told from the
    rest. Each is freed of its mean plane, windowed (Hann), and its periodogram averaged over
    rings; the slope is a straight line through log power over log frequency. Frequencies are
    those on the detector.
    """
    pitch = mammogram.gantry.pixel_mm
    side = round(SQUARE_MM / pitch)
    corners = _squares(mammogram.for_presentation > 0, pitch, side)
    window = np.outer(np.hanning(side), np.hanning(side))
    slopes = [
        _slope(np.log(np.maximum(mammogram.for_processing[r : r + side, c : c + side], 1)),
               window, pitch)
        for r, c in corners
    ]  # fmt: skip
    return float(np.median(slopes)) if slopes else math.nan


def _squares(breast: NDArray[np.bool_], pitch_mm: float, side: int) -> list[tuple[int, int]]:
    """First row and column of each square, half a side apart, that lies well inside the breast."""
    cell = max(1, round(_GRID_MM / pitch_mm))
    coarse = breast[::cell, ::cell]
    # What lies beyond the picture's border is taken to be breast: it is cut off there.
    depth_mm = ndimage.distance_transform_edt(np.pad(coarse, 1, mode="edge"))[1:-1, 1:-1]
    inside = depth_mm * cell * pitch_mm > CLEAR_OF_SKIN_MM
    rows, columns = breast.shape
    step = max(1, side // 2)

    def cells(first: int) -> slice:
        return slice(first // cell, -(-(first + side) // cell))

    return [
        (row, column)
        for row in range(0, rows - side + 1, step)
        for column in range(0, columns - side + 1, step)
        if inside[cells(row), cells(column)].all()
    ]


def _slope(values: NDArray[np.float64], window: NDArray[np.float64], pitch_mm: float) -> float:
    """Exponent of one square's spectrum."""
    side = len(values)
    power = np.abs(np.fft.fft2(_without_plane(values) * window)) ** 2
    frequency = np.fft.fftfreq(side, pitch_mm)
    radius = np.hypot(frequency[:, None], frequency)
    ring = np.rint(radius * side * pitch_mm).astype(np.int64)
    count = np.bincount(ring.ravel())
    mean_power = np.bincount(ring.ravel(), power.ravel()) / count
    mean_radius = np.bincount(ring.ravel(), radius.ravel()) / count
    low, high = BAND_PER_MM
    used = (mean_radius >= low) & (mean_radius <= high) & (mean_power > 0.0)
    if np.count_nonzero(used) < 2:
        return math.nan
    slope, _ = np.polyfit(np.log(mean_radius[used]), np.log(mean_power[used]), 1)
    return float(-slope)


def _without_plane(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values less their least-squares plane."""
    side = len(values)
    ramp = np.arange(side) - 0.5 * (side - 1)
    scale = (ramp**2).sum() * side
    down, along = (values * ramp[:, None]).sum() / scale, (values * ramp).sum() / scale
    flat: NDArray[np.float64] = values - values.mean() - down * ramp[:, None] - along * ramp
    return flat
