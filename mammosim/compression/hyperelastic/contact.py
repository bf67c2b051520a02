"""Contact of the breast's surface with paddle and breast support.

A plate is a rigid solid (`plates.SHAPES`); a point of the surface that is inside it is pushed out
along the shortest way, with a pressure in proportion to its depth (penalty method: Wriggers 2006,
Computational Contact Mechanics, chapter 6). Along the plate it glides freely, or with `friction`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _contact_kernels as kernels
from mammosim.compression.hyperelastic.friction import Friction
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
    friction : Friction, optional
        None: the surface glides freely along the plates.
    """

    points: SurfacePoints
    plates: tuple[Any, ...]
    stiffness: float
    friction: Friction | None = None

    def depth(self, places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Depth of places (n, 3) in each plate, [plate, n], and its outward normal there.

        Returns
        -------
        depth : ndarray, [plate, n]
            Lattice units; negative outside.
        normal : ndarray, [plate, n, 3]
        """
        depth = np.empty((len(self.plates), len(places)))
        normal = np.empty((*depth.shape, 3))
        for number, plate in enumerate(self.plates):
            kernels.plate_depth(places, plate, depth[number], normal[number])
        return depth, normal

    def pressure(self, u: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pressure of each plate on each point, [plate, n] kPa, and the push's direction.

        Returns
        -------
        pressure : ndarray, [plate, n]
            kPa; 0 where a point is outside.
        push : ndarray, [plate, n, 3]
            Unit normal of the plate.
        """
        depth, push = self.depth(self.points.places(u))
        return np.maximum(self.stiffness * depth, 0.0), push

    def energy(self, pressure: NDArray[np.float64]) -> float:
        """Energy of a pressure, kPa x volume of an element."""
        return float((pressure**2 @ self.points.area).sum() / (2.0 * self.stiffness))

    def add_friction(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Energy of friction, whose derivative by each node's displacement is added to `force`."""
        if self.friction is None:
            return 0.0
        places = self.points.places(u)
        self.add_forces(*self.friction.stress(places), force)
        return self.friction.energy(places, self.points.area)

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
        if self.friction is not None:
            self.friction.add_blocks(places, blocks)
        kernels.add_contact_stiffness(blocks, points.area, points.cells, points.local, stencil)

    def mean_depth(self, pressure: NDArray[np.float64]) -> float:
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
