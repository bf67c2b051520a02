"""Equilibrium of the body between the plates: a trust-region Newton method on the energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim._interruption import interruptible
from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.newton import State, Step, Value, evaluate, step_of
from mammosim.compression.multigrid import (
    MIN_RITZ,
    BlockLevel,
    Multigrid,
    Truncated,
    Workspace,
    clear,
    hold,
    truncated_gradients,
)

LARGEST_STEP = 2.0
"""Longest displacement of a node in one step, element edges."""

SHORTEST_STEP = 2.0**-9
"""Part of a step below which the search for a lower energy gives up."""

ARMIJO_FRACTION = 0.1
"""Part of the decrease that the quadratic model promises which a step must keep."""

GOOD, POOR = 0.75, 0.25
"""Parts of the promised decrease above which the trust region grows, and below which it shrinks."""

UNBOUNDED = 1e30
"""Radius of the trust region where the tangent cannot be negative."""

ROUNDING = 1e-13
"""Relative, of the energy's sum over a million elements."""

AT_REST = 1e-9
"""Unbalanced force (`Step.out_of_balance`) that is rounding: nothing touches the body."""

WORST_CURVATURE = -2.0
"""Negative curvature, relative to the V-cycle's, beyond which it is not followed: it is that of
single elements far from equilibrium, and the model holds for no step worth taking."""

NEAR, NEAR_LARGEST = 0.2, 2.0
"""Mean and largest displacement of a node in a step, element edges, below which the exact tangent
stiffness is used: further away, leaving out what may be negative leads on faster."""

MAX_FORCING_TERM, TIGHTEST = 0.1, 0.03
"""Part of its residual that a step's linear problem may leave; between them 0.9 times the square of
the last step's reduction of the force (Eisenstat & Walker 1996, SIAM J Sci Comput 17:16-32)."""

MAX_CYCLES = 60
"""V-cycles of one linear problem at most."""

MAX_STEPS = 150
"""Newton steps of one place of the plates at most; 10 to 30 are usual."""

RATES = 0.3, 0.95
"""Bounds of the factor by which errors are taken to fall with each step."""

UNKNOWN_RATE = 0.8
"""That factor where the step before says nothing of it."""

LARGEST_TO_MEAN = 4.0
"""Largest error that is allowed, in units of the tolerance of the mean."""


@dataclass
class _Search:
    """What a minimisation knows from its steps so far.

    `exact` says which tangent is used, `radius` is that of the trust region in the norm of the
    V-cycle, `before` mean and largest displacement of the last full step, `force` the force's norm
    before it, `ritz` the smallest eigenvalue that steps of the exact tangent met.
    """

    workspace: Workspace
    exact: bool = False
    radius: float = np.inf
    before: tuple[float, float] | None = None
    force: float = 0.0
    ritz: float = np.inf


@dataclass(frozen=True, eq=False)
class _Trial:
    """A step that was tried: where it leads, which part of it, and what of the promise it kept."""

    u: NDArray[np.float64]
    value: Value
    length: float
    ratio: float
    mean: float
    largest: float


def minimise(
    body: Body,
    contact: Contact,
    u: NDArray[np.float64],
    tolerance: float,
    workspace: Workspace,
    max_steps: int = MAX_STEPS,
    watch: Callable[[Step], None] | None = None,
    unfolded: float = np.inf,
) -> State:
    """Displacement of least energy.

    Parameters
    ----------
    body : Body
    contact : Contact
    u : ndarray, [3, x, y, z]
        Displacement to start from, lattice units.
    tolerance : float
        Stop where the nodes' estimated mean distance from equilibrium is below this, lattice units,
        and the largest is below `LARGEST_TO_MEAN` times this.
    workspace : Workspace
    max_steps : int
    watch : callable, optional
        Called with each step.
    unfolded : float
        Stop, without convergence, as soon as no J is smaller than this.

    Returns
    -------
    State
        Not converged where no step of use was found, or all were taken.

    Notes
    -----
    Each step minimises a quadratic model by truncated conjugate gradients (`truncated_gradients`),
    is shortened until the energy falls by a fair part of what the model promises (Nocedal & Yuan
    1998), and sets the next trust region. Contact and wrinkles are re-evaluated each time. An
    equilibrium is accepted only after a full step of the exact tangent within the trust region,
    along which no negative curvature was met.
    """
    search = _Search(workspace)
    value, error, cycles, length = evaluate(body, contact, u), (np.inf, np.inf), 0, 1.0
    done = interrupted = False
    for number in range(max_steps + 1):
        step = step_of(body, contact, value, cycles, length, error)
        if step.out_of_balance <= AT_REST:
            step, done = replace(step, error=0.0, largest_error=0.0), True
        if watch:
            watch(step)
        if done or length == 0.0 or number == max_steps or value.smallest >= unfolded:
            break
        try:
            with interruptible():
                model = _direction(body, contact, u, value, search)
                trial = _shortened(body, contact, u, value, model)
        except KeyboardInterrupt:
            interrupted = True
            break
        error = _error(model, trial, search)
        done = error[0] <= tolerance and error[1] <= LARGEST_TO_MEAN * tolerance
        _learn(model, trial, search)
        u, value, length, cycles = trial.u, trial.value, trial.length, model.iterations
    return State(u, value, step, done, interrupted)


