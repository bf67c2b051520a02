"""The displacement field of a compressed breast: values, gradient, and inverse at any point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.compression.inverse import InverseMap, invert
from mammosim.geometry import VoxelFrame

INVERSE_STEPS = 12
"""Newton steps from the gridded inverse to the exact one; 2 or 3 are usual."""

INVERSE_TOLERANCE_MM = 1e-6
"""Distance at which the inverse of a point is taken as found, mm."""


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """Displacement at the nodes of a lattice in the compression frame, trilinear between them.

    Parameters
    ----------
    frame : VoxelFrame
        Lattice at rest, **compression frame**, mm.
    displacement_mm : ndarray of float32, [x, y, z, 3]
        Displacement of each node, components in the **compression frame**, mm; continued into
        the air around the tissue.
    tissue : ndarray of bool, [x, y, z]
        Nodes that are tissue.
    rotation : ndarray, (3, 3)
        Breast frame to compression frame.
    """

    frame: VoxelFrame
    displacement_mm: NDArray[np.float32]
    tissue: NDArray[np.bool_]
    rotation: NDArray[np.float64]

    def __repr__(self) -> str:
        nodes = " x ".join(str(count) for count in self.frame.shape)
        sizes = " x ".join(f"{step:g}" for step in self.frame.spacing_mm)
        return f"<DisplacementField: {nodes} nodes, {sizes} mm apart>"

    def displacement_at(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) displacement in mm at uncompressed points (n, 3), both in the breast frame."""
        points = _points(points_mm) @ self.rotation.T
        displacement, _ = self._interpolate(points)
        return displacement @ self.rotation

    def deformation_gradient_at(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(n, 3, 3) deformation gradient F = dx/dX at uncompressed points, breast frame."""
        points = _points(points_mm) @ self.rotation.T
        _, gradient = self._interpolate(points)
        turned: NDArray[np.float64] = self.rotation.T @ (np.eye(3) + gradient) @ self.rotation
        return turned

    @cached_property
    def inverse(self) -> InverseMap:
        """The map back to the uncompressed breast, on a regular grid."""
        return invert(self.frame, self.displacement_mm, self.tissue)

    def inverse_with(self, per_cell: int) -> InverseMap:
        """The same map with several grid points per lattice cell along each axis; not kept.

        It inverts the trilinear field; `inverse` is that of a field linear in tetrahedra, which
        differs from the trilinear one within a cell.
        """
        return invert(self.frame, self.displacement_mm, self.tissue, per_cell)

    def original_point(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(n, 3) uncompressed place of compressed points (n, 3), both in the breast frame, mm.

        Rows are NaN where no tissue, nor the cell around it, came to lie.
        """
        wanted = _points(points_mm) @ self.rotation.T
        inverse = self.inverse
        places, _ = _trilinear(inverse.original_mm, inverse.frame.index(wanted))
        places[~_inside(inverse.frame, wanted)] = np.nan
        known = np.isfinite(places).all(axis=1)
        best, distance = places.copy(), np.where(known, np.inf, 0.0)
        for _ in range(INVERSE_STEPS):
            displacement, gradient = self._interpolate(places)
            miss = places + displacement - wanted
            length = np.linalg.norm(miss, axis=1)
            better = length < distance
            best[better], distance[better] = places[better], length[better]
            if not (distance > INVERSE_TOLERANCE_MM).any():
                break
            places = places - _newton_step(np.eye(3) + gradient, miss)
        return best @ self.rotation

    def _interpolate(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacement (n, 3) and its gradient (n, 3, 3) at compression-frame points."""
        value, gradient = _trilinear(self.displacement_mm, self.frame.index(points))
        return value, gradient / self.frame.spacing_mm


def _points(points_mm: ArrayLike) -> NDArray[np.float64]:
    return np.atleast_2d(np.asarray(points_mm, dtype=np.float64))


def _inside(frame: VoxelFrame, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    index = frame.index(points)
    inside = (index >= 0) & (index <= np.array(frame.shape) - 1)
    return np.asarray(inside.all(axis=1))


def _trilinear(
    field: NDArray[np.floating], index: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Value (n, c) and gradient over the index (n, c, 3) of a field [x, y, z, c].

    Outside the grid the field goes on as at its edge.
    """
    limits = np.array(field.shape[:3]) - 1
    place = np.clip(np.nan_to_num(index), 0.0, limits)
    low = np.minimum(place.astype(np.intp), limits - 1)
    part = place - low
    value = np.zeros((len(index), field.shape[3]))
    gradient = np.zeros((len(index), field.shape[3], 3))
    for corner in product((0, 1), repeat=3):
        node = low + corner
        here = field[node[:, 0], node[:, 1], node[:, 2]].astype(np.float64)
        weights = np.where(corner, part, 1.0 - part)
        value += weights.prod(axis=1)[:, None] * here
        for axis in range(3):
            others = weights[:, [d for d in range(3) if d != axis]].prod(axis=1)
            sign = 1.0 if corner[axis] else -1.0
            gradient[:, :, axis] += (sign * others)[:, None] * here
    value[np.isnan(index).any(axis=1)] = np.nan
    return value, gradient


def _newton_step(matrices: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Newton step of each point; a fixed-point step where the field folds or nothing is known."""
    good = np.isfinite(right).all(axis=1) & (np.abs(np.linalg.det(matrices)) > 1e-3)
    step = right.copy()
    step[good] = np.linalg.solve(matrices[good], right[good][:, :, None])[:, :, 0]
    return step
