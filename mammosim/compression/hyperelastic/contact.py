"""Frictionless contact of the breast's surface with paddle and breast support.

A plate is a rigid solid (`plates.SHAPES`); a point of the surface that is inside it is pushed out
along the shortest way, with a pressure in proportion to its depth (penalty method: Wriggers 2006,
Computational Contact Mechanics, chapter 6).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _contact_kernels as kernels
from mammosim.compression.hyperelastic.surface import SurfacePoints

PENALTY = 60.0
"""Pressure at a depth of one element edge, in units of the tissue's mean modulus. On the reference
half-ellipsoid (4 mm elements) 20, 60 and 200 give errors that agree to 0.002 mm, with the surface
0.02, 0.012 and 0.005 edges inside the plates."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Surface points between two plates, in lattice units.

    Parameters
    ----------
    points : SurfacePoints
    plates : tuple of NamedTuple
        Paddle and breast support, as `Plates.solids` gives them.
    stiffness : float
        Pressure a unit of depth, kPa.
    """

    points: SurfacePoints
    plates: tuple[Any, ...]
    stiffness: float

    def pressure(self, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pressure of each plate on each point, [plate, n] kPa, and the push's direction.

        Returns
        -------
        pressure : ndarray, [plate, n]
            kPa; 0 where a point is outside.
        push : ndarray, [plate, n, 3]
            Unit normal of the plate.
        """
        places = self.points.places(u)
        pressure = np.zeros((len(self.plates), len(places)))
        push = np.zeros((*pressure.shape, 3))
        for number, plate in enumerate(self.plates):
            kernels.contact_pressure(places, plate, self.stiffness, pressure[number], push[number])
        return pressure, push

    def energy(self, pressure: NDArray[np.float64]) -> float:
        """Energy of a pressure, kPa x volume of an element."""
        return float((pressure**2 @ self.points.area).sum() / (2.0 * self.stiffness))

    def add_forces(
        self, pressure: NDArray[np.float64], push: NDArray[np.float64], force: NDArray[np.float64]
    ) -> None:
        """Add the energy's derivative by each node's displacement to `force`."""
        points = self.points
        kernels.add_contact_forces(pressure, push, points.area, points.cells, points.local, force)

    def add_stiffness(
        self, u: NDArray[np.float64], geometric: float, stencil: NDArray[np.float32]
    ) -> None:
        """Add the stiffness of points in contact to the tangent.

        Parameters
        ----------
        u : ndarray, [3, x, y, z]
            Displacement, lattice units.
        geometric : float
            0 to 1: scales what the curvature of a rounded edge adds, which may be negative.
        stencil : ndarray of float32, [x, y, 126, z]
            It is changed.
        """
        points = self.points
        places, blocks = points.places(u), np.zeros((len(points.area), 6))
        for plate in self.plates:
            kernels.add_contact_blocks(places, plate, self.stiffness, geometric, blocks)
        kernels.add_contact_stiffness(blocks, points.area, points.cells, points.local, stencil)

    def depth(self, pressure: NDArray[np.float64]) -> float:
        """Depth of the surface in the plates where they press, root mean square, lattice units."""
        area = (pressure > 0.0) @ self.points.area
        square = pressure**2 @ self.points.area
        return float(np.sqrt(square.sum() / max(area.sum(), 1e-30)) / self.stiffness)

    def plate_force(
        self, pressure: NDArray[np.float64], push: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Force along z of the paddle and of the support, kPa x face of an element."""
        paddle, support = (pressure * push[:, :, 2]) @ self.points.area
        return -float(paddle), float(support)
