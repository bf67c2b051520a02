"""Equilibrium of the body between the plates: inexact Newton steps down the energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.multigrid import (
    BlockLevel,
    Multigrid,
    ResidualBelow,
    Workspace,
    conjugate_gradients,
    hold,
)

LARGEST_STEP = 2.0
"""Longest displacement of a node in one Newton step, element edges."""

SHORTEST_STEP = 2.0**-10
"""Part of a Newton step below which the search for a lower energy gives up."""

ENOUGH = 1e-4
"""Part of the descent that the slope promises which a step must keep (Armijo)."""

ROUNDING = 1e-13
"""Relative, of the energy's sum over a million elements."""

MOST_SKIPPED = 3
"""Steps at most in which the exact tangent is not tried after it has proved indefinite: one after
the first time, two after the second in a row, and so on."""

LOOSEST = 0.03
"""Part of its residual that a Newton step's linear problem may leave (Eisenstat & Walker 1996)."""

MOST_CYCLES = 60
"""V-cycles of one linear problem at most."""

MOST_STEPS = 150
"""Newton steps of one place of the plates at most; 8 to 15 are usual, and far more where the
surface creases behind the plates' edge."""

LEAST_STRAIN = 1e-3
"""Forces are compared with those of the plates, or with what a strain of this makes where the
plates hardly press."""


@dataclass(frozen=True, eq=False)
class Value:
    """Energy of a state and its derivative.

    Parameters
    ----------
    energy : float
        Elastic and contact energy, kPa times the volume of an element.
    smallest : float
        Smallest J of any point of any element.
    force : ndarray, [3, x, y, z]
        Derivative of the energy by each free displacement.
    pressure, push : ndarray, [plate, n] and [plate, n, 3]
        Of the plates on the surface points; see `Contact.pressure`.
    """

    energy: float
    smallest: float
    force: NDArray[np.float64]
    pressure: NDArray[np.float64]
    push: NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """One Newton step, for the history.

    Parameters
    ----------
    out_of_balance : float
        Norm of the nodes' forces that nothing balances, over that of the plates' forces on them.
    depth : float
        Depth of the surface in the plates, root mean square, lattice units.
    force : float
        Of the paddle or the support, whichever is larger, kPa x face of an element.
    energy, smallest : float
        As in `Value`.
    cycles : int
        V-cycles of the step that led here.
    length : float
        Part of that step that was taken.
    """

    out_of_balance: float
    depth: float
    force: float
    energy: float
    smallest: float
    cycles: int
    length: float


@dataclass(frozen=True, eq=False)
class State:
    """Where Newton's method has come to: displacement [3, x, y, z], its value, its last step.

    `interrupted` is set where the user stopped it.
    """

    u: NDArray[np.float64]
    value: Value
    last: Step
    converged: bool
    interrupted: bool = False


def evaluate(body: Body, contact: Contact, u: NDArray[np.float64]) -> Value:
    """Energy, force and contact of a state."""
    energy, smallest, force = body.energy_and_forces(u)
    pressure, push = contact.pressure(u)
    contact.add_forces(pressure, push, force)
    force *= body.free
    return Value(energy + contact.energy(pressure), smallest, force, pressure, push)


def minimise(
    body: Body,
    contact: Contact,
    u: NDArray[np.float64],
    tolerance: float,
    workspace: Workspace,
    max_steps: int = MOST_STEPS,
    watch: Callable[[Step], None] | None = None,
) -> State:
    """Displacement of least energy.

    Parameters
    ----------
    body : Body
    contact : Contact
    u : ndarray, [3, x, y, z]
        Displacement to start from, lattice units.
    tolerance : float
        Stop where the out-of-balance force is below this part of the plates' force.
    workspace : Workspace
    max_steps : int
    watch : callable, optional
        Called with each step.

    Returns
    -------
    State
        Not converged where no step of use was found, or all were taken.
    """
    value, length, cycles = evaluate(body, contact, u), 1.0, 0
    eigenvalues: list[float] = []
    failures = skipped = 0
    interrupted = False
    least = LEAST_STRAIN * float(body.shear.max()) * np.sqrt(np.count_nonzero(body.nodes))
    for number in range(max_steps + 1):
        step = _step(contact, value, least, cycles, length)
        if watch:
            watch(step)
        done = step.out_of_balance <= tolerance
        if done or length == 0.0 or number == max_steps:
            break
        try:
            exact = skipped == failures
            direction, cycles, eigenvalues, indefinite = _newton_direction(
                body, contact, u, value, step, exact, eigenvalues, workspace
            )
            skipped = 0 if exact else skipped + 1
            if exact:
                failures = min(failures + 1, MOST_SKIPPED) if indefinite else 0
            u, value, length = _descend(body, contact, u, value, direction)
        except KeyboardInterrupt:
            interrupted = True
            break
    return State(u, value, step, done, interrupted)


def _step(contact: Contact, value: Value, least: float, cycles: int, length: float) -> Step:
    applied = np.zeros_like(value.force)
    contact.add_forces(value.pressure, value.push, applied)
    force = max(contact.plate_force(value.pressure, value.push))
    unbalanced = np.linalg.norm(value.force) / max(float(np.linalg.norm(applied)), least)
    return Step(
        float(unbalanced), contact.depth(value.pressure), force, value.energy, value.smallest,
        cycles, length,
    )  # fmt: skip


def _newton_direction(
    body: Body,
    contact: Contact,
    u: NDArray[np.float64],
    value: Value,
    step: Step,
    exact: bool,
    eigenvalues: list[float],
    workspace: Workspace,
) -> tuple[NDArray[np.float64], int, list[float], bool]:
    """Descent direction, its V-cycles, the levels' largest eigenvalues, whether it was indefinite.

    Where the tangent stiffness is not to be `exact`, or proves indefinite, its terms that may be
    negative are left out.
    """
    reduction = min(LOOSEST, 0.5 * np.sqrt(step.out_of_balance))
    shape, cycles = u.shape[1:], 0
    geometric, indefinite = (1.0 if exact else 0.0), False
    while True:
        stencil = workspace.array("stencil", (shape[0], shape[1], 126, shape[2]))
        stencil.fill(0.0)
        body.add_tangent(u, geometric, stencil)
        contact.add_stiffness(value.pressure, value.push, stencil)
        hold(stencil, body.free)
        level = BlockLevel.of(stencil, body.node_span)
        multigrid = Multigrid(level, workspace, eigenvalues)
        force = (-value.force).astype(np.float32)
        solved = conjugate_gradients(multigrid, force, ResidualBelow(reduction), MOST_CYCLES)
        cycles, eigenvalues = cycles + solved.iterations, multigrid.eigenvalues
        if solved.positive or geometric == 0.0:
            break
        geometric, indefinite, eigenvalues = 0.0, True, []
    return solved.correction.astype(np.float64), cycles, eigenvalues, indefinite


def _descend(
    body: Body,
    contact: Contact,
    u: NDArray[np.float64],
    value: Value,
    direction: NDArray[np.float64],
) -> tuple[NDArray[np.float64], Value, float]:
    """The state after a part of the step that lowers the energy, and that part; 0 if none does."""
    slope = float((direction * value.force).sum())
    length = min(1.0, LARGEST_STEP / max(float(np.abs(direction).max()), 1e-30))
    while slope < 0.0 and length > SHORTEST_STEP:
        moved = u + length * direction
        trial = evaluate(body, contact, moved)
        allowed = ENOUGH * length * slope + ROUNDING * abs(value.energy)
        if trial.energy <= value.energy + allowed:
            return moved, trial, length
        length *= 0.5
    return u, value, 0.0
