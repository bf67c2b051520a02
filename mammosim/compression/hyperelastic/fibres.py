"""Fibres from the chest wall towards the skin: tissue that is stiffer along them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _fibre_kernels as kernels


@dataclass(frozen=True, eq=False)
class Fibres:
    """Elements with one fibre direction each, in lattice units.

    Parameters
    ----------
    cells : ndarray of int32, (n, 3)
    direction : ndarray, (n, 3)
        Unit vector at rest.
    stiffness : ndarray, (n,)
        Young's modulus that fibres add in tension, kPa, weighted by the element's tissue.

    Notes
    -----
    Transverse isotropy: W = k/2 (L - 1)^2 for a stretch L > 1, k = (ratio - 1) E, added to the
    isotropic energy. L is that at the element's centre; a change of volume, 2 % at most, is not
    taken out of it. Tanner et al. 2011, Med Phys 38:682, found tissue in vivo to stretch less from
    front to back than isotropic models say.
    """

    cells: NDArray[np.int32]
    direction: NDArray[np.float64]
    stiffness: NDArray[np.float64]

    @classmethod
    def of(cls, shear: NDArray[np.float32], origin: NDArray[np.float64], ratio: float) -> Fibres:
        """Fibres of a body, which spread from a point behind its chest wall.

        Parameters
        ----------
        shear : ndarray of float32, [x, y, z]
            Shear modulus of each element, kPa; 0 where there is none.
        origin : ndarray, (3,)
            Where they come from, lattice units.
        ratio : float
            Young's modulus along the fibres over that across.
        """
        cells = np.argwhere(shear > 0.0).astype(np.int32)
        direction = cells + 0.5 - origin
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        young = 3.0 * shear[tuple(cells.T)].astype(np.float64)
        return cls(cells, direction, (ratio - 1.0) * young)

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        return float(kernels.fibre_forces(u, self.cells, self.direction, self.stiffness, force))

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Add the second derivative of the energy, which is never negative, to a block stencil."""
        kernels.add_fibre_stiffness(u, self.cells, self.direction, self.stiffness, stencil)
