"""Equilibrium of springs that stiffen as they are strained, by the multigrid of the linear ones.

With E = Ec exp(Enl e) the stiffness of a spring follows from x, y and z together. Each axis in turn
is moved as Newton's method would move it alone: the springs' slopes along that axis are taken as
the stiffness of a linear lattice, whose answer to the net force is the step. Slopes are bounded
below by the stiffness, so that the lattice stays an M-matrix. What couples the axes is left to the
repetition; where that overshoots, steps are shortened, and lengthened again where they agree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

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
from mammosim.compression.springs._exponential_kernels import strain_springs
from mammosim.compression.springs.equilibrium import HISTORY, REDUCTION, SLACK
from mammosim.compression.springs.equilibrium import solve as solve_linear
from mammosim.compression.springs.levels import lattice_level
from mammosim.compression.springs.problem import SpringProblem, SpringState
from mammosim.compression.springs.resolution import Displacement

START_TOLERANCE = 0.02
"""Of the linear springs that give the start, lattice units."""

MAX_ROUNDS = 200
"""Over z, x and y; 20 to 60 are usual, 140 were needed at 55 % compression."""

FIRST_STEP, SHORTEST_STEP = 0.7, 0.1
"""Part of Newton's step that an axis takes at first, and at least."""

OPPOSED, ALIKE = -0.1, 0.3
"""Cosine between a step and the one before below which the next is shorter, above which longer."""

SHORTER, LONGER = 0.7, 1.2
"""Factors on the step."""

LESS = 0.9
"""Factor on the longest step that is taken, each time that steps oppose each other: a few nodes may
swing while all others creep."""

SLOWEST = 0.95
"""Contraction a round that the error estimate allows at most."""


def solve_exponential(
    problem: SpringProblem,
    tolerance: float = 1e-3,
    start: SpringState | None = None,
    watch: Callable[[np.void], None] | None = None,
) -> SpringState:
    """Equilibrium of a lattice whose springs stiffen.

    Parameters
    ----------
    problem : SpringProblem
        With its `stiffening`.
    tolerance : float
        Largest estimated distance of a node from equilibrium, lattice units.
    start : SpringState, optional
        Where to start from; otherwise the equilibrium of linear springs of the same moduli.
    watch : callable, optional
        Called with each row of the history.

    Returns
    -------
    SpringState

    Notes
    -----
    The estimate is the longest Newton step of the last round, over one less the contraction of the
    rounds before. The force law has no energy (a spring pulls along r - D and stiffens with |r|),
    so that more than one equilibrium is not ruled out; none was seen.
    """
    rows: list[np.void] = []
    if start is None:
        linear = replace(problem, stiffening=None)
        start = solve_linear(linear, max(tolerance, START_TOLERANCE), None, watch)
        rows.extend(start.history)
        if start.interrupted:
            return start
    ux, uy, uz = (np.array(u, dtype=np.float64) for u in start.displacement)
    run = _Run(problem, tolerance, (ux, uy, uz), watch, rows)
    return run.to_equilibrium()


def strained(problem: SpringProblem, displacement: Displacement) -> SpringProblem:
    """The problem of linear springs as stiff as those that stiffen are at a displacement."""
    stretch = np.zeros(problem.modulus.shape, np.float32)
    stiffness = np.zeros((13, *problem.modulus.shape), np.float32)
    lattice.cell_stretch(problem.modulus, displacement[2], stretch)
    strain_springs(
        problem.modulus, problem.stiffening, *displacement, stretch, 0, stiffness, None
    )  # fmt: skip
    return replace(problem, stiffness=stiffness, stiffening=None)


