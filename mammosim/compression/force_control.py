"""Where the plates stand: as given, where they press alike, or where the paddle bears a force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.compression.plate_balance import (
    MAX_CORRECTIONS,
    BalancedHeight,
    PlateForces,
    S,
    Solve,
    Tried,
    balanced,
)
from mammosim.compression.plates import Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import InputError

FORCE_TOLERANCE = 0.01
"""Relative, of the force that a thickness is sought for."""

SMALLEST_GAP = 0.3
"""Of the breast's height: the thinnest that is tried."""

FIRST_GAP, THINNER = 0.85, 0.85
"""Of the breast's height, and of the gap before, while the force is still too small."""

NARROW_MM = 1e-3
"""A bracket no wider than this is not halved any further."""


def settled(
    plates: Plates,
    settings: CompressionSettings,
    height_mm: float,
    balance: BalancedHeight,
    solve: Solve[S],
    at_rest: Callable[[], tuple[Plates, S]],
) -> tuple[Plates, S]:
    """Equilibrium between plates as the settings say: at given heights, a gap, or a force.

    Parameters
    ----------
    plates : Plates
        As `place_plates` gives them. Where the settings give no heights, only their gap and edge
        count.
    settings : CompressionSettings
        In mm.
    height_mm : float
        Height of the breast, mm.
    balance : BalancedHeight
        Where the plates go whose heights the settings do not give.
    solve : callable
    at_rest : callable
        The open plates, and the breast between them before anything moves.

    Returns
    -------
    plates : Plates
    state : state of the model
        Where the user stops the search: the last one that was solved, marked as interrupted.
    """
    last: list[tuple[Plates, S]] = []

    def kept(plates: Plates, start: S | None) -> tuple[S, PlateForces]:
        state, forces = solve(plates, start)
        last[:] = [(plates, state)]
        return state, forces

    try:
        if settings.support_z_mm is not None:
            return plates, solve(plates, None)[0]
        if settings.force_n is not None:
            return reach_force(plates, height_mm, settings.force_n, balance, kept)
        return balanced(plates, balance, kept)
    except KeyboardInterrupt:
        plates, state = last[0] if last else at_rest()
        return plates, state.stopped()


def reach_force(
    start: Plates,
    height_mm: float,
    wanted_n: float,
    balance: BalancedHeight,
    solve: Solve[S],
) -> tuple[Plates, S]:
    """Thin the gap until the force is passed, then find it by a bracketing secant in its log.

    Parameters
    ----------
    start : Plates
        Any plates: their edge is kept, and the search for the balanced height starts from theirs.
    height_mm : float
        Height of the breast, mm.
    wanted_n : float
    balance : BalancedHeight
        At each gap the plates are put where they press alike.
    solve : callable

    Returns
    -------
    plates : Plates
    state : state of the model
        If it has not converged, or was interrupted, the search ended with it.

    Raises
    ------
    InputError
        If the force is not reached at the thinnest gap; it names the largest that was.
    """

    level = start  # where the forces on the breast itself call for the plates

    def between(plates: Plates, before: Tried[S] | None) -> Tried[S]:
        nonlocal level
        tried = Tried(plates, *solve(plates, before.state if before else None))
        if tried.state.converged:
            level = balance.corrected(plates, tried.forces)
        return tried

    def at(gap: float, before: Tried[S] | None) -> Tried[S]:
        near = before.plates if before else start
        return between(balance.placed(near.at_height(near.centre_mm, gap)), before)

    wide, tried = height_mm, at(FIRST_GAP * height_mm, None)
    force_wide = 0.0
    while balance.common_n(tried.forces) < wanted_n and tried.state.converged:
        gap = tried.plates.thickness_mm
        if gap <= SMALLEST_GAP * height_mm:
            raise InputError(
                f"compression.force_n: found {wanted_n:g} N, but this breast supports at most "
                f"{tried.forces.paddle_n:.3g} N, at a thickness of {gap:.1f} mm; must be smaller"
            )
        wide, force_wide = gap, balance.common_n(tried.forces)
        tried = at(max(THINNER * gap, SMALLEST_GAP * height_mm), tried)
    thin, force_thin = tried.plates.thickness_mm, balance.common_n(tried.forces)
    only_higher = 0
    while not _good_enough(tried, wanted_n, balance) and wide - thin > NARROW_MM:
        if _near(balance.common_n(tried.forces), wanted_n) and only_higher < MAX_CORRECTIONS:
            only_higher += 1
            tried = between(level, tried)  # the bracket of gaps stays
            continue
        gap = thin + _share(wanted_n, force_thin, force_wide) * (wide - thin)
        tried = at(gap, tried)
        force = balance.common_n(tried.forces)
        if force > wanted_n:
            thin, force_thin = gap, force
        else:
            wide, force_wide = gap, force
    return tried.plates, tried.state


def _good_enough(tried: Tried[S], wanted_n: float, balance: BalancedHeight) -> bool:
    near = _near(tried.forces.paddle_n, wanted_n) and balance.is_found(tried.forces)
    return near or not tried.state.converged


def _near(force_n: float, wanted_n: float) -> bool:
    return abs(force_n - wanted_n) <= FORCE_TOLERANCE * wanted_n


def _share(wanted: float, thin: float, wide: float) -> float:
    """Where in the bracket, from its thin end, the force is expected; never too near an end.

    Forces of stiffening springs grow exponentially; a tenth is added for those that are 0.
    """
    low, goal, high = np.log(np.array([wide, wanted, thin]) + 0.1 * wanted)
    return float(np.clip((high - goal) / (high - low), 0.1, 0.9))
