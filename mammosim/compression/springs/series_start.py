"""The thesis' starting state: each column as springs in series (its section 2.7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.springs._series_kernels import series_columns
from mammosim.compression.springs.problem import SpringProblem


def series_start(
    problem: SpringProblem,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Displacement that squeezes each column into its gap, softer springs giving way more.

    Between the plates the gap is theirs; behind their edge it widens linearly to the breast's own
    height at the chest wall. Along x and y the layers widen by 1/sqrt of the column's stretch.

    The printed listing shifts the chest plane up by one unit, and centres a column that fits into
    the gap as it is; here the chest plane stays and a column that fits moves only as far as it
    must. A spring gives way as 1 / min(E) of its two nodes, which is what the lattice has.

    Returns
    -------
    tuple of three ndarray of float64, [x, y, z]
        Displacement along x, y, z, lattice units; 0 where a node is fixed.
    """
    modulus = problem.modulus
    nx, ny, nz = modulus.shape
    z = np.broadcast_to(np.arange(nz, dtype=np.float64), modulus.shape).copy()
    widening = np.ones(modulus.shape)
    span, chest = problem.span(), int(problem.chest)
    series_columns(modulus, span, chest, problem.edge, problem.lower, problem.upper, z, widening)
    x = np.cumsum(widening, axis=0)
    x += chest - x[chest]
    y = np.cumsum(widening, axis=1)
    y += 0.5 * (ny - 1) - 0.5 * (y[:, :1] + y[:, -1:])
    free = problem.tissue & ~problem.fixed
    rest_x, rest_y, rest_z = np.ogrid[:nx, :ny, :nz]
    return (
        np.where(free, x - rest_x, 0.0),
        np.where(free, y - rest_y, 0.0),
        np.where(free, z - rest_z, 0.0),
    )
