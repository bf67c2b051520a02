"""Equilibrium with friction: how it passes from one place of the plates to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.friction import Friction, Grip
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.plates import Plates

MAX_REPEATS = 20
"""Solutions for one place of the plates, each with the pressure of the previous one; 2 to 6 are
usual."""

PRESSURE_TOLERANCE = 0.01
"""Change of the pressure from one to the next, relative to the whole load, that ends them."""


def anchors(
    before: Contact,
    after: Contact,
    places: NDArray[np.float64],
    carried: NDArray[np.float64],
    hold: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Anchors of points after the plates have moved by one step, [plate, n, 3].

    Parameters
    ----------
    before, after : Contact
        With the plates before and after the step.
    places : ndarray, (n, 3)
        Of the points before the step.
    carried : ndarray, [plate, n, 3]
        Where these places go if they move with each plate.
    hold : ndarray, [plate, n, 3]
        Distance of each point from its anchor before the step.

    Notes
    -----
    A plate that touches a point takes its anchor along for the whole step. A plate that reaches the
    point during the step takes it along for the rest of it: the point is where its signed depth,
    linear in time, passes zero. The others do not hold the point, and its anchor stays.
    """
    start, end = before.depth(places)[0], after.depth(places)[0]
    reached = (start < 0.0) & (end > 0.0)
    part = np.where(start >= 0.0, 1.0, 0.0)
    part[reached] = end[reached] / (end - start)[reached]
    return np.asarray(places + part[..., None] * (carried - places) - hold)


def held_by_friction(
    minimised: Callable[[NDArray[np.float64], Contact], State],
    contact: Contact,
    coefficient: float,
    u: NDArray[np.float64],
    first: Friction,
    plates: Plates,
) -> State:
    """State in which the pressure that friction takes is the plates' pressure.

    Parameters
    ----------
    minimised : callable
        State of least energy from a displacement, with a contact.
    contact : Contact
        Without friction.
    coefficient : float
    u : ndarray, [3, x, y, z]
        Displacement to start from.
    first : Friction
        Its anchors hold for all repetitions; its limit and normals are those of the first.
    plates : Plates
        Of the contact.
    """
    friction = first
    for _ in range(MAX_REPEATS):
        state = minimised(u, replace(contact, friction=friction))
        slip = friction.slip(contact.points.places(state.u))
        state = replace(state, grip=Grip(plates, friction.limit, slip))
        limit = coefficient * state.value.pressure
        change = (np.abs(limit - friction.limit) @ contact.points.area).sum()
        if (
            not state.converged
            or change <= PRESSURE_TOLERANCE * (limit @ contact.points.area).sum()
        ):
            return state
        u, friction = state.u, replace(friction, limit=limit, push=state.value.push)
    return replace(state, converged=False)
