"""The retromammary fascia: a thin elastic layer between the breast's back and the chest wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WALL = 1
"""x index of the chest wall's nodes."""


@dataclass(frozen=True, eq=False)
class Fascia:
    """Ties of the wall's nodes to where they were at rest, along the wall only.

    Parameters
    ----------
    stiffness : ndarray of float32, [y, z]
        Tangential stiffness of the layer times the part of the wall that a node stands for, kPa
        times an element's edge.

    Notes
    -----
    A layer of thickness t and shear modulus G resists a displacement u along it with the stress
    G u / t. Its nodes are held along the wall's normal elsewhere (`mesh`).
    """

    stiffness: NDArray[np.float32]

    @classmethod
    def of(
        cls, fraction: NDArray[np.float32], active: NDArray[np.bool_], stiffness: float
    ) -> Fascia:
        """Fascia behind the elements of the wall's layer.

        Parameters
        ----------
        fraction : ndarray of float32, [x, y, z]
            Part of each cell that is tissue.
        active : ndarray of bool, [x, y, z]
            Elements that there are.
        stiffness : float
            kPa per length of an element's edge.
        """
        face = 0.25 * fraction[WALL] * active[WALL]
        nodes = face + np.roll(face, 1, 0)
        nodes = nodes + np.roll(nodes, 1, 1)
        return cls((stiffness * nodes).astype(np.float32))

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        along = u[1:, WALL]
        pull = self.stiffness * along
        force[1:, WALL] += pull
        return 0.5 * float((pull * along).sum())

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Add the second derivative of the energy to a block stencil."""
        for diagonal in (4, 8):
            stencil[WALL, :, diagonal] += self.stiffness