@dataclass(eq=False)
class _Run:
    """One call: the displacement, the springs at its strain, and the history."""

    problem: SpringProblem
    tolerance: float
    displacement: Displacement
    watch: Callable[[np.void], None] | None
    rows: list[np.void]
    workspace: Workspace = field(default_factory=Workspace)

    def __post_init__(self) -> None:
        shape = self.problem.modulus.shape
        self.stiffness, self.slope = (np.zeros((13, *shape), np.float32) for _ in range(2))
        self.load_x, self.load_y = (np.zeros(shape, np.float32) for _ in range(2))
        self.stretch, self.span = np.zeros(shape, np.float32), self.problem.span()
        self.free = (self.problem.tissue & ~self.problem.fixed).astype(np.float32)
        self.nodes = int(np.count_nonzero(self.problem.modulus))

    def to_equilibrium(self) -> SpringState:
        """Bring the displacement to equilibrium, in place."""
        ux, uy, uz = self.displacement
        plates, chest = self.problem.plates, float(self.problem.chest)
        before = partial(lattice.plate_end_contact, uz=uz, plates=plates, chest=chest)
        axes = (
            _Axis("z", uz, partial(lattice.hold_between_faces, plates=plates)),
            _Axis("x", ux, before),
            _Axis("y", uy, None),
        )
        error, longest, converged, interrupted = np.inf, [np.inf], False, False
        try:
            for _ in range(MAX_ROUNDS):
                changes = sum(self._move(axis) for axis in axes)
                longest.append(max(axis.longest for axis in axes))
                error = _remaining(longest)
                if changes == 0 and error <= self.tolerance:
                    converged = True
                    break
        except KeyboardInterrupt:
            interrupted = True
        history = np.array(self.rows, HISTORY)
        return SpringState(self.displacement, converged, float(error), history, interrupted)

    def _move(self, axis: _Axis) -> int:
        """Take a step along one axis; how many nodes came under an obstacle's hold or left it."""
        level = self._level(axis.name)
        force = self.workspace.array("force", axis.u.shape)
        self._net_force(axis, self.free, force)
        changes = axis.hold(level, force, SLACK * self.tolerance)
        if axis.held:
            level = replace(level, free=self.free * (axis.contact == 0))
            self._net_force(axis, level.free, force)
        multigrid = Multigrid(level, self.workspace)
        stop = ErrorBelow(0.3 * self.tolerance, REDUCTION)
        axis.step(conjugate_gradients(multigrid, force, stop, 3).correction)
        row = np.array([(len(self.rows), self.nodes, axis.name, axis.longest, axis.held)], HISTORY)[
            0
        ]
        self.rows.append(row)
        if self.watch is not None:
            self.watch(row)
        return changes

    def _level(self, name: str) -> ScalarLevel:
        """Springs at their present strain, and the lattice of their slopes along an axis."""
        problem = self.problem
        lattice.cell_stretch(problem.modulus, self.displacement[2], self.stretch)
        strain_springs(
            problem.modulus, problem.stiffening, *self.displacement, self.stretch,
            "xyz".index(name), self.stiffness, self.slope,
        )  # fmt: skip
        return lattice_level(self.slope, self.span, self.free)

    def _net_force(
        self, axis: _Axis, free: NDArray[np.float32], force: NDArray[np.floating]
    ) -> None:
        """Net force along an axis on each free node, of springs as stiff as they are."""
        number = "xyz".index(axis.name)
        load = self.problem.force[number]
        if number < 2:
            lattice.stretch_loads(self.stiffness, self.span, self.stretch, self.load_x, self.load_y)
            widening = (self.load_x, self.load_y)[number]
            if load is not None:
                vectors.add_scaled(np.float32(1.0), load, widening)
            load = widening
        lattice.lattice_residual(self.stiffness, self.span, free, axis.u, load, force)


class _Axis:
    """One component of the displacement, which nodes an obstacle holds, and its steps.

    Parameters
    ----------
    name : str
    u : ndarray of float64, [x, y, z]
        It is moved in place.
    hold_nodes : callable, optional
        Kernel that finds the nodes an obstacle holds; None where there is none.
    """

    def __init__(
        self, name: str, u: NDArray[np.float64], hold_nodes: Callable[..., list[int]] | None
    ) -> None:
        self.name, self.u, self._hold_nodes = name, u, hold_nodes
        self.contact = np.zeros(u.shape if hold_nodes else (0, 0, 0), np.int8)
        self.held, self.longest = 0, np.inf
        self._part, self._most = FIRST_STEP, 1.0
        self._before = np.zeros(u.shape, np.float32)

    def hold(self, level: ScalarLevel, force: NDArray[np.floating], slack: float) -> int:
        """Find the nodes that an obstacle holds; how many came or went."""
        if self._hold_nodes is None:
            return 0
        changes = sum(self._hold_nodes(
            u=self.u, force=force, diagonal=level.diagonal, free=level.free, slack=slack,
            contact=self.contact,
        ))  # fmt: skip
        self.held = int(np.count_nonzero(self.contact))
        return changes

    def step(self, correction: NDArray[np.float32]) -> None:
        """Take a part of Newton's step, by how it agrees with the one before."""
        along = vectors.dot(correction, self._before)
        size = np.sqrt(
            vectors.dot(correction, correction) * vectors.dot(self._before, self._before)
        )
        if along < OPPOSED * size:
            self._part = max(SHORTER * self._part, SHORTEST_STEP)
            self._most = max(LESS * self._most, SHORTEST_STEP)
        elif along > ALIKE * size:
            self._part = min(LONGER * self._part, self._most)
        self._before[...] = correction
        self.longest = vectors.largest(correction)
        vectors.add_scaled(self._part, correction, self.u)


def _remaining(longest: list[float]) -> float:
    """Largest distance that is left after the last round, from how fast steps have shrunk."""
    last, earlier = longest[-1], longest[-min(len(longest), 4)]
    rounds = min(len(longest), 4) - 1
    shrunk = (last / earlier) ** (1.0 / rounds) if np.isfinite(earlier) and earlier > 0.0 else 1.0
    return last / (1.0 - min(shrunk, SLOWEST))
