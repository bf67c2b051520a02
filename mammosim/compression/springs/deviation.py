"""The thesis' estimator of how far the nodes still are from equilibrium (its section 3.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def remaining_deviation(sums: ArrayLike, nodes: int) -> tuple[float, float, float]:
    """Mean distance that a node will still move, from the curve of summed displacements.

    The curve is taken as y(i) = exp(-a i + b) through its points at a third of the sweeps and at
    the last; what is left is its integral from the last sweep to infinity, over the nodes.

    Parameters
    ----------
    sums : array_like, (n,)
        Summed absolute displacement of each sweep, along one axis, lattice units.
    nodes : int
        Number of nodes summed over.

    Returns
    -------
    a, b : float
        Parameters of the curve.
    deviation : float
        Lattice units a node; NaN where the curve does not fall or has fewer than three points.

    Examples
    --------
    The thesis' parameters and Table 3.4.4 at 1 000 sweeps:

    >>> sweeps = np.arange(1, 1001)
    >>> a, b, deviation = remaining_deviation(np.exp(-0.0011 * sweeps + 6.0959), 209_980)
    >>> round(deviation, 3)
    0.64
    """
    curve = np.asarray(sums, dtype=np.float64)
    last, third = curve.size, curve.size // 3
    if third < 1 or nodes == 0 or curve[third - 1] <= 0.0 or curve[last - 1] <= 0.0:
        return np.nan, np.nan, np.nan
    a = float(np.log(curve[third - 1] / curve[last - 1]) / (last - third))
    b = float(np.log(curve[last - 1]) + a * last)
    if a <= 0.0:
        return a, b, np.nan
    return a, b, float(np.exp(-a * last + b) / (a * nodes))


def remaining_sweeps(third: float, last: float, sweeps: int, limit: float) -> float:
    """Sweeps until mean displacements fall below a limit, if they go on falling as they do.

    Parameters
    ----------
    third, last : float
        Mean absolute displacement of a node at a third of the sweeps and in the last.
    sweeps : int
        Done so far.
    limit : float

    Returns
    -------
    float
        0 where the last is below already; NaN where they do not fall, after fewer than three
        sweeps, or where no limit is set.

    Examples
    --------
    >>> round(remaining_sweeps(np.exp(-1.0), np.exp(-3.0), 300, np.exp(-5.0)))
    200
    """
    if last <= limit:
        return 0.0
    if sweeps < 3 or limit <= 0.0 or third <= last:
        return np.nan
    rate = np.log(third / last) / (sweeps - sweeps // 3)
    return float(np.log(last / limit) / rate)