def _direction(
    body: Body, contact: Contact, u: NDArray[np.float64], value: Value, search: _Search
) -> Truncated:
    """The step of the quadratic model; `search` may turn to the tangent that is never negative."""
    norm = float(np.linalg.norm(value.force))
    reduction = MAX_FORCING_TERM
    if search.exact and search.force > 0.0:
        reduction = min(MAX_FORCING_TERM, max(TIGHTEST, 0.9 * (norm / search.force) ** 2))
    search.force = norm
    eigenvalues = search.workspace.eigenvalues
    while True:
        known = eigenvalues.get(u.shape)
        level = _tangent(body, contact, u, float(search.exact), search.workspace)
        multigrid = Multigrid(level, search.workspace, known)
        eigenvalues[u.shape] = multigrid.eigenvalues
        force = (-value.force).astype(np.float32)
        radius = search.radius if search.exact else UNBOUNDED
        model = truncated_gradients(multigrid, force, radius, reduction, MAX_CYCLES)
        if model.definite and (not search.exact or model.ritz > WORST_CURVATURE):
            return model
        eigenvalues.pop(u.shape)
        if not search.exact and known is None:
            return model
        search.exact = False


def _tangent(
    body: Body,
    contact: Contact,
    u: NDArray[np.float64],
    geometric: float,
    workspace: Workspace,
) -> BlockLevel:
    """Tangent stiffness; with `geometric` 0 without the terms that may be negative."""
    shape = u.shape[1:]
    # Of the tangents only: what lies outside the nodes' rows is never written, and stays empty.
    stencil = workspace.array("tangent", (shape[0], shape[1], 126, shape[2]))
    clear(stencil, body.node_span)
    body.add_tangent(u, geometric, stencil)
    contact.add_stiffness(u, geometric, stencil)
    hold(stencil, body.node_span, body.free, body.held_rows)
    return BlockLevel.of(stencil, body.node_span, workspace)


def _shortened(
    body: Body, contact: Contact, u: NDArray[np.float64], value: Value, model: Truncated
) -> _Trial:
    """The step, halved until it lowers the energy by enough; of length 0 if no part of it does."""
    direction = model.correction.astype(np.float64)
    slope = -float((direction * value.force).sum())
    curvature = 2.0 * (slope - model.decrease)
    distance = np.sqrt((direction**2).sum(axis=0))
    largest, mean = float(distance.max()), float(distance[body.nodes].mean())
    length = min(1.0, LARGEST_STEP / max(largest, 1e-30))
    rounding = ROUNDING * abs(value.energy)
    while slope > 0.0 and length > SHORTEST_STEP:
        moved = u + length * direction
        trial = evaluate(body, contact, moved)
        promised = length * slope - 0.5 * length**2 * curvature
        ratio = (value.energy - trial.energy + rounding) / (promised + rounding)
        if ratio >= ARMIJO_FRACTION:
            return _Trial(moved, trial, length, ratio, length * mean, length * largest)
        length *= 0.5
    return _Trial(u, value, 0.0, 0.0, 0.0, 0.0)


def _error(model: Truncated, trial: _Trial, search: _Search) -> tuple[float, float]:
    """Estimated distance from equilibrium after a step, mean and largest; infinite if unknown.

    What the linear problem left, and what is to follow if displacements go on to fall as fast as
    from the step before to this one. What is left is bounded by the smallest eigenvalue that any
    step met so far: few iterations meet no slow mode that hardly moves, yet it may remain.
    """
    if not search.exact or model.bounded:
        return np.inf, np.inf
    ritz = max(model.ritz, MIN_RITZ)
    search.ritz = min(search.ritz, ritz)
    if trial.length < 1.0 or trial.ratio < 0.5:
        return np.inf, np.inf
    left = model.left * ritz / search.ritz
    sizes = trial.mean, trial.largest
    errors = []
    for size, before in zip(sizes, search.before or (None, None), strict=True):
        rate = UNKNOWN_RATE if before is None else min(max(size / before, RATES[0]), RATES[1])
        errors.append(size * (rate / (1.0 - rate) + left))
    return errors[0], errors[1]


def _learn(model: Truncated, trial: _Trial, search: _Search) -> None:
    """Choose tangent and trust region for the next step."""
    full = trial.length == 1.0
    if not search.exact:
        near = full and trial.mean < NEAR and trial.largest < NEAR_LARGEST
        search.exact, search.radius, search.before = near, np.inf, None
        return
    search.before = (trial.mean, trial.largest) if full and not model.bounded else None
    size = trial.length * model.size
    if trial.ratio < POOR:
        search.radius = 0.5 * size
    elif not full:
        search.radius = size
    else:
        reached = search.radius if np.isfinite(search.radius) else size
        grown = 4.0 * size if trial.ratio > GOOD else size
        search.radius = max(reached, grown)
    if trial.length < ARMIJO_FRACTION:
        search.exact = False
