"""The `relaxation` solver: the thesis' own iteration, compiled, sequential and seeded.

Each sweep visits all nodes in a random order of x, y and z and moves each to its local
equilibrium. It stops where the mean |dx|, |dy| and |dz| of the nodes between the plates that touch
neither are each below a limit. The printed listing lets a node that starts outside the gap pass
through the plates, and bounds whichever nodes lie under them at the moment, which makes the result
depend on the path; here no node passes, and those that lie under them at rest are bounded.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.compression.springs._relaxation_kernels import Springs, mark_nodes, sweep
from mammosim.compression.springs.deviation import remaining_deviation, remaining_sweeps
from mammosim.compression.springs.measures import cell_totals
from mammosim.compression.springs.problem import SpringProblem, SpringState
from mammosim.compression.springs.resolution import Displacement
from mammosim.compression.springs.series_start import series_start

THESIS_LIMIT = 1e-4
"""Mean displacement of a node in a sweep at which the thesis stops, lattice units."""

HISTORY = np.dtype(
    [
        ("sweep", np.int32),
        ("sum_dx_voxel", np.float64),
        ("sum_dy_voxel", np.float64),
        ("sum_dz_voxel", np.float64),
        ("nodes_counted", np.int64),
        ("volume_change_percent", np.float64),
        ("inverted_cells", np.int64),
        ("sweeps_left", np.float64),
    ]
)
"""Volume, inverted cells and the sweeps expected to be left are looked at every `LOOK_EVERY` sweeps
and stand unchanged in the rows between."""

LOOK_EVERY = 10
"""Sweeps; what is looked at costs a twentieth of a sweep."""


def relax(
    problem: SpringProblem,
    limit: float = THESIS_LIMIT,
    max_sweeps: int = 20_000,
    seed: int = 1,
    start: SpringState | None = None,
    watch: Callable[[np.void], None] | None = None,
) -> SpringState:
    """Relax the lattice as the thesis does.

    Parameters
    ----------
    problem : SpringProblem
    limit : float
        Mean |dx|, |dy| and |dz| below which it stops, lattice units a sweep.
    max_sweeps : int
    seed : int
        Of the visiting order.
    start : SpringState, optional
        Where to start from; otherwise springs in series (section 2.7).
    watch : callable, optional
        Called with each row of the history. A `KeyboardInterrupt` ends the iteration and keeps
        what was reached.

    Returns
    -------
    SpringState
        Its error is the estimated mean distance from equilibrium (section 3.4), the largest of
        the three axes.
    """
    rest = np.indices(problem.modulus.shape, dtype=np.float64)
    displacement = start.displacement if start is not None else series_start(problem)
    x, y, z = (place + u for place, u in zip(rest, displacement, strict=True))
    plates, chest = problem.plates, float(problem.chest)
    if not np.isfinite(problem.edge):  # no plates: every node counts
        plates = plates._replace(edge=-np.inf)
    visited = np.zeros(problem.modulus.shape, np.uint8)
    mark_nodes(problem.modulus, problem.fixed, visited)
    springs = Springs(problem.modulus, problem.stiffening, problem.force, visited)
    rng, sums = np.random.default_rng(seed), np.zeros(4)
    rows: list[np.void] = []
    look: tuple[float, float, float] = (np.nan, 0, np.nan)
    converged = interrupted = False
    try:
        for number in range(1, max_sweeps + 1):
            orders = tuple(rng.permutation(np.arange(1, n - 1)) for n in problem.modulus.shape)
            sweep(springs, x, y, z, orders, plates, chest, sums)
            if number % LOOK_EVERY == 1:
                moved = (x - rest[0], y - rest[1], z - rest[2])
                look = (*_volume(problem, moved), _sweeps_left(rows, limit))
            row = np.array([(number, *sums[:3], int(sums[3]), *look)], HISTORY)[0]
            rows.append(row)
            if watch is not None:
                watch(row)
            converged = bool(np.all(sums[:3] < limit * sums[3])) or not sums[:3].any()
            if converged:
                break
    except KeyboardInterrupt:
        interrupted = True
    history = np.array(rows, HISTORY)
    moved = (x - rest[0], y - rest[1], z - rest[2])
    return SpringState(moved, converged, _deviation(history), history, interrupted)


def _volume(problem: SpringProblem, displacement: Displacement) -> tuple[float, float]:
    """Loss of volume in percent, and inverted cells."""
    cells, volume, inverted = cell_totals(problem, displacement)
    return 100.0 * (1.0 - volume / cells) if cells else 0.0, inverted


def _sweeps_left(rows: list[np.void], limit: float) -> float:
    """Sweeps until the mean displacement is below the limit along each axis."""
    if not rows:
        return np.nan
    number = len(rows)

    def mean(row: np.void, axis: str) -> float:
        return float(row[f"sum_d{axis}_voxel"] / max(row["nodes_counted"], 1))

    third, last = rows[max(number // 3 - 1, 0)], rows[-1]
    return max(remaining_sweeps(mean(third, a), mean(last, a), number, limit) for a in "xyz")


def _deviation(history: np.ndarray) -> float:
    if history.size == 0:
        return float("nan")
    nodes = int(history["nodes_counted"][-1])
    each = [remaining_deviation(history[f"sum_d{axis}_voxel"], nodes)[2] for axis in "xyz"]
    return float(np.nanmax(each)) if np.isfinite(each).any() else float("nan")
