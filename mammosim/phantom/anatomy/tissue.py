"""Where strands may be in a breast, and the coordinates of its foam there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame


@dataclass(frozen=True, eq=False)
class Tissue:
    """Where strands may be: coarse fields [x, lateral, superior] and their frame.

    Parameters
    ----------
    skin_depth_mm, muscle_depth_mm : ndarray
        Distance below the skin, depth below the muscle's face.
    coordinates_mm : list of three ndarray
        Coordinates in which lobules are a power diagram.
    frame : VoxelFrame
    """

    skin_depth_mm: NDArray[np.float64]
    muscle_depth_mm: NDArray[np.float64]
    coordinates_mm: list[NDArray[np.float64]]
    frame: VoxelFrame

    @cached_property
    def inside(self) -> NDArray[np.int64]:
        """Indices (n, 3) of points of the grid in tissue, with what is close to it."""
        return np.argwhere((self.skin_depth_mm > -1.0) & (self.muscle_depth_mm < 2.0))

    @cached_property
    def places_mm(self) -> NDArray[np.float64]:
        """Their coordinates in the foam, (n, 3)."""
        return np.stack([part[tuple(self.inside.T)] for part in self.coordinates_mm], axis=-1)

    @cached_property
    def nearest(self) -> cKDTree:
        """Finds the nearest of them by its coordinates in the foam."""
        return cKDTree(self.places_mm)

    @cached_property
    def inverse_slope(self) -> NDArray[np.float64]:
        """Steps of the index for the coordinates, at each of them, (n, 3, 3)."""
        slopes = [np.stack(tuple(np.gradient(part)), axis=-1) for part in self.coordinates_mm]
        return np.linalg.inv(np.stack(slopes, axis=-2)[tuple(self.inside.T)])

    @property
    def volume_ml(self) -> float:
        """Volume within the skin and in front of the muscle."""
        held = (self.skin_depth_mm > 0.0) & (self.muscle_depth_mm < 0.0)
        return float(np.count_nonzero(held) * np.prod(self.frame.spacing_mm) / 1000.0)
