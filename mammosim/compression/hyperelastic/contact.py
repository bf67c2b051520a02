"""Frictionless contact of the breast's surface with paddle and breast support.

A plate is a rigid solid (`plates.SHAPES`); a point of the surface that is inside it is pushed out
along the shortest way, with a pressure in proportion to its depth (penalty method: Wriggers 2006,
Computational Contact Mechanics, chapter 6).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _contact_kernels as kernels
from mammosim.compression.hyperelastic.body import Body

PENALTY = 60.0
"""Pressure at a depth of one element edge, in units of the tissue's mean modulus. On the reference
half-ellipsoid (4 mm elements) 20, 60 and 200 give errors that agree to 0.002 mm, with the surface
0.02, 0.012 and 0.005 edges inside the plates."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of the breast's surface, in lattice units.

    Parameters
    ----------
    cells : ndarray of int32, (n, 3)
        Element that each point moves with.
    local : ndarray, (n, 3)
        Place in the element, 0 to 1 inside; up to half an edge outside.
    area : ndarray, (n,)
        Part of the surface that each stands for.
    normal : ndarray, (n, 3)
        Outward unit normal.
    """

    cells: NDArray[np.int32]
    local: NDArray[np.float64]
    area: NDArray[np.float64]
    normal: NDArray[np.float64]

    @classmethod
    def of(cls, body: Body, dense: tuple[float, float] = (0.0, 0.0)) -> SurfacePoints:
        """Where the tissue fraction of the elements passes one half, but for what is held.

        Between the two places along x in `dense` there are several points an element.
        """
        fraction = body.fraction
        layers, place = np.zeros(fraction.shape[0], np.int64), np.arange(fraction.shape[0]) + 0.5
        kernels.count_crossings(fraction, layers)
        near = (place > dense[0]) & (place < dense[1])
        samples = np.where(near, kernels.SAMPLES, 1)
        count = int(layers @ samples)
        cells, local = np.zeros((count, 3), np.int32), np.zeros((count, 3))
        area, normal = np.zeros(count), np.zeros((count, 3))
        kernels.surface_points(fraction, samples, cells, local, area, normal)
        moves = body.free[2] > 0.0
        loose = np.zeros(count, bool)
        for corner in product((0, 1), repeat=3):
            loose |= moves[tuple((cells + corner).T)]
        return cls(cells[loose], local[loose], area[loose], normal[loose])

    def places(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) present places, lattice units."""
        out = np.empty(self.local.shape)
        kernels.place_points(u, self.cells, self.local, out)
        return out


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
        self, pressure: NDArray[np.float64], push: NDArray[np.float64], stencil: NDArray[np.float32]
    ) -> None:
        """Add the stiffness of points in contact to the tangent."""
        points = self.points
        kernels.add_contact_stiffness(
            pressure, push, points.area, self.stiffness, points.cells, points.local, stencil
        )

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
