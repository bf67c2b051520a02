"""A target: where something of interest was, where it went, and where it appears."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """One row of `lesions.csv`: one target in one view.

    The fields are the table's columns, in its order; lengths are in mm. `x_mm ...` is the
    uncompressed centroid in the breast frame, `compressed_x_mm ...` its place in the gantry frame,
    `shift_x_mm ...` its displacement in the breast frame. `clock_position`, `nipple_distance_mm`
    and `skin_depth_mm` belong to the uncompressed breast. `image_row_px` and `image_col_px` count
    from 0, whole numbers at pixel centres.
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
