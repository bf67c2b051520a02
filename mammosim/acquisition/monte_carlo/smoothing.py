"""Smoothing of scored scatter along the shape that it is expected to have, and the noise left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

SMOOTHING_MM = 5.0
"""Standard deviation of the Gaussian on the detector, mm. What is smoothed is scatter over its
expected shape; the bias is measured in docs/explanation/scatter.md: at most 1.8 % in any region of
a slab, where a Gaussian of 4 mm over the scatter itself leaks by up to 12 % at an edge."""


@dataclass(frozen=True, eq=False)
class Guide:
    """What smoothing is guided by.

    Parameters
    ----------
    shape : ndarray of float64, [row, column]
        Expected scatter in any unit, positive, margin included.
    below : ndarray of bool, [row, column]
        Cells straight below the breast; these and the others are smoothed apart.
    cell_mm : float
    """

    shape: NDArray[np.float64]
    below: NDArray[np.bool_]
    cell_mm: float


def smoothed(image: NDArray[np.float64], guide: Guide) -> NDArray[np.float64]:
    """Smooth the last two axes of an array.

    Parameters
    ----------
    image : ndarray of float64, [..., row, column]
        With a margin.
    guide : Guide

    Notes
    -----
    ``K G(S 1) / G(K 1)`` in each class of cells, G being a Gaussian of `SMOOTHING_MM`, S the image,
    K the shape and 1 the class. A sum over cells with weights that do not depend on S: its mean is
    right where S over K varies little within the Gaussian, and noise stays what the batches say.
    """
    result = np.zeros(image.shape)
    for cells in (guide.below, ~guide.below):
        if not cells.any():
            continue
        level = _blurred(guide.shape * cells, guide.cell_mm)
        scale = np.divide(guide.shape, level, out=np.zeros_like(level), where=cells)
        result += scale * _blurred(image * cells, guide.cell_mm)
    return result


def _blurred(image: NDArray[np.float64], cell_mm: float) -> NDArray[np.float64]:
    """Gaussian over the last two axes, with nothing beyond the edges."""
    blurred: NDArray[np.float64] = image
    for axis in (-2, -1):
        blurred = ndimage.gaussian_filter1d(
            blurred, SMOOTHING_MM / cell_mm, axis=axis, mode="constant"
        )
    return blurred


def smoothed_scatter(
    batches: NDArray[np.float64], margin: int, guide: Guide
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of independent batches, smoothed, and its standard error; without the margin.

    Parameters
    ----------
    batches : ndarray of float64, [batch, row, column]
    margin : int
        Cells on each side that are dropped afterwards.
    guide : Guide

    Returns
    -------
    mean, error : ndarray of float64, [row, column]
    """
    inner = (slice(None), slice(margin, -margin), slice(margin, -margin))
    each = smoothed(batches, guide)[inner]
    mean = np.maximum(each.mean(axis=0), 0.0)
    return mean, each.std(axis=0, ddof=1) / np.sqrt(len(each))
