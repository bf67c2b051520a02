"""A spring-loaded paddle: the angle at which the spring holds what the breast presses."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.stages import Stages
from mammosim.compression.plates import Plates

MOMENT_TOLERANCE = 0.01
"""Relative difference of the two moments at which the angle is good enough."""

MAX_TRIALS = 12
"""Angles that are tried at most."""


class Levelled(NamedTuple):
    """A tilted paddle at rest.

    Parameters
    ----------
    plates : Plates
    state : State
    stopped : bool
        Whether the paddle has met its stop, which carries a part of the moment.
    """

    plates: Plates
    state: State
    stopped: bool


def moment_nm(stages: Stages, plates: Plates, state: State) -> float:
    """Moment of the breast on the paddle about its hinge, N m; positive: it brings the front down.

    Parameters
    ----------
    stages : Stages
    plates : Plates
        With a panel.
    state : State
        Between them.
    """
    hinge_mm = plates.edge_mm + (plates.panel.hinge_mm if plates.panel else 0.0)
    contact, edge = stages.contact(0, plates), float(stages.mesh.nodes.spacing_mm[0])
    pressure, push = contact.pressure(state.u)
    places = stages.mesh.nodes.origin_mm + edge * contact.points.places(state.u)
    stress = -pressure[0][:, None] * push[0]
    if state.grip is not None:
        stress = stress + state.grip.stress[0]
    force_n = contact.points.area[:, None] * stress * edge**2 * 1e-3
    return 1e-3 * float(
        force_n[:, 2] @ (hinge_mm - places[:, 0])
        + (force_n[:, 0] @ (places[:, 2] - plates.paddle_z_mm))
    )


def tilted(plates: Plates, angle_deg: float) -> Plates:
    """The same plates with another tilt of the paddle."""
    if plates.panel is None:
        raise ValueError("a straight paddle has no tilt")
    return replace(plates, panel=replace(plates.panel, tilt_deg=angle_deg))


def level_paddle(
    stages: Stages, plates: Plates, state: State, spring_nm_per_deg: float, max_deg: float
) -> Levelled:
    """Angle at which the moment of the breast about the hinge equals the spring's.

    Parameters
    ----------
    stages : Stages
    plates : Plates
        With a panel, at the angle where the search starts.
    state : State
        Between them.
    spring_nm_per_deg : float
        Stiffness about the hinge, N m for each degree.
    max_deg : float
        Angle at which the paddle is stopped.

    Returns
    -------
    Levelled
        Its state is not converged where no equilibrium or no angle was found.

    Notes
    -----
    The excess, spring less moment, grows with the angle. Its zero lies between the stops and is
    found by the Illinois variant of regula falsi (Dowell & Jarratt 1971, BIT 11:168-174); each
    angle starts from the state at the one before.
    """
    angle = plates.panel.tilt_deg if plates.panel else 0.0
    ends: list[tuple[float, float]] = []
    for _ in range(MAX_TRIALS):
        if ends:
            plates = tilted(plates, angle)
            state = stages.settle(plates, state)
        moment = moment_nm(stages, plates, state)
        excess = spring_nm_per_deg * angle - moment
        stopped = abs(angle) == max_deg and excess * angle < 0.0
        if not state.converged or stopped or abs(excess) <= MOMENT_TOLERANCE * abs(moment):
            return Levelled(plates, state, stopped)
        ends = _bracket(ends, (angle, excess))
        if len(ends) == 1:
            angle = float(np.clip(moment / spring_nm_per_deg, -max_deg, max_deg))
        else:
            angle = _between(ends, max_deg)
    return Levelled(plates, replace(state, converged=False), False)


def _bracket(
    ends: list[tuple[float, float]], found: tuple[float, float]
) -> list[tuple[float, float]]:
    """The newest point and the last one beyond the zero, whose excess is halved if it stays."""
    if len(ends) < 2 or ends[1][1] * found[1] < 0.0:
        return [*ends[-1:], found]
    other, excess = ends[0]
    return [(other, 0.5 * excess), found]


def _between(ends: list[tuple[float, float]], max_deg: float) -> float:
    """Where the line through two points is zero, within the stops.

    Where the excess does not grow from one to the other, no zero lies near: the stop on the side
    that the breast presses to.
    """
    (a, at_a), (b, at_b) = ends
    if (at_b - at_a) * (b - a) <= 0.0:
        return float(np.copysign(max_deg, -at_b))
    return float(np.clip(a - at_a * (b - a) / (at_b - at_a), -max_deg, max_deg))
