"""The skin as a membrane on the breast's surface."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _membrane_kernels as kernels
from mammosim.compression.hyperelastic.surface import SurfacePoints


@dataclass(frozen=True, eq=False)
class Membrane:
    """Patches of a membrane that move with the elements beneath them, in lattice units.

    Parameters
    ----------
    cells : ndarray of int32, (n, 3)
        Element that each patch moves with.
    gradients : ndarray, (n, 8, 2)
        Derivatives of the element's shape functions along the patch's two tangents.
    tangents : ndarray, (n, 2, 3)
        Orthogonal unit tangents of the surface at rest.
    stiffness : ndarray, (n,)
        Shear modulus (kPa) times thickness times area.
    stiffening : float
        b of the energy ``mu / 2 (I + b I^2 / 2)``, I being that of the neo-Hookean law.

    Notes
    -----
    The elements' displacement on their cut surface deforms the membrane; it has no nodes of its own
    (Cenanovic, Hansbo & Larson 2016, Comput Methods Appl Mech Eng 310:98-111). It is an
    incompressible sheet that carries tension only: it wrinkles at no cost, and has no stiffness in
    bending. The first two terms of Yeoh's law (1993, Rubber Chem Technol 66:754-771) let it stiffen
    with stretch; with one it is neo-Hookean.
    """

    cells: NDArray[np.int32]
    gradients: NDArray[np.float64]
    tangents: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    stiffening: float = 0.0

    @classmethod
    def of(
        cls,
        points: SurfacePoints,
        covered: NDArray[np.bool_],
        tension: float,
        stiffening: float = 0.0,
    ) -> Membrane:
        """Membrane on those points of a surface that skin covers.

        Parameters
        ----------
        points : SurfacePoints
        covered : ndarray of bool, (n,)
        tension : float
            Shear modulus times thickness, kPa times an element's edge.
        stiffening : float
            As the class takes it.
        """
        tangents = _tangents(points.normal[covered])
        gradients = _shape_gradients(points.local[covered]) @ tangents.transpose(0, 2, 1)
        stiffness = tension * points.area[covered]
        return cls(points.cells[covered], gradients, tangents, stiffness, stiffening)

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        return float(kernels.membrane_forces(u, *self._parts, force))

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Add the second derivative of the energy, which is never negative, to a block stencil."""
        kernels.add_membrane_stiffness(u, *self._parts, stencil)

    @property
    def _parts(self) -> tuple[Any, ...]:
        """What kernels take."""
        return self.cells, self.gradients, self.tangents, self.stiffness, self.stiffening


def _tangents(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2, 3) orthogonal unit tangents of planes with unit normals (n, 3)."""
    flattest = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, flattest)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normal, first)], axis=1)


def _shape_gradients(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 8, 3) gradients of the trilinear shape functions at places in an element."""
    out = np.empty((len(local), 8, 3))
    for node, corner in enumerate(product((0, 1), repeat=3)):
        weights = np.where(corner, local, 1.0 - local)
        for axis in range(3):
            others = weights[:, [d for d in range(3) if d != axis]].prod(axis=1)
            out[:, node, axis] = others if corner[axis] else -others
    return out
