"""The breast frame, the compression frame, and voxel grids in them.

The breast frame is right-handed: +x anterior, +y towards the patient's left, +z superior. The
compression frame is the breast frame rotated about x so that its z is the plates' normal, from
the breast support to the paddle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


def compression_from_breast(angle_deg: float, laterality: str) -> NDArray[np.float64]:
    """Rotation that takes breast-frame vectors to the compression frame.

    Parameters
    ----------
    angle_deg : float
        Angle of the plates' normal from superior towards medial, degrees; 0 for CC, 90 for ML.
    laterality : {"L", "R"}
        Which breast: medial is -y for a left breast and +y for a right one.

    Returns
    -------
    ndarray, (3, 3)
        R with ``p_compression = R @ p_breast``.

    Examples
    --------
    >>> np.abs(compression_from_breast(45.0, "L") @ [0.0, -1.0, 1.0]).round(6).tolist()
    [0.0, 0.0, 1.414214]
    """
    angle = np.deg2rad(angle_deg)
    c, s = np.cos(angle), np.sin(angle)
    if laterality == "R":
        s = -s
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


@dataclass(frozen=True, eq=False)
class VoxelFrame:
    """A regular grid of points: centres of voxels, or nodes of a lattice.

    Parameters
    ----------
    origin_mm : ndarray, (3,)
        Position of point [0, 0, 0], mm.
    spacing_mm : ndarray, (3,)
        Distance between neighbours along each axis, mm.
    shape : tuple of int
        Number of points along x, y, z.
    """

    origin_mm: NDArray[np.float64]
    spacing_mm: NDArray[np.float64]
    shape: tuple[int, int, int]

    def position_mm(self, index: ArrayLike) -> NDArray[np.float64]:
        """Positions (..., 3) in mm of fractional indices (..., 3)."""
        return self.origin_mm + np.asarray(index, dtype=np.float64) * self.spacing_mm

    def axis_mm(self, axis: int) -> NDArray[np.float64]:
        """Coordinates of the points along one axis, mm."""
        return self.origin_mm[axis] + self.spacing_mm[axis] * np.arange(self.shape[axis])

    def index(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """Fractional indices (..., 3) of positions (..., 3) in mm."""
        return (np.asarray(points_mm, dtype=np.float64) - self.origin_mm) / self.spacing_mm
