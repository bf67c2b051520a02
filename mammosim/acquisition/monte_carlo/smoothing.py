"""Smoothing of scored scatter, and the noise that is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

SMOOTHING_MM = 4.0
"""Standard deviation of the Gaussian on the detector, mm. Scatter has crossed an air gap of 15 mm
or more and varies over centimetres; the bias is measured in docs/explanation/scatter.md."""


def smoothed(image: NDArray[np.float64], cell_mm: float) -> NDArray[np.float64]:
    """Smooth the last two axes of an array by a Gaussian of `SMOOTHING_MM`.

    Parameters
    ----------
    image : ndarray of float64, [..., row, column]
        With a margin; it goes on beyond its edges as it ends there.
    cell_mm : float
    """
    sigma = SMOOTHING_MM / cell_mm
    blurred: NDArray[np.float64] = image
    for axis in (-2, -1):
        blurred = ndimage.gaussian_filter1d(blurred, sigma, axis=axis, mode="nearest")
    return blurred


def smoothed_scatter(
    batches: NDArray[np.float64], margin: int, cell_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of independent batches, smoothed, and its standard error; without the margin.

    Parameters
    ----------
    batches : ndarray of float64, [batch, row, column]
    margin : int
        Cells on each side that are dropped afterwards.
    cell_mm : float

    Returns
    -------
    mean, error : ndarray of float64, [row, column]
    """
    inner = (slice(None), slice(margin, -margin), slice(margin, -margin))
    each = smoothed(batches, cell_mm)[inner]
    mean = np.maximum(each.mean(axis=0), 0.0)
    return mean, each.std(axis=0, ddof=1) / np.sqrt(len(each))
