"""The `multigrid` solver: equilibrium of the spring lattice as obstacle problems, axis by axis.

The equation along z contains neither x nor y; with z known, those along x and y are linear. The
plates' faces are an obstacle along z, their ends and the chest wall one along x; which nodes they
hold is found by the primal-dual active set method (Hintermueller, Ito & Kunisch 2003, SIAM J.
Optim. 13:865), monotone here because the operator is an M-matrix. Each axis has one solution. A
lattice of half the resolution, solved first, gives the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

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
from mammosim.compression.springs.problem import SpringProblem, SpringState
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

SLACK = 0.1
"""Part of the tolerance by which a held node must draw back before it is let go."""

STALE_PART = 0.1
"""Of the held nodes may change before the coarse operators are made anew."""

MAX_ROUNDS = 80
"""Of one axis, in each of which nodes come under an obstacle's hold or leave it; 2 to 6 are usual,
and 35 were seen from rest under strong compression."""

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
        """Bring a displacement to equilibrium, in place: along z, then x, then y."""
        ux, uy, uz = displacement
        level = LatticeLevel.of(self.problem)
        unheld, error = Multigrid(level, Workspace()), 0.0
        settled, interrupted = True, False
        load_x, load_y = (np.zeros(ux.shape, np.float32) for _ in range(2))
        between = partial(lattice.hold_between_faces, plates=self.problem.plates)
        before = partial(
            lattice.hold_before_ends,
            uz=uz,
            plates=self.problem.plates,
            chest=float(self.problem.chest),
        )
        for axis in (
            _Axis("z", uz, self.problem.force[2], unheld, between),
            _Axis("x", ux, load_x, unheld, before),
            _Axis("y", uy, load_y, unheld, None),
        ):
            if axis.name == "x":
                self._widen(level, uz, load_x, load_y)
            try:
                left, done = self._settle(axis, 1 if interrupted else self.max_rounds)
            except KeyboardInterrupt:  # the other axes are brought along to what was reached
                interrupted, left, done, self.watch = True, np.inf, False, None
            error, settled = max(error, left), settled and done
        history = np.array(self.rows, HISTORY)
        return SpringState(displacement, settled, error, history, interrupted)

    def _widen(
        self,
        level: LatticeLevel,
        uz: NDArray[np.float64],
        load_x: NDArray[np.float32],
        load_y: NDArray[np.float32],
    ) -> None:
        """Loads along x and y: from cells that are squeezed along z, and from outside."""
        stretch = np.zeros(uz.shape, np.float32)
        lattice.cell_stretch(self.problem.modulus, uz, stretch)
        lattice.stretch_loads(level.springs, level.span, stretch, load_x, load_y)
        for force, load in zip(self.problem.force[:2], (load_x, load_y), strict=True):
            if force is not None:
                vectors.add_scaled(np.float32(1.0), force, load)

    def _settle(self, axis: _Axis, max_rounds: int) -> tuple[float, bool]:
        """Bring one axis to equilibrium.

        Returns
        -------
        error : float
            Estimate of the largest distance that is left, lattice units.
        settled : bool
            Whether it is within the tolerance and no node came under a hold or left it.
        """
        nodes, error = np.count_nonzero(self.problem.modulus), np.inf
        for _ in range(max_rounds):
            changes, force = axis.hold(SLACK * self.tolerance)
            correction, error = conjugate_gradients(
                axis.multigrid, force, 0.5 * self.tolerance, REDUCTION, 3
            )
            vectors.add_scaled(1.0, correction, axis.u)
            row = np.array([(len(self.rows), nodes, axis.name, error, axis.held)], HISTORY)[0]
            self.rows.append(row)
            if self.watch is not None:
                self.watch(row)
            if changes == 0 and error <= self.tolerance:
                axis.keep()
                return error, True
            if changes == 0:
                axis.renew()
        return error, False


class _Axis:
    """One component of the displacement, the nodes an obstacle holds, the multigrid without them.

    Parameters
    ----------
    name : str
    u : ndarray of float64, [x, y, z]
        It is moved in place.
    load : ndarray of float32, optional
    unheld : Multigrid
        Of the lattice of which nothing is held but what is fixed.
    hold_nodes : callable, optional
        Kernel that finds the nodes an obstacle holds; None where there is none.
    """

    def __init__(
        self,
        name: str,
        u: NDArray[np.float64],
        load: NDArray[np.float32] | None,
        unheld: Multigrid,
        hold_nodes: Callable[..., int] | None,
    ) -> None:
        self.name, self.u, self.held, self.multigrid = name, u, 0, unheld
        self._load, self._unheld, self._hold_nodes = load, unheld, hold_nodes
        self._base, self._stale = unheld.finest, False
        self._contact = np.zeros(u.shape if hold_nodes else (0, 0, 0), np.int8)

    def hold(self, slack: float) -> tuple[int, NDArray[np.floating]]:
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
        force = workspace.array("force", self.u.shape)
        base.residual(self.u, self._load, force)
        if self._hold_nodes is None:
            return 0, force
        changes = int(self._hold_nodes(
            u=self.u, force=force, diagonal=base.diagonal, free=base.free, slack=slack,
            contact=self._contact,
        ))  # fmt: skip
        if changes:
            self.held = int(np.count_nonzero(self._contact))
            finest = replace(base, free=base.free * (self._contact == 0))
            if self.multigrid is self._unheld or changes > STALE_PART * self.held:
                self.multigrid, self._stale = Multigrid(finest, workspace), False
            else:
                self.multigrid.replace_finest(finest)
                self._stale = True
        if self.held:
            self.multigrid.finest.residual(self.u, self._load, force)
        return changes, force

    def renew(self) -> None:
        """Bring the coarse operators up to date with what is held, where that is needed."""
        if self._stale:
            self.multigrid = Multigrid(self.multigrid.finest, self.multigrid.workspace)
            self._stale = False

    def keep(self) -> None:
        """Put what the last correction left beyond an obstacle back on it."""
        if self._hold_nodes is not None:
            force = self.multigrid.workspace.array("force", self.u.shape)
            force.fill(0.0)
            base, nowhere = self._base, np.zeros_like(self._contact)
            self._hold_nodes(
                u=self.u, force=force, diagonal=base.diagonal, free=base.free, slack=0.0,
                contact=nowhere,
            )  # fmt: skip
