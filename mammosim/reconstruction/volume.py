"""The grid of a reconstructed volume: slices parallel to the detector, in its picture's layout."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.geometry import Gantry


class Box(NamedTuple):
    """Rows and columns of a picture, from the first up to the one before the end."""

    first_row: int
    end_row: int
    first_column: int
    end_column: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.end_row - self.first_row

    @property
    def columns(self) -> int:
        """Number of columns."""
        return self.end_column - self.first_column


@dataclass(frozen=True)
class VolumeGrid:
    """Where the voxels of a reconstruction are.

    Slice 0 lies at the breast support. Rows and columns run as those of the detector's picture, so
    that a slice and a projection are seen the same way round.

    Parameters
    ----------
    shape : tuple of int
        Number of slices, rows and columns.
    slice_mm, pixel_mm : float
        Distance between slices, and between rows and columns, mm.
    first_voxel_mm : tuple of float
        (3,) centre of voxel [0, 0, 0] in the gantry frame, mm.
    row_step, column_step : tuple of float
        (3,) unit vectors in the gantry frame from one row, or column, to the next.
    """

    shape: tuple[int, int, int]
    slice_mm: float
    pixel_mm: float
    first_voxel_mm: tuple[float, float, float]
    row_step: tuple[float, float, float]
    column_step: tuple[float, float, float]

    def voxel_of(self, points_mm: ArrayLike) -> NDArray[np.float64]:
        """(..., 3) slice, row and column of gantry points (..., 3) in mm.

        Whole numbers are voxel centres; a point may lie outside of the volume.
        """
        offset = np.asarray(points_mm, np.float64) - np.array(self.first_voxel_mm)
        return np.stack(
            [
                offset[..., 2] / self.slice_mm,
                offset @ np.array(self.row_step) / self.pixel_mm,
                offset @ np.array(self.column_step) / self.pixel_mm,
            ],
            axis=-1,
        )

    def gantry_from_voxel(self, voxels: ArrayLike) -> NDArray[np.float64]:
        """(..., 3) gantry points in mm of slices, rows and columns (..., 3)."""
        index = np.asarray(voxels, np.float64)
        slices, rows, columns = (index[..., axis, None] for axis in range(3))
        return np.array(self.first_voxel_mm) + (
            slices * self.slice_mm * np.array([0.0, 0.0, 1.0])
            + rows * self.pixel_mm * np.array(self.row_step)
            + columns * self.pixel_mm * np.array(self.column_step)
        )

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)


def volume_grid(
    gantry: Gantry,
    thickness_mm: float,
    slice_mm: float,
    pixel_mm: float | None = None,
    box: Box | None = None,
) -> VolumeGrid:
    """Slices that fill the space between support and paddle above a detector.

    Parameters
    ----------
    gantry : Gantry
        Of any projection of the series; its detector, with the tube upright, bounds rows and
        columns.
    thickness_mm : float
        Distance between support and paddle, mm.
    slice_mm : float
        Distance between slices, mm.
    pixel_mm : float, optional
        Pixel size within a slice, mm; default: that of the detector.
    box : Box, optional
        Pixels of the detector above which the volume lies; default: all.

    Returns
    -------
    VolumeGrid

    Notes
    -----
    The beam diverges, so that what is imaged at the detector's far edge lies further inwards in
    the breast: the detector's own extent holds all that is projected onto it from above.
    """
    pixel = gantry.pixel_mm if pixel_mm is None else pixel_mm
    box = box or Box(0, gantry.rows, 0, gantry.columns)
    rows = max(1, math.ceil(box.rows * gantry.pixel_mm / pixel - 1e-6))
    columns = max(1, math.ceil(box.columns * gantry.pixel_mm / pixel - 1e-6))
    slices = max(1, math.ceil(thickness_mm / slice_mm - 1e-6))
    first_row, first_column = box.first_row, box.first_column
    corner, down, right = (
        gantry.detector_xy_mm(first_row + row, first_column + column)
        for row, column in ((0, 0), (1, 0), (0, 1))
    )
    row_step = (down - corner) / gantry.pixel_mm
    column_step = (right - corner) / gantry.pixel_mm
    shift = 0.5 * (pixel - gantry.pixel_mm)
    first = corner + shift * (row_step + column_step)
    return VolumeGrid(
        (slices, rows, columns),
        slice_mm,
        pixel,
        (float(first[0]), float(first[1]), 0.5 * slice_mm),
        (float(row_step[0]), float(row_step[1]), 0.0),
        (float(column_step[0]), float(column_step[1]), 0.0),
    )


def box_above(gantry: Gantry, shadow: Box, thickness_mm: float) -> Box:
    """Pixels of the detector straight below what throws a shadow.

    Parameters
    ----------
    gantry : Gantry
        Of the projection that the shadow belongs to.
    shadow : Box
    thickness_mm : float
        What throws the shadow lies between the breast support and this height above it, mm.

    Returns
    -------
    Box
        Within the detector; all of it where the shadow is empty.
    """
    if shadow.rows <= 0 or shadow.columns <= 0:
        return Box(0, gantry.rows, 0, gantry.columns)
    rows = np.array([shadow.first_row, shadow.end_row]) - 0.5
    columns = np.array([shadow.first_column, shadow.end_column]) - 0.5
    edges, spot = gantry.detector_mm(rows[:, None], columns).reshape(-1, 3), gantry.focal_spot_mm
    shares = ((height - edges[:, 2:]) / (spot[2] - edges[:, 2:]) for height in (0.0, thickness_mm))
    above = (edges + share * (spot - edges) for share in shares)
    place = np.concatenate([gantry.pixel_of(*points_mm.T[:2]) for points_mm in above])
    low, high = np.floor(place.min(axis=0) + 0.5), np.ceil(place.max(axis=0) + 0.5)
    low, high = np.maximum(low, 0).astype(int), high.astype(int)
    return Box(
        int(low[0]), min(int(high[0]), gantry.rows), int(low[1]), min(int(high[1]), gantry.columns)
    )
