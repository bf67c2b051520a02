"""Friction between the breast's surface and the plates: Coulomb's law, regularised.

A plate that presses a point with the pressure p holds it by a shear stress that grows with the
point's distance from its anchor, measured along the plate, up to mu p at `STICK_MM`; beyond that
the point slides and drags its anchor along. The anchor belongs to the plate and moves with it.
While the plates move by one step, p and the plate's normal are those of the previous solution: the
stress then has an energy (Li et al. 2020, ACM Trans Graph 39:49), which is minimised together with
the body's (`sliding`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.plates import Plates

STICK_MM = 0.1
"""Distance along a plate at which friction is full, mm (assumed): small compared with what is of
interest, and large enough that sticking skin is about as stiff as the plates' penalty."""

ENTRIES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Of a symmetric block, in the order of `add_contact_stiffness`."""


@dataclass(frozen=True, eq=False)
class Grip:
    """How plates hold points of the surface in an equilibrium.

    Parameters
    ----------
    plates : Plates
        Between which it was found.
    limit : ndarray, [plate, n]
        Largest stress along the plate, mu p, kPa.
    slip : ndarray, [plate, n, 3]
        Distance of each point from its anchor along the plate in units of `STICK_MM`; of length 1
        where it slides.
    """

    plates: Plates
    limit: NDArray[np.float64]
    slip: NDArray[np.float64]

    @classmethod
    def none(cls, plates: Plates, points: int) -> Grip:
        """Plates that hold none of the points yet."""
        return cls(plates, np.zeros((2, points)), np.zeros((2, points, 3)))

    def of_points(self, numbers: NDArray[np.intp]) -> Grip:
        """That of other points, each held like the point of this number."""
        return replace(self, limit=self.limit[:, numbers], slip=self.slip[:, numbers])

    @property
    def stress(self) -> NDArray[np.float64]:
        """Stress of the surface on the plates, kPa, [plate, n, 3]."""
        return self.limit[..., None] * self.slip


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction while the plates move by one step, in lattice units.

    Parameters
    ----------
    limit : ndarray, [plate, n]
        Largest stress along the plate, mu p, kPa.
    push : ndarray, [plate, n, 3]
        Outward normal of the plate, as `Contact.pressure` gives it.
    anchor : ndarray, [plate, n, 3]
        Place at which a plate would hold each point without stress.
    reach : float
        `STICK_MM` in units of the lattice.
    """

    limit: NDArray[np.float64]
    push: NDArray[np.float64]
    anchor: NDArray[np.float64]
    reach: float

    def energy(self, places: NDArray[np.float64], area: NDArray[np.float64]) -> float:
        """Energy of points at these places, (n, 3), kPa x volume of an element."""
        distance = np.linalg.norm(self._offset(places), axis=-1)
        sticks = 0.5 * distance**2 / self.reach
        potential = np.where(distance < self.reach, sticks, distance - 0.5 * self.reach)
        return float((self.limit * potential @ area).sum())

    def stress(
        self, places: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stress of each plate on each point, [plate, n] kPa, and its direction, [plate, n, 3]."""
        return self.limit, -self.slip(places)

    def add_blocks(self, places: NDArray[np.float64], blocks: NDArray[np.float64]) -> None:
        """Add the energy's second derivative by each point's place to `blocks`, (n, 6).

        It is never negative; where points slide it acts across their direction.
        """
        offset = self._offset(places)
        distance = np.linalg.norm(offset, axis=-1)
        slides = distance > self.reach
        direction = offset / np.maximum(distance, 1e-30)[..., None]
        stiffness = self.limit / np.maximum(distance, self.reach)
        for entry, (r, c) in enumerate(ENTRIES):
            along = float(r == c) - self.push[..., r] * self.push[..., c]
            block = stiffness * (along - slides * direction[..., r] * direction[..., c])
            blocks[:, entry] += block.sum(axis=0)

    def slip(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the anchor in units of `reach`, at most 1, [plate, n, 3]."""
        offset = self._offset(places)
        distance = np.linalg.norm(offset, axis=-1, keepdims=True)
        held = self.limit[..., None] > 0.0
        return np.asarray(np.where(held, offset / np.maximum(distance, self.reach), 0.0))

    def _offset(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the anchor along the plate, [plate, n, 3]."""
        offset = places - self.anchor
        offset -= (offset * self.push).sum(axis=-1, keepdims=True) * self.push
        return offset
