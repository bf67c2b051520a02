"""The `multigrid` solver: equilibrium of the spring lattice as obstacle problems, axis by axis.

The equation along z contains neither x nor y; with z known, those along x and y are linear. The
plates' faces are an obstacle along z, their ends and the chest wall one along x; which nodes they
hold is found by the primal-dual active set method (Hintermüller, Ito & Kunisch 2002, SIAM J.
Optim. 13:865), monotone here because the operator is an M-matrix. Each axis has one solution. A
lattice of half the resolution, solved first, gives the start.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid import (
    ErrorBelow,
    Multigrid,
    ScalarLevel,
    Workspace,
    conjugate_gradients,
    vectors,
)
from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs.levels import level_of
from mammosim.compression.springs.problem import SpringProblem, SpringState
from mammosim.compression.springs.resolution import (
    Displacement,
    coarsened,
    interpolated,
    lengthened,
    with_whole_rows,
)

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

REMAINS = 1.0 / 3.0
"""Part of the error that a V-cycle's answer leaves at most: 0.03 to 0.15 is usual, 0.3 was seen
with coarse operators that are out of date."""

REDUCTION = 0.05
"""Part of the error that is kept in a round in which nodes come under a hold or leave it."""

MAX_STEPS = 4
"""Of conjugate gradients in a round, after which the force is summed anew in double precision."""

FIRST_SWEEPS, ADVANCE = 3, 1.2
"""Sweeps of a projected Jacobi iteration before the coarse operators are made, and its step: they
find nine tenths of the nodes that are held in the end, so that the operators need be made once."""

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
    rows: list[np.void] = []
    padded, layers = with_whole_rows(problem), problem.modulus.shape[2]
    if start is not None:
        missing = padded.modulus.shape[2] - layers
        ux, uy, uz = (lengthened(np.array(u, np.float64), missing) for u in start.displacement)
        displacement = (ux, uy, uz)
    elif np.count_nonzero(problem.modulus) > SMALLEST_START:
        coarse = coarsened(problem)
        half = _solve(coarse, max(tolerance, COARSE_TOLERANCE), START_ROUNDS, None, watch)
        if half.interrupted:
            displacement = interpolated(half.displacement, coarse.tissue, problem)
            return SpringState(displacement, False, half.error, half.history, True)
        displacement = interpolated(half.displacement, coarse.tissue, padded)
        rows.extend(half.history)
    else:
        at_rest = np.zeros(padded.modulus.shape)
        displacement = (at_rest, at_rest.copy(), at_rest.copy())
    state = _Run(padded, tolerance, max_rounds, watch, rows).to_equilibrium(displacement)
    if padded is problem:
        return state
    ux, uy, uz = (np.ascontiguousarray(u[:, :, :layers]) for u in state.displacement)
    return replace(state, displacement=(ux, uy, uz))


@dataclass(eq=False)
class _Run:
    """One call of `solve`: the operator that all axes share, and the history."""

    problem: SpringProblem
    tolerance: float
    max_rounds: int
    watch: Callable[[np.void], None] | None
    rows: list[np.void]
    workspace: Workspace = field(default_factory=Workspace)

    @cached_property
    def level(self) -> ScalarLevel:
        """The lattice of which nothing but its fixed nodes is held."""
        return level_of(self.problem)

    @cached_property
    def unheld(self) -> Multigrid:
        """Its hierarchy, made when it is first needed."""
        return Multigrid(self.level, self.workspace)

    def to_equilibrium(self, displacement: Displacement) -> SpringState:
        """Bring a displacement to equilibrium, in place: along z, then x, then y."""
        ux, uy, uz = displacement
        plates, chest = self.problem.plates, float(self.problem.chest)
        between = partial(lattice.hold_between_faces, plates=plates)
        before = partial(lattice.plate_end_contact, uz=uz, plates=plates, chest=chest)
        error, settled, interrupted = 0.0, True, False
        loads: tuple[NDArray[np.float32] | None, ...] = ()
        for name, u, hold_nodes in (("z", uz, between), ("x", ux, before), ("y", uy, None)):
            if name == "x":
                loads = self._loads(uz)
            load = self.problem.force[2] if name == "z" else loads["xy".index(name)]
            try:
                left, done = self._settle(
                    _Axis(self, name, u, load, hold_nodes), 1 if interrupted else self.max_rounds
                )
            except KeyboardInterrupt:  # the other axes are brought along to what was reached
                interrupted, left, done, self.watch = True, np.inf, False, None
            error, settled = max(error, left), settled and done
        history = np.array(self.rows, HISTORY)
        return SpringState(displacement, settled, error, history, interrupted)

    def _loads(self, uz: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Loads along x and y: from cells that are compressed along z, and from outside."""
        load_x, load_y = (np.zeros(uz.shape, np.float32) for _ in range(2))
        stretch = self.workspace.array("stretch", uz.shape)
        lattice.cell_stretch(self.problem.modulus, uz, stretch)
        lattice.stretch_loads(self.problem.springs, self.level.span, stretch, load_x, load_y)
        for force, load in zip(self.problem.force[:2], (load_x, load_y), strict=True):
            if force is not None:
                vectors.add_scaled(np.float32(1.0), force, load)
        return load_x, load_y

    def _settle(self, axis: _Axis, max_rounds: int) -> tuple[float, bool]:
        """Bring one axis to equilibrium.

        Returns
        -------
        error : float
            Estimate of the largest distance that is left, lattice units.
        settled : bool
            Whether it is within the tolerance and no node came under a hold or left it.
        """
        nodes, left = np.count_nonzero(self.problem.modulus), np.inf
        for _ in range(max_rounds):
            changes, force = axis.hold()
            if changes == 0 and left <= self.tolerance:
                axis.keep()
                return left, True
            stop = ErrorBelow(self.tolerance / REMAINS, REDUCTION if changes else 0.0)
            solved = conjugate_gradients(axis.multigrid, force, stop, MAX_STEPS)
            vectors.add_scaled(1.0, solved.correction, axis.u)
            left = REMAINS * solved.measure
            row = np.array([(len(self.rows), nodes, axis.name, left, axis.held)], HISTORY)[0]
            self.rows.append(row)
            if self.watch is not None:
                self.watch(row)
            if axis.hold_nodes is None and left <= self.tolerance:
                return left, True
            if changes == 0 and left > self.tolerance:
                axis.renew()
        return left, False


