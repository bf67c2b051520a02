"""Plates' place at which the paddle bears a given force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from mammosim.compression.plates import Plates
from mammosim.errors import InputError

FORCE_TOLERANCE = 0.01
"""Relative, of the force that a thickness is sought for."""

SMALLEST_GAP = 0.3
"""Of the breast's height: the thinnest that is tried."""

FIRST_GAP, THINNER = 0.85, 0.85
"""Of the breast's height, and of the gap before, while the force is still too small."""

NARROW_MM = 1e-3
"""A bracket no wider than this is not halved any further."""


class Equilibrium(Protocol):
    """A solver's state, of either model."""

    @property
    def converged(self) -> bool:
        """Whether the solver reached its tolerance."""
        ...


S = TypeVar("S", bound=Equilibrium)


@dataclass(frozen=True, eq=False)
class Tried(Generic[S]):
    """Plates at one gap, the equilibrium there and the paddle's force."""

    plates: Plates
    state: S
    force_n: float


def reach_force(
    middle: Plates,
    height_mm: float,
    wanted_n: float,
    solve: Callable[[Plates, S | None], tuple[S, float]],
) -> tuple[Plates, S]:
    """Thin the gap until the force is passed, then find it by a bracketing secant in its log.

    Parameters
    ----------
    middle : Plates
        Any plates: their middle and edge are kept.
    height_mm : float
        Height of the breast, mm.
    wanted_n : float
    solve : callable
        ``solve(plates, start)`` gives the equilibrium and the paddle's force in N; each starts
        from the one before.

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
    centre = 0.5 * (middle.support_z_mm + middle.paddle_z_mm)

    def at(gap: float, before: Tried[S] | None) -> Tried[S]:
        plates = replace(middle, support_z_mm=centre - 0.5 * gap, paddle_z_mm=centre + 0.5 * gap)
        state, force = solve(plates, before.state if before else None)
        return Tried(plates, state, force)

    wide, tried = height_mm, at(FIRST_GAP * height_mm, None)
    force_wide = 0.0
    while tried.force_n < wanted_n and tried.state.converged:
        gap = tried.plates.thickness_mm
        if gap <= SMALLEST_GAP * height_mm:
            raise InputError(
                f"compression.force_n: found {wanted_n:g} N, but this breast bears at most "
                f"{tried.force_n:.3g} N, at a thickness of {gap:.1f} mm; must be smaller"
            )
        wide, force_wide = gap, tried.force_n
        tried = at(max(THINNER * gap, SMALLEST_GAP * height_mm), tried)
    thin, force_thin = tried.plates.thickness_mm, tried.force_n
    while not _good_enough(tried, wanted_n) and wide - thin > NARROW_MM:
        share = _share(wanted_n, force_thin, force_wide)
        tried = at(thin + share * (wide - thin), tried)
        if tried.force_n > wanted_n:
            thin, force_thin = tried.plates.thickness_mm, tried.force_n
        else:
            wide, force_wide = tried.plates.thickness_mm, tried.force_n
    return tried.plates, tried.state


def _good_enough(tried: Tried[S], wanted_n: float) -> bool:
    near = abs(tried.force_n - wanted_n) <= FORCE_TOLERANCE * wanted_n
    return near or not tried.state.converged


def _share(wanted: float, thin: float, wide: float) -> float:
    """Where in the bracket, from its thin end, the force is expected; never too near an end.

    Forces of stiffening springs grow exponentially; a tenth is added for those that are 0.
    """
    low, goal, high = np.log(np.array([wide, wanted, thin]) + 0.1 * wanted)
    return float(np.clip((high - goal) / (high - low), 0.1, 0.9))
