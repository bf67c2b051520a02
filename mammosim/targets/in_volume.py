"""Where a target lies in the slices that were reconstructed from a series of projections."""

from __future__ import annotations

from dataclasses import replace

from mammosim.reconstruction import VolumeGrid
from mammosim.targets.target import Target


def in_volume(target: Target, grid: VolumeGrid) -> Target:
    """A target with its place in a volume.

    Parameters
    ----------
    target : Target
        Of the view that the volume is of.
    grid : VolumeGrid

    Returns
    -------
    Target
        A place outside of the volume is given as well: a negative slice, for instance.
    """
    place_mm = (target.compressed_x_mm, target.compressed_y_mm, target.compressed_z_mm)
    slice_, row, column = (float(index) for index in grid.voxel_of(place_mm))
    return replace(target, volume_slice=slice_, volume_row_px=row, volume_col_px=column)
