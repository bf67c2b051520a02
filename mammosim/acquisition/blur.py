"""Blur of whole pictures by their transfer function: focal spot, pixel, converter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from mammosim.geometry import Gantry

MARGIN_MM = 3.0  # converters spread light by tenths of a millimetre


def filter_image(
    image: NDArray[np.float32],
    transfer: Callable[[float, NDArray[np.float64]], NDArray[np.float64]],
    pixel_mm: float,
) -> None:
    """Multiply a picture's spectrum, in place; it goes on beyond its edges as it ends there.

    Parameters
    ----------
    image : ndarray of float32, [row, column]
    transfer : callable
        Takes a frequency along the rows' axis and those along the columns' axis (n,), 1/mm, and
        gives the factors (n,).
    pixel_mm : float
    """
    margin = round(MARGIN_MM / pixel_mm)
    rows, columns = (fft.next_fast_len(n + 2 * margin, real=True) for n in image.shape)
    below, right = rows - image.shape[0] - margin, columns - image.shape[1] - margin
    padded = np.pad(image, ((margin, below), (margin, right)), mode="edge")
    spectrum = fft.rfft2(padded, overwrite_x=True)
    row_frequency = fft.fftfreq(rows, pixel_mm)
    column_frequency = fft.rfftfreq(columns, pixel_mm)
    for index, frequency in enumerate(row_frequency):  # a row at a time: no second full-size array
        spectrum[index] *= transfer(float(frequency), column_frequency)
    blurred = fft.irfft2(spectrum, (rows, columns), overwrite_x=True)
    image[:] = blurred[margin : margin + image.shape[0], margin : margin + image.shape[1]]


def spot_width_mm(spot_mm: float, gantry: Gantry, height_mm: float) -> float:
    """Width on the detector of the shadow that a point throws, mm.

    Parameters
    ----------
    spot_mm : float
        Side of the focal spot, mm.
    gantry : Gantry
    height_mm : float
        Height of the point above the breast support, mm.

    Examples
    --------
    A spot of 0.3 mm, 650 mm above the detector, and a point 40 mm above it: 40/610 of the spot.

    >>> from mammosim.geometry import View
    >>> gantry = Gantry(View("CC", "L"), 0.0, 0.0, 650.0, 15.0, 0.0, 0.1, 100, 100, -5.0)
    >>> round(spot_width_mm(0.3, gantry, 25.0), 5)
    0.01967
    """
    above = height_mm + gantry.support_to_detector_mm
    return spot_mm * above / (gantry.focal_spot_height_mm - above)


def blur_shadow(
    signal: NDArray[np.float32],
    square: NDArray[np.float32],
    pixel_mm: float,
    spot_shadow_mm: float,
) -> None:
    """Average the signal over the focal spot and over each pixel's area, in place.

    Parameters
    ----------
    signal, square : ndarray of float32, [row, column]
        Energy along the ray to each pixel's centre and its second moment; their ratio is kept.
    pixel_mm : float
    spot_shadow_mm : float
        Width of the focal spot's image on the detector, mm.

    Notes
    -----
    Transfer function ``sinc(p u) sinc(p v) sinc(w u) sinc(w v)``: a square pixel without gaps and
    a square spot of even brightness. Rays meet pixels at their centres, so that detail finer than
    the pixels aliases before it is averaged.
    """
    np.divide(square, signal, out=square, where=signal > 0.0)

    def side(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sinc(pixel_mm * frequency) * np.sinc(spot_shadow_mm * frequency)

    filter_image(signal, lambda u, v: side(np.array(u)) * side(v), pixel_mm)
    np.maximum(signal, 0.0, out=signal)  # beside metal the filter may dip below nothing
    square *= signal
