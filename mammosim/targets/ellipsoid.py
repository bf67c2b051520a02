"""Where a vector lies with 95 % probability, from samples of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import fdtri

LEVEL = 0.95
"""Probability inside an ellipsoid: the level that is customary for confidence regions."""


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """Mean, covariance and prediction ellipsoid of a vector.

    Parameters
    ----------
    mean_mm : ndarray, (3,)
    covariance_mm2 : ndarray, (3, 3)
    semi_axes_mm : ndarray, (3,)
        Longest first.
    directions : ndarray, (3, 3)
        Unit vector of each axis, one a row; the component of largest size is positive.
    """

    mean_mm: NDArray[np.float64]
    covariance_mm2: NDArray[np.float64]
    semi_axes_mm: NDArray[np.float64]
    directions: NDArray[np.float64]

    def contains(self, vectors_mm: ArrayLike) -> NDArray[np.bool_]:
        """(n,) whether vectors (n, 3) lie inside; along an axis of no length, exactly on it."""
        along = (np.atleast_2d(vectors_mm) - self.mean_mm) @ self.directions.T
        flat = np.where(along == 0.0, 0.0, np.inf)
        share = np.divide(along, self.semi_axes_mm, out=flat, where=self.semi_axes_mm > 0.0)
        return np.asarray((share**2).sum(axis=1) <= 1.0)


def prediction_ellipsoid(samples_mm: ArrayLike, level: float = LEVEL) -> Ellipsoid:
    """Ellipsoid in which one more sample would lie with a given probability.

    Parameters
    ----------
    samples_mm : array_like, (n, 3)
        At least 5.
    level : float

    Notes
    -----
    For n samples of a normal distribution in p = 3 dimensions a further one x satisfies::

        (x - mean)' S^-1 (x - mean) <= p (n^2 - 1) / (n (n - p)) F(p, n - p)

    with the given probability, S being the samples' covariance and F the quantile of Fisher's
    distribution (Johnson & Wichern, Applied Multivariate Statistical Analysis, section 5.4). For
    large n this is chi-squared's 7.81 at 95 %; for 50 samples it is 9.1. What is drawn evenly has
    shorter tails than the normal distribution: the ellipsoid is then a little too large.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> found = prediction_ellipsoid(rng.normal(size=(2000, 3)))
    >>> bool(abs(found.semi_axes_mm - 7.81**0.5).max() < 0.15)
    True
    """
    samples = np.asarray(samples_mm, dtype=float)
    n, p = samples.shape
    # About the first: samples that are all the same have no spread, not even by rounding.
    covariance = np.cov(samples - samples[0], rowvar=False)
    variances, axes = np.linalg.eigh(covariance)
    factor = p * (n**2 - 1.0) / (n * (n - p)) * fdtri(p, n - p, level)
    directions = axes.T[::-1]
    largest = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
    return Ellipsoid(
        samples.mean(axis=0),
        covariance,
        np.sqrt(factor * np.maximum(variances[::-1], 0.0)),
        directions * np.where(largest < 0.0, -1.0, 1.0),
    )


def quantile(values: NDArray[np.float64], level: float = LEVEL) -> float:
    """Quantile of samples of a length, NaN where there are none."""
    return float(np.quantile(values, level)) if values.size else math.nan