class _Axis:
    """One component of the displacement, the nodes an obstacle holds, the multigrid without them.

    Parameters
    ----------
    run : _Run
    name : str
    u : ndarray of float64, [x, y, z]
        It is moved in place.
    load : ndarray of float32, optional
    hold_nodes : callable, optional
        Kernel that finds the nodes an obstacle holds; None where there is none.
    """

    def __init__(
        self,
        run: _Run,
        name: str,
        u: NDArray[np.float64],
        load: NDArray[np.float32] | None,
        hold_nodes: Callable[..., list[int]] | None,
    ) -> None:
        self.name, self.u, self.held, self.hold_nodes = name, u, 0, hold_nodes
        self._run, self._load, self._stale = run, load, False
        self._multigrid: Multigrid | None = None
        self._contact = np.zeros(u.shape if hold_nodes else (0, 0, 0), np.int8)

    @property
    def multigrid(self) -> Multigrid:
        """Hierarchy of the nodes that nothing holds."""
        return self._multigrid or self._run.unheld

    def hold(self) -> tuple[int, NDArray[np.floating]]:
        """Find the nodes that an obstacle holds, and the force on all others.

        Returns
        -------
        changes : int
            How many nodes came under an obstacle's hold or left it.
        force : ndarray of float32
            Work space.
        """
        force = self._force_on(self._run.level)
        if self.hold_nodes is None:
            return 0, force
        changes = self._look(force)
        if self._multigrid is None and changes:
            for _ in range(FIRST_SWEEPS):
                self._look(force, ADVANCE)
                self._force_on(self._run.level)
            self._look(force)
            changes = int(np.count_nonzero(self._contact))
        if changes:
            self.held = int(np.count_nonzero(self._contact))
            self._multigrid = self._without_held(changes)
        return changes, self._force_on(self.multigrid.finest) if self.held else force

    def renew(self) -> None:
        """Bring the coarse operators up to date with what is held, where they are not."""
        if self._stale and self._multigrid is not None:
            self._multigrid = Multigrid(self._multigrid.finest, self._run.workspace)
            self._stale = False

    def keep(self) -> None:
        """Put what the last correction left beyond an obstacle back on it."""
        force = self._run.workspace.array("force", self.u.shape)
        force.fill(0.0)
        self._look(force)

    def _force_on(self, level: ScalarLevel) -> NDArray[np.floating]:
        force = self._run.workspace.array("force", self.u.shape)
        level.residual(self.u, self._load, force)
        return force

    def _look(self, force: NDArray[np.floating], advance: float = 0.0) -> int:
        assert self.hold_nodes is not None
        level = self._run.level
        return sum(self.hold_nodes(
            u=self.u, force=force, diagonal=level.diagonal, free=level.free,
            slack=SLACK * self._run.tolerance, contact=self._contact, advance=advance,
        ))  # fmt: skip

    def _without_held(self, changes: int) -> Multigrid:
        """A hierarchy without the nodes that are held now.

        A few changes are left to the finest level: coarse operators that are a little out of date
        precondition as well.
        """
        level = self._run.level
        free = self._run.workspace.array("free", self.u.shape)
        lattice.unheld_nodes(level.free, self._contact, free)
        finest = replace(level, free=free)
        self._stale = self._multigrid is not None and changes <= STALE_PART * self.held
        if self._multigrid is None or not self._stale:
            return Multigrid(finest, self._run.workspace)
        return self._multigrid.replaced(finest)
