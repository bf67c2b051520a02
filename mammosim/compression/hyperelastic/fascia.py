"""What ties the breast's back to the chest: the retromammary fascia, and the skin around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

WALL = 1
"""x index of the chest wall's nodes."""

RIM_MM = 15.0
"""Width of the rim along which the breast's back merges into the fat beneath the skin of the chest
(assumed)."""

RIM_PART = 0.13
"""Stiffness of the tie at the border of the breast, in units of that of the fascia: the same loose
tissue, but 10 mm of it (the fat beneath the skin of the chest; assumed) in place of 1.3 mm."""


@dataclass(frozen=True, eq=False)
class Fascia:
    """Ties of the wall's nodes to where they were at rest, along the wall only.

    Parameters
    ----------
    ties : ndarray of float32, [3, y, z]
        Stiffness yy, yz and zz of each node, kPa times an element's edge.

    Notes
    -----
    A layer of thickness t and shear modulus G resists a displacement u along it with the stress
    G u / t. Its nodes are held along the wall's normal elsewhere (`mesh`).
    """

    ties: NDArray[np.float32]

    @classmethod
    def of(
        cls,
        fraction: NDArray[np.float32],
        active: NDArray[np.bool_],
        stiffness: float,
        border: SkinBorder | None = None,
    ) -> Fascia:
        """Fascia behind the elements of the wall's layer, and what is around it.

        Parameters
        ----------
        fraction : ndarray of float32, [x, y, z]
            Part of each cell that is tissue.
        active : ndarray of bool, [x, y, z]
            Elements that there are.
        stiffness : float
            kPa per length of an element's edge.
        border : SkinBorder, optional
            Where the breast's skin meets the wall; the layer is softer there, and the skin goes on.
        """
        layer = 0.25 * _of_four(fraction[WALL] * active[WALL]) * stiffness
        ties = np.stack([layer, np.zeros_like(layer), layer])
        if border is not None:
            ties = ties * border.part_of_layer() + border.skin_beyond(RIM_PART * stiffness)
        return cls(ties.astype(np.float32))

    def add_forces(self, u: NDArray[np.float64], force: NDArray[np.float64]) -> float:
        """Add the energy's derivative by each node's displacement to `force`; the energy."""
        (y, z), (yy, yz, zz) = u[1:, WALL], self.ties
        pull = np.stack([yy * y + yz * z, yz * y + zz * z])
        force[1:, WALL] += pull
        return 0.5 * float((pull[0] * y + pull[1] * z).sum())

    def add_tangent(self, u: NDArray[np.float64], stencil: NDArray[np.float32]) -> None:
        """Add the second derivative of the energy to a block stencil."""
        yy, yz, zz = self.ties
        for place, part in ((4, yy), (5, yz), (7, yz), (8, zz)):
            stencil[WALL, :, place] += part


@dataclass(frozen=True, eq=False)
class SkinBorder:
    """Where the breast's skin meets the wall and, in the body, goes on as that of the chest.

    Parameters
    ----------
    length : ndarray, [y, z]
        Of the border that each node of the wall stands for, element edges; 0 inside.
    normal : ndarray, [2, y, z]
        Unit normal of the border in the wall.
    tension : float
        Shear modulus of the skin times its thickness, kPa times an element's edge.
    rim : float
        `RIM_MM` in element edges.
    """

    length: NDArray[np.float64]
    normal: NDArray[np.float64]
    tension: float
    rim: float

    @classmethod
    def of(
        cls,
        active: NDArray[np.bool_],
        skin: NDArray[np.float32],
        least: float,
        tension: float,
        rim: float,
    ) -> SkinBorder:
        """Border of the elements of the wall's layer.

        Parameters
        ----------
        active : ndarray of bool, [x, y, z]
            Elements that there are.
        skin : ndarray of float32, [x, y, z]
            Part of each cell that is skin.
        least : float
            Smallest thickness that counts as skin, element edges: where there is less, the phantom
            was cut off.
        tension, rim : float
            As the class takes them.
        """
        wall = active[WALL].astype(np.float64)
        across = np.stack([
            _of_pair(wall - np.roll(wall, 1, 0), 1), _of_pair(wall - np.roll(wall, 1, 1), 0)
        ])  # fmt: skip
        length = 0.5 * np.hypot(*across)
        normal = np.divide(across, 2.0 * length, out=np.zeros_like(across), where=length > 0.0)
        covered = 0.5 * _of_four(skin[WALL]) >= least
        return cls(length * covered, normal, tension, rim)

    def part_of_layer(self) -> NDArray[np.float64]:
        """Stiffness of the layer behind each node in units of that far from the border, [y, z]."""
        if not self.length.any():
            return np.ones_like(self.length)
        distance = ndimage.distance_transform_edt(self.length == 0.0)
        return RIM_PART + (1.0 - RIM_PART) * np.minimum(distance / self.rim, 1.0)

    def skin_beyond(self, stiffness: float) -> NDArray[np.float64]:
        """Stiffness yy, yz and zz with which the skin of the chest holds each node, [3, y, z].

        Parameters
        ----------
        stiffness : float
            Of the layer beneath the skin of the chest, kPa per length of an element's edge.

        Notes
        -----
        A long sheet of stiffness E t on a layer that resists a displacement u with the stress k u
        follows E t u'' = k u. Its end is held by sqrt(E t k) u for each length of the border: E is
        four shear moduli across the border (plane strain, incompressible) and one along it. It is
        taken to bear pressure, too, since skin is under tension at rest.
        """
        y, z = self.normal
        along = np.sqrt(self.tension * stiffness) * self.length
        return along * np.stack([1.0 + y * y, y * z, 1.0 + z * z])


def _of_pair(cells: NDArray[np.floating], axis: int) -> NDArray[np.floating]:
    """Sum of the cells before and after each node along an axis."""
    return cells + np.roll(cells, 1, axis)


def _of_four(cells: NDArray[np.floating]) -> NDArray[np.floating]:
    """Sum of the four cells around each node, [y, z]."""
    return _of_pair(_of_pair(cells, 0), 1)
