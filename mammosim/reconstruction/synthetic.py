"""A two-dimensional picture made of the slices: ours, and like no manufacturer's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition import present

DETAIL_MM = 1.0
"""Standard deviation of the Gaussian in the slice that parts details from what is around them."""

DEPTH_MM = 4.0
"""A detail is shown as strong as this thickness of its densest slice. Chosen by eye; the artefact
spread function of a wide arc is about as long."""

BIAS_MM = 6.0
"""Standard deviation of the Gaussian over which the largest of many slices' noise is averaged and
taken away, mm."""

AIR_SHARE, TISSUE_SHARE = 0.2, 0.4
"""Of the 99th percentile of all slices: what is below the first, smoothed as above, is air and not
shown, what is above the second is tissue; linear between. Fat has 0.5 or more. A narrow arc spreads
the skin into slices above and below it, where there is only air."""

METHOD = "sum of the slices, and the largest detail of all slices at each place"
"""In words, for files and the report."""


@dataclass(frozen=True, eq=False)
class Synthetic:
    """A picture like a mammogram, made of slices.

    Parameters
    ----------
    attenuation : ndarray of float32, [row, column]
        About as the logarithm of a mammogram's signal; no unit.
    pixels : ndarray of uint16, [row, column]
        For reading, 12 bits, bright is dense.
    """

    attenuation: NDArray[np.float32]
    pixels: NDArray[np.uint16]


def synthetic_mammogram(slices: NDArray[np.float32], slice_mm: float, pixel_mm: float) -> Synthetic:
    """Make one picture of all slices.

    Parameters
    ----------
    slices : ndarray of float32, [slice, row, column]
        Attenuation coefficient, 1/mm; not `fdk`'s, whose mean is not known.
    slice_mm, pixel_mm : float
        Distance between slices, and between rows and columns, mm.

    Returns
    -------
    Synthetic

    Notes
    -----
    The sum of the slices, without the faint shadows beside the breast (`AIR_SHARE`), is the
    attenuation straight from above, with the grain of all projections together. In it a
    calcification is as faint as in one slice over the thickness of the breast: SART spreads it over
    depth. So the excess of each slice over a Gaussian mean around is found, weighted by 1, 2 and 1
    over neighbouring slices, and the largest of all slices, times `DEPTH_MM`, is added. The largest
    of many slices' noise is above zero nearly everywhere alike; its mean over `BIAS_MM` is taken
    away. The sum is then shown as a mammogram is (`present`). It has not been compared with what
    manufacturers compute.
    """
    total = np.zeros(slices.shape[1:], np.float32)
    largest = np.full(slices.shape[1:], -np.inf, np.float32)
    last, high = len(slices) - 1, float(np.quantile(slices[:, ::8, ::8], 0.99))
    air, span = AIR_SHARE * high, max((TISSUE_SHARE - AIR_SHARE) * high, 1e-12)
    for number, plane in enumerate(slices):
        around = slices[max(number - 1, 0)] + slices[min(number + 1, last)]
        weighted = 0.5 * plane + 0.25 * around
        smooth = ndimage.gaussian_filter(weighted, DETAIL_MM / pixel_mm)
        tissue = np.clip((smooth - air) / span, 0.0, 1.0)
        total += tissue * plane
        np.maximum(largest, tissue * (weighted - smooth), out=largest)
    total *= np.float32(slice_mm)
    largest -= ndimage.gaussian_filter(largest, BIAS_MM / pixel_mm)
    attenuation = total + np.float32(DEPTH_MM) * largest
    return Synthetic(attenuation, present(attenuation, pixel_mm).pixels)
