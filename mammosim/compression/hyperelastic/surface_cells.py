"""Cells at the breast's surface, whose corners stick out of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _hourglass_kernels as kernels
from mammosim.compression.hyperelastic.fascia import WALL

PENALTY = 1.0
"""Stiffness against hourglass modes in units of a surface cell's shear modulus and the skin's."""

GROWTH = 4.0
"""How much stiffer they become for each square of an edge of such a displacement: without it a
corner that the plates' edge pushes aside stays up to four edges from its neighbours, in one of two
places. Of 1, 2, 4 and 8, with 4 elements of 6 mm are nearest to those of 3 mm."""


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """Cells with a face towards the air, and what keeps their corners in place.

    Parameters
    ----------
    cells : ndarray of int32, (n, 3)
    stiffness : ndarray, (n,)
        Against hourglass modes, kPa times an element's edge.

    Notes
    -----
    Of a cell that the surface cuts, only a part is tissue, and a corner outside may belong to no
    other cell: a stretched membrane would turn it inside out. Methods for cut elements add a
    penalty that vanishes with the element's size (ghost penalty: Burman 2010, C R Acad Sci Paris
    348:1217-1220); here it is one on what in a cell is no uniform deformation, and it stiffens.
    """

    cells: NDArray[np.int32]
    stiffness: NDArray[np.float64]

    @classmethod
    def of(
        cls, active: NDArray[np.bool_], shear: NDArray[np.float32], tension: float
    ) -> SurfaceCells:
        """Surface cells of a body.

        Parameters
        ----------
        active : ndarray of bool, [x, y, z]
            Elements that there are.
        shear : ndarray of float32, [x, y, z]
            Shear modulus of each element, kPa.
        tension : float
            Shear modulus of the skin times its thickness, kPa times an element's edge; 0 for none.
        """
        inside = active.copy()
        behind = np.roll(active, 1, 0)
        behind[WALL] = True  # the chest wall is no surface
        inside &= behind & np.roll(active, -1, 0)
        for axis in (1, 2):
            for shift in (-1, 1):
                inside &= np.roll(active, shift, axis)
        cells = np.argwhere(active & ~inside).astype(np.int32)
        return cls(cells, PENALTY * (shear[tuple(cells.T)].astype(np.float64) + tension))

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        return float(kernels.shape_forces(u, self.cells, self.stiffness, GROWTH, force))

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Add the second derivative of the energy to a block stencil."""
        kernels.add_shape_stiffness(u, self.cells, self.stiffness, GROWTH, stencil)
