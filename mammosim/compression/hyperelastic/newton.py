"""A state of the body between the plates: its energy, its forces, and how it was reached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.friction import Grip

MIN_STRAIN = 1e-3
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
    error, largest_error : float
        Estimated distance of the nodes from equilibrium, mean and largest, lattice units; infinite
        where it is not known yet.
    """

    out_of_balance: float
    depth: float
    force: float
    energy: float
    smallest: float
    cycles: int
    length: float
    error: float = np.inf
    largest_error: float = np.inf


@dataclass(frozen=True, eq=False)
class State:
    """Where Newton's method has come to.

    Parameters
    ----------
    u : ndarray, [3, x, y, z]
        Displacement, lattice units.
    value : Value
    last : Step
        Its error is the estimate for `u`.
    converged : bool
    interrupted : bool
        Whether the user stopped it.
    grip : Grip, optional
        How the plates hold the surface by friction; None: it glides freely.
    """

    u: NDArray[np.float64]
    value: Value
    last: Step
    converged: bool
    interrupted: bool = False
    grip: Grip | None = None


def evaluate(body: Body, contact: Contact, u: NDArray[np.float64]) -> Value:
    """Energy, force and contact of a state."""
    energy, smallest, force = body.energy_and_forces(u)
    pressure, push = contact.pressure(u)
    contact.add_forces(pressure, push, force)
    energy += contact.energy(pressure) + contact.add_friction(u, force)
    force *= body.free
    return Value(energy, smallest, force, pressure, push)


def step_of(
    body: Body,
    contact: Contact,
    value: Value,
    cycles: int,
    length: float,
    error: tuple[float, float],
) -> Step:
    """What the history says of a state: see `Step`."""
    least = MIN_STRAIN * float(body.shear.max()) * np.sqrt(np.count_nonzero(body.nodes))
    applied = np.zeros_like(value.force)
    contact.add_forces(value.pressure, value.push, applied)
    force = max(contact.plate_force(value.pressure, value.push))
    unbalanced = np.linalg.norm(value.force) / max(float(np.linalg.norm(applied)), least)
    return Step(
        float(unbalanced), contact.mean_depth(value.pressure), force, value.energy, value.smallest,
        cycles, length, *error,
    )  # fmt: skip
