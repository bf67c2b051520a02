"""The `multigrid` solver: equilibrium of the spring lattice as one obstacle problem.

The equation along z contains neither x nor y, except for which nodes lie between the plates; with
z known, those along x and y are linear. The plates are an obstacle along z, the chest wall one
along x; which nodes they hold is found by the primal-dual active set method (Hintermueller, Ito &
Kunisch 2003, SIAM J. Optim. 13:865), monotone here because the operator is an M-matrix. A lattice
of half the resolution, solved first, gives the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs import _vector_kernels as vectors
from mammosim.compression.springs.multigrid import (
    LatticeLevel,
    Multigrid,
    Workspace,
    conjugate_gradients,
)
from mammosim.compression.springs.problem import CHEST_WALL_INDEX, SpringProblem, SpringState
from mammosim.compression.springs.resolution import Displacement, coarsened, interpolated

HISTORY = np.dtype(
    [
        ("iteration", np.int32),
        ("nodes", np.int64),
        ("axis", "U1"),
        ("error_estimate_voxel", np.float64),
        ("nodes_held", np.int64),
    ]
)

SMALLEST_START = 20_000
"""A lattice with no more tissue nodes than this starts from rest, not from a coarser one."""

COARSE_TOLERANCE = 0.02
"""Of a lattice that only gives a start, its own units: below what its coarseness costs."""

REDUCTION = 0.05
"""Part of the error that one axis keeps in a round: one step or two of conjugate gradients."""

LEAVING = 0.5
"""How far behind the plates' edge a node must be to have come out, lattice units. A node near the
edge may be pulled out from between the plates by what they do to it, and back in by what they then
do not: for such a node no equilibrium exists. One that returns therefore stays for good, so that
nothing ever passes through the plates."""

SLACK = 0.1
"""Part of the tolerance by which a held node must draw back before it is let go."""

STALE_PART = 0.1
"""Of the held nodes may change before the coarse operators are made anew."""

MAX_ROUNDS = 80
"""Over z, x and y, while nodes touch the plates and slide under their edge; 10 to 20 are usual."""

START_ROUNDS = 8
"""Of a lattice that only gives a start."""


def solve(
    problem: SpringProblem,
    tolerance: float = 1e-3,
    start: SpringState | None = None,
    watch: Callable[[np.void], None] | None = None,
) -> SpringState:
    """Equilibrium of the lattice.

    Parameters
    ----------
    problem : SpringProblem
    tolerance : float
        Largest estimated distance of a node from equilibrium, lattice units.
    start : SpringState, optional
        Where to start from; otherwise a lattice of half the resolution is solved first.
    watch : callable, optional
        Called with each row of the history.

    Returns
    -------
    SpringState
    """
    return _solve(problem, tolerance, MAX_ROUNDS, start, watch)


def _solve(
    problem: SpringProblem,
    tolerance: float,
    max_rounds: int,
    start: SpringState | None,
    watch: Callable[[np.void], None] | None,
) -> SpringState:
    run = _Run(problem, tolerance, max_rounds, watch)
    if start is not None:
        ux, uy, uz = (np.array(u, dtype=np.float64) for u in start.displacement)
        displacement = (ux, uy, uz)
    elif np.count_nonzero(problem.modulus) > SMALLEST_START:
        coarse = coarsened(problem)
        half = _solve(coarse, max(tolerance, COARSE_TOLERANCE), START_ROUNDS, None, watch)
        run.rows.extend(half.history)
        displacement = interpolated(half.displacement, coarse.tissue, problem)
        if half.interrupted:
            return SpringState(displacement, False, half.error, half.history, True)
    else:
        at_rest = np.zeros(problem.modulus.shape)
        displacement = (at_rest, at_rest.copy(), at_rest.copy())
    return run.to_equilibrium(displacement)


@dataclass(eq=False)
class _Run:
    """One call of `solve`: the operator that all axes share, and the history."""

    problem: SpringProblem
    tolerance: float
    max_rounds: int
    watch: Callable[[np.void], None] | None
    rows: list[np.void] = field(default_factory=list)

    def to_equilibrium(self, displacement: Displacement) -> SpringState:
        """Bring a displacement to equilibrium, in place."""
        ux, uy, uz = displacement
        problem = self.problem
        level = LatticeLevel.of(problem)
        free = level.free
        unheld, error, converged, interrupted = Multigrid(level, Workspace()), np.inf, False, False
        load_x, load_y, stretch = (np.zeros(ux.shape, np.float32) for _ in range(3))
        along_x = _Axis("x", level, unheld, load_x, CHEST_WALL_INDEX, np.inf)
        along_y = _Axis("y", level, unheld, load_y, -np.inf, np.inf)
        along_z = _Axis("z", level, unheld, problem.force[2], problem.lower, problem.upper)
        everywhere, between = free.astype(np.uint8), np.zeros(ux.shape, np.uint8)
        sliding = lattice.follow_edge(ux, free, problem.edge, LEAVING, between)
        try:
            for _ in range(self.max_rounds):
                error, changes = self._balance(along_z, uz, between)
                lattice.cell_stretch(problem.modulus, uz, stretch)
                lattice.stretch_loads(level.springs, level.span, stretch, load_x, load_y)
                for force, load in zip(problem.force, (load_x, load_y), strict=False):
                    if force is not None:
                        vectors.add_scaled(np.float32(1.0), force, load)
                error_x, changes_x = self._balance(along_x, ux, everywhere)
                error = max(error, error_x)
                settled = sliding == changes == changes_x == 0
                if settled and error <= self.tolerance:
                    converged = True
                    break
                sliding = lattice.follow_edge(ux, free, problem.edge, LEAVING, between)
        except KeyboardInterrupt:
            interrupted, self.watch = True, None
        for _ in range(1 if interrupted else self.max_rounds):  # y decides nothing else
            error_y, _ = self._balance(along_y, uy, everywhere)
            if error_y <= self.tolerance:
                break
        error = max(error, error_y)
        converged &= error <= self.tolerance
        history = np.array(self.rows, HISTORY)
        return SpringState((ux, uy, uz), converged, error, history, interrupted)

    def _balance(
        self, axis: _Axis, u: NDArray[np.float64], bounded: NDArray[np.uint8]
    ) -> tuple[float, int]:
        """Move one axis towards equilibrium.

        Returns
        -------
        error : float
            Estimate of the largest distance that is left, lattice units.
        changes : int
            How many nodes came under an obstacle's hold or left it.
        """
        changes, force = axis.hold(u, bounded, SLACK * self.tolerance)
        correction, error = conjugate_gradients(
            axis.multigrid, force, 0.5 * self.tolerance, REDUCTION, 3
        )
        vectors.add_scaled(1.0, correction, u)
        nodes = np.count_nonzero(self.problem.modulus)
        row = np.array([(len(self.rows), nodes, axis.name, error, axis.held)], HISTORY)[0]
        self.rows.append(row)
        if self.watch is not None:
            self.watch(row)
        return error, changes


class _Axis:
    """One component: its load, the nodes an obstacle holds, and the multigrid without them."""

    def __init__(
        self,
        name: str,
        base: LatticeLevel,
        unheld: Multigrid,
        load: NDArray[np.float32] | None,
        lower: float,
        upper: float,
    ) -> None:
        self.name = name
        self._base, self._unheld, self._load, self._bounds = base, unheld, load, (lower, upper)
        self._contact = np.zeros(base.free.shape, np.int8)
        self.held = 0
        self.multigrid = unheld

    def hold(
        self, u: NDArray[np.float64], bounded: NDArray[np.uint8], slack: float
    ) -> tuple[int, NDArray[np.floating]]:
        """Find the nodes that an obstacle holds, and the force on all others.

        A few changes are left to the finest level: coarse operators that are a little out of date
        precondition as well.

        Returns
        -------
        changes : int
            How many nodes came under an obstacle's hold or left it.
        force : ndarray of float32
            Work space.
        """
        base, workspace = self._base, self.multigrid.workspace
        force = workspace.array("force", u.shape)
        base.residual(u, self._load, force)
        if not np.isfinite(self._bounds).any():
            return 0, force
        direction = "xyz".index(self.name)
        changes = int(
            lattice.update_contact(
                u, force, base.diagonal, base.free, bounded, direction, self._bounds,
                slack, self._contact,
            )
        )  # fmt: skip
        if changes:
            self.held = int(np.count_nonzero(self._contact))
            free = base.free * (self._contact == 0)
            finest = replace(base, free=free)
            if self.multigrid is self._unheld or changes > STALE_PART * self.held:
                self.multigrid = Multigrid(finest, workspace)
            else:
                self.multigrid.replace_finest(finest)
        if self.held:
            self.multigrid.finest.residual(u, self._load, force)
        return changes, force
