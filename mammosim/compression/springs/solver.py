"""The fast solver of the springs, linear or not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.compression.springs import equilibrium
from mammosim.compression.springs.exponential import solve_exponential
from mammosim.compression.springs.problem import SpringProblem, SpringState


def solve(
    problem: SpringProblem,
    tolerance: float = 1e-3,
    start: SpringState | None = None,
    watch: Callable[[np.void], None] | None = None,
) -> SpringState:
    """Equilibrium of the lattice by multigrid.

    Parameters
    ----------
    problem : SpringProblem
    tolerance : float
        Largest estimated distance of a node from equilibrium, lattice units.
    start : SpringState, optional
        Where to start from.
    watch : callable, optional
        Called with each row of the history. A `KeyboardInterrupt` ends the iteration and keeps
        what was reached.

    Returns
    -------
    SpringState
    """
    if problem.stiffening is None:
        return equilibrium.solve(problem, tolerance, start, watch)
    return solve_exponential(problem, tolerance, start, watch)
