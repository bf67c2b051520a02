"""A target: where something of interest was, where it went, and where it appears."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Target:
    """One row of `lesions.csv`: one target in one view.

    The fields are the table's columns, in its order; lengths are in mm. `x_mm ...` is the
    uncompressed centroid in the breast frame, `compressed_x_mm ...` its place in the gantry frame,
    `shift_x_mm ...` its displacement in the breast frame. `clock_position`, `nipple_distance_mm`
    and `skin_depth_mm` belong to the uncompressed breast. `image_row_px` and `image_col_px` count
    from 0, whole numbers at pixel centres. `moved_x_mm ...` is the compressed place in the breast
    frame, `gantry_x_mm ...` the uncompressed one in the gantry frame. What stands from there on may
    be unknown (NaN), as the contrast of a landmark; `ellipsoid_..._mm` are semi-axes and need
    `targets.uncertainty`; `extent_mm` is the largest distance across the uncompressed lesion.
    `laterality` is the breast, L or R; `volume_slice ...` is the place in a
    reconstructed volume, whole numbers at voxel centres.
    """

    target_id: int
    name: str
    kind: str
    view: str
    volume_mm3: float
    x_mm: float
    y_mm: float
    z_mm: float
    clock_position: str
    nipple_distance_mm: float
    skin_depth_mm: float
    compressed_x_mm: float
    compressed_y_mm: float
    compressed_z_mm: float
    shift_x_mm: float
    shift_y_mm: float
    shift_z_mm: float
    shift_mm: float
    volume_ratio: float
    stretch_max: float
    stretch_min: float
    image_row_px: float
    image_col_px: float
    image_nipple_distance_mm: float
    in_field: bool
    moved_x_mm: float = math.nan
    moved_y_mm: float = math.nan
    moved_z_mm: float = math.nan
    gantry_x_mm: float = math.nan
    gantry_y_mm: float = math.nan
    gantry_z_mm: float = math.nan
    shift_along_mm: float = math.nan
    shift_across_mm: float = math.nan
    stretch_middle: float = math.nan
    contrast: float = math.nan
    sdnr: float = math.nan
    ellipsoid_long_mm: float = math.nan
    ellipsoid_middle_mm: float = math.nan
    ellipsoid_short_mm: float = math.nan
    extent_mm: float = math.nan
    laterality: str = ""
    volume_slice: float = math.nan
    volume_row_px: float = math.nan
    volume_col_px: float = math.nan

    @property
    def place_mm(self) -> NDArray[np.float64]:
        """(3,) uncompressed place, breast frame, mm."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    @property
    def shift_vector_mm(self) -> NDArray[np.float64]:
        """(3,) displacement, breast frame, mm."""
        return np.array([self.shift_x_mm, self.shift_y_mm, self.shift_z_mm])

    @property
    def is_lesion(self) -> bool:
        """Whether it is something that was put there to be found."""
        return self.kind not in ("landmark", "nipple")
