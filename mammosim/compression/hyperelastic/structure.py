"""What holds a breast together beside its elements: skin around it, fascia behind it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.fascia import WALL, SkinBorder
from mammosim.compression.hyperelastic.surface import SurfacePoints

MIN_COVER = 0.25
"""Part of the skin's thickness that must be found where the surface is, for skin to cover it."""

FACING_WALL = -0.7
"""x of the outward normal below which the surface of the wall's layer is the wall itself."""


@dataclass(frozen=True, eq=False)
class Skin:
    """Where skin is and how stiff, in lattice units.

    Parameters
    ----------
    fraction : ndarray of float32, [x, y, z]
        Part of each cell that is skin.
    shear_kpa : float
        Shear modulus, a third of Young's modulus, kPa.
    thickness : float
        Element edges.
    stiffening : float
        See `Membrane`.
    """

    fraction: NDArray[np.float32]
    shear_kpa: float
    thickness: float
    stiffening: float = 0.0

    @property
    def tension(self) -> float:
        """Shear modulus times thickness, kPa times an element's edge."""
        return self.shear_kpa * self.thickness

    @property
    def least_thickness(self) -> float:
        """Thickness that must be found for skin to be there, element edges."""
        return MIN_COVER * min(self.thickness, 1.0)

    def covers(self, points: SurfacePoints) -> NDArray[np.bool_]:
        """Which points of the surface are covered by skin, (n,).

        The rest is where the phantom was cut off: the chest wall and the way to the axilla.
        """
        axis, rows = np.abs(points.normal).argmax(axis=1), np.arange(len(points.normal))
        outside = points.cells.copy()
        outside[rows, axis] += np.sign(points.normal[rows, axis]).astype(np.int32)
        amount = self.fraction[tuple(points.cells.T)] + self.fraction[tuple(outside.T)]
        wall = (points.normal[:, 0] < FACING_WALL) & (points.cells[:, 0] == WALL)
        return np.asarray((amount >= self.least_thickness) & ~wall)


@dataclass(frozen=True, eq=False)
class Structure:
    """Skin, fascia, weight and fibres of a body.

    Parameters
    ----------
    skin : Skin, optional
        None: the elements have the skin's stiffness, if any.
    fascia : float
        Tangential stiffness of the tie to the chest wall, kPa per element edge; 0 for none.
    rim : float
        Width of the wall's rim along which the tie is softer, element edges.
    mass : ndarray of float32, [x, y, z], optional
        Of the tissue in each cell over the cell's volume, g/cm3; None: weight does not act.
    pull : tuple of float
        Acceleration by gravity times the length of an element's edge, kPa for each g/cm3.
    fibre_ratio : float
        Young's modulus along fibres over that across; 1 for none.
    fibre_origin : tuple of float
        Where fibres spread from, lattice units.
    """

    skin: Skin | None = None
    fascia: float = 0.0
    rim: float = 1.0
    mass: NDArray[np.float32] | None = None
    pull: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fibre_ratio: float = 1.0
    fibre_origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def border(self, active: NDArray[np.bool_]) -> SkinBorder | None:
        """Where the skin of a body of these elements, [x, y, z], meets the wall."""
        if self.skin is None:
            return None
        part, tension = self.skin.fraction, self.skin.tension
        return SkinBorder.of(active, part, self.skin.least_thickness, tension, self.rim)

    def coarsened(
        self, mean_of_eight: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    ) -> Structure:
        """The same for elements twice as large."""
        skin, mass = self.skin, self.mass
        if skin is not None:
            fraction = mean_of_eight(skin.fraction)
            skin = replace(skin, fraction=fraction, thickness=0.5 * skin.thickness)
        x, y, z = (2.0 * part for part in self.pull)
        mass = None if mass is None else mean_of_eight(mass)
        a, b, c = (0.5 * (part + 1.0) for part in self.fibre_origin)
        fascia, rim = 2.0 * self.fascia, 0.5 * self.rim
        return Structure(skin, fascia, rim, mass, (x, y, z), self.fibre_ratio, (a, b, c))
