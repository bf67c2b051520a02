"""Common height of both plates at which paddle and breast support press alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from mammosim.compression.plates import Plates

BALANCED = 0.04
"""Largest difference of the two forces that is left, relative to the larger one: below the 5 % from
which a result is doubtful."""

BALANCED_COARSE = 0.02
"""The same on the coarse copy on which the height is sought."""

MAX_TRIALS = 12
"""Heights that are tried at one gap; 3 to 5 are usual."""

FIRST_SLOPE = 2.5
"""Change of the relative difference when the plates rise by the gap, at first; 1 to 6 were seen."""

MAX_CORRECTIONS = 3
"""Compressions of the breast itself after its first, each at a better height."""

MARGIN = 0.02
"""Part of the bracket that a trial keeps away from its ends."""


class PlateForces(NamedTuple):
    """Forces on the plates along their normal, N."""

    paddle_n: float
    support_n: float

    @property
    def imbalance(self) -> float:
        """Support less paddle over the larger, -1 to 1; 0 where neither touches."""
        largest = max(self.paddle_n, self.support_n)
        return (self.support_n - self.paddle_n) / largest if largest > 0.0 else 0.0


class Equilibrium(Protocol):
    """A solver's state, of either model."""

    @property
    def converged(self) -> bool:
        """Whether the solver reached its tolerance."""
        ...

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped the solver."""
        ...

    def stopped(self) -> Self:
        """The same state, at which the user stopped the search."""
        ...


S = TypeVar("S", bound=Equilibrium)


@dataclass(frozen=True, eq=False)
class Tried(Generic[S]):
    """Plates at one place, the equilibrium there and their forces."""

    plates: Plates
    state: S
    forces: PlateForces


Solve = Callable[[Plates, S | None], tuple[S, PlateForces]]
"""``solve(plates, start)``: the equilibrium and the plates' forces; each starts from the one
before."""


@dataclass(eq=False)
class BalancedHeight:
    """Finds the height of both plates at which a breast presses on both alike.

    Parameters
    ----------
    forces : callable
        ``forces(plates)`` on a coarse copy of the breast without weight; None where its solver did
        not converge. It raises `KeyboardInterrupt` where the user stopped it.
    low_mm, high_mm : float
        Lowest and highest face of the breast between the plates at rest.
    weightless : bool
        Whether the breast itself has no weight either, so that its own forces can be compared.
    slope : float
        Change of the relative difference when the plates rise by the gap, as far as it is known.

    Notes
    -----
    A technologist levels the breast support with the breast; the chest wall would have to bear in
    shear any difference between the two forces. The higher both plates stand, the more the support
    presses and the less the paddle: the difference has one zero. It is found on a coarse copy (a
    secant inside a bracket), and then corrected by the forces on the breast itself, with the
    copy's slope.
    """

    forces: Callable[[Plates], PlateForces | None]
    low_mm: float
    high_mm: float
    weightless: bool = True
    slope: float = FIRST_SLOPE
    _offset_mm: float = field(default=0.0, init=False)

    def placed(self, plates: Plates) -> Plates:
        """Plates with the same gap, at the height of balance as far as it is known.

        Parameters
        ----------
        plates : Plates
            Their height is where the search starts.
        """
        gap, centre = plates.thickness_mm, plates.centre_mm - self._offset_mm
        low, high = self.low_mm + 0.5 * gap, self.high_mm - 0.5 * gap
        if low >= high:
            return plates
        before: tuple[float, float] | None = None
        for _ in range(MAX_TRIALS):
            centre = float(
                np.clip(centre, low + MARGIN * (high - low), high - MARGIN * (high - low))
            )
            found = self.forces(plates.at_height(centre))
            if found is None:
                return plates
            left = found.imbalance
            if abs(left) <= BALANCED_COARSE:
                break
            low, high = (centre, high) if left < 0.0 else (low, centre)
            if before is not None and centre != before[0]:
                slope = gap * (left - before[1]) / (centre - before[0])
                if slope > 0.0:
                    self.slope = slope
            before = (centre, left)
            centre -= left * gap / self.slope
        return plates.at_height(centre + self._offset_mm)

    def common_n(self, forces: PlateForces) -> float:
        """Force that the paddle will have at this gap once the plates press alike, N."""
        return 0.5 * (forces.paddle_n + forces.support_n) if self.weightless else forces.paddle_n

    def move_mm(self, plates: Plates, forces: PlateForces) -> float:
        """How far plates must rise to press alike, estimated by the slope that is known, mm."""
        return -forces.imbalance * plates.thickness_mm / self.slope

    def is_found(self, forces: PlateForces) -> bool:
        """Whether the forces on the breast itself leave nothing to correct."""
        return not self.weightless or abs(forces.imbalance) <= BALANCED

    def corrected(self, plates: Plates, forces: PlateForces) -> Plates:
        """Plates moved by what the forces on the breast itself, at that height, call for."""
        if not self.weightless:
            return plates
        move = self.move_mm(plates, forces)
        self._offset_mm += move
        return plates.at_height(plates.centre_mm + move)

    def halve_steps(self) -> None:
        """Correct by half as much: a whole correction made it worse."""
        self.slope *= 2.0

    def learn(self, one: Tried[S], other: Tried[S]) -> bool:
        """Take the slope between two heights of the breast itself; False if it is none.

        A paddle that tilts does so by another angle at each height, which the coarse copy does not
        know.
        """
        rise = other.plates.centre_mm - one.plates.centre_mm
        slope = one.plates.thickness_mm * (other.forces.imbalance - one.forces.imbalance)
        if rise == 0.0 or slope / rise <= 0.0:
            return False
        self.slope = slope / rise
        return True


def balanced(plates: Plates, height: BalancedHeight, solve: Solve[S]) -> tuple[Plates, S]:
    """Equilibrium between plates of a given gap, at the height at which they press alike.

    Parameters
    ----------
    plates : Plates
        Where the search starts.
    height : BalancedHeight
    solve : callable

    Returns
    -------
    plates : Plates
    state : state of the model
        Of the best height that was solved; marked as interrupted where the user stopped the search.
    """
    plates = height.placed(plates)
    best = Tried(plates, *solve(plates, None))
    for _ in range(MAX_CORRECTIONS):
        if not best.state.converged or height.is_found(best.forces):
            break
        plates = height.corrected(best.plates, best.forces)
        tried = Tried(plates, *solve(plates, best.state))
        if tried.state.interrupted:
            return best.plates, best.state.stopped()
        if not tried.state.converged:
            break
        learned = height.learn(best, tried)
        if abs(tried.forces.imbalance) < abs(best.forces.imbalance):
            best = tried
        elif not learned:
            height.halve_steps()
    return best.plates, best.state
