"""The breast's surface among the elements of a lattice."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _contact_kernels as kernels


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
    def of(
        cls,
        fraction: NDArray[np.float32],
        free: NDArray[np.float32],
        dense: tuple[float, float] = (0.0, 0.0),
    ) -> SurfacePoints:
        """Where the tissue fraction of the elements passes one half, but for what is held.

        Parameters
        ----------
        fraction : ndarray of float32, [x, y, z]
            Part of each cell that is tissue.
        free : ndarray of float32, [3, x, y, z]
            1 where a node may move along an axis, else 0.
        dense : tuple of float
            Between these two places along x there are several points an element.
        """
        layers, place = np.zeros(fraction.shape[0], np.int64), np.arange(fraction.shape[0]) + 0.5
        kernels.count_crossings(fraction, layers)
        near = (place > dense[0]) & (place < dense[1])
        samples = np.where(near, kernels.SAMPLES, 1)
        count = int(layers @ samples)
        cells, local = np.zeros((count, 3), np.int32), np.zeros((count, 3))
        area, normal = np.zeros(count), np.zeros((count, 3))
        kernels.surface_points(fraction, samples, cells, local, area, normal)
        moves = free[2] > 0.0
        loose = np.zeros(count, bool)
        for corner in product((0, 1), repeat=3):
            loose |= moves[tuple((cells + corner).T)]
        return cls(cells[loose], local[loose], area[loose], normal[loose])

    def places(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) present places, lattice units."""
        out = np.empty(self.local.shape)
        kernels.place_points(u, self.cells, self.local, out)
        return out
