"""The weight of the elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Weight:
    """Weight of the elements, shared by their nodes, in lattice units.

    Parameters
    ----------
    load : ndarray, [3, x, y, z]
        Force on each node, kPa times an element's face.
    """

    load: NDArray[np.float64]

    @classmethod
    def of(cls, mass: NDArray[np.float32], pull: tuple[float, float, float]) -> Weight:
        """Weight of a body.

        Parameters
        ----------
        mass : ndarray of float32, [x, y, z]
            Of each element over the volume of a full one, g/cm3; 0 where there is none.
        pull : tuple of float
            Acceleration times the length of an element's edge, kPa for each g/cm3.
        """
        nodes = 0.125 * mass.astype(np.float64)
        for axis in range(3):
            nodes = nodes + np.roll(nodes, 1, axis)
        return cls(np.multiply.outer(np.array(pull), nodes))

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        force -= self.load
        return -float((self.load * u).sum())

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Nothing: weight does not change with displacement."""
