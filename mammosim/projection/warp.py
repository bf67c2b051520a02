"""The compressed breast as labels on a regular grid, for viewers and for checks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.projection._grid_kernels import carry_labels
from mammosim.projection.voxel_map import VoxelMap, voxel_map, voxels_at

MAX_VOXELS = 200_000_000
"""Most voxels that are made unasked: 200 MB of labels, which viewers still open."""

MAP_SPACING_MM = 0.75
"""Spacing that a coarser inverse map is refined to. In an oblique view by springs with cells of
3 mm, interpolating one point per cell misses the field's own inverse by 0.16 mm on average and
0.5 mm at the 95th percentile; at 0.75 mm the voxels matter more."""


def compressed_labels(
    compressed: CompressedBreast, voxel_mm: float | None = None
) -> tuple[NDArray[np.uint8], VoxelFrame]:
    """Labels of the compressed breast on a regular grid of cubic voxels.

    Parameters
    ----------
    compressed : CompressedBreast
    voxel_mm : float, optional
        Voxel size, mm. Left out, the phantom's own smallest voxel, or as much more as keeps the
        array below `MAX_VOXELS`.

    Returns
    -------
    labels : ndarray of uint8, [x, y, z]
        Label of the phantom's voxel that came to lie at each voxel's centre.
    frame : VoxelFrame
        The grid, **compression frame**, mm: the box of cells of the inverse map that hold tissue.

    Raises
    ------
    InputError
        If `voxel_mm` is not above 0.

    Notes
    -----
    The inverse map, refined to about `MAP_SPACING_MM`, is interpolated trilinearly and the nearest
    label taken: structures thinner than a voxel may be lost. The projection does not use this
    array.
    """
    if voxel_mm is not None and not voxel_mm > 0.0:
        raise InputError(f"voxel_mm: found {voxel_mm}, expected a length above 0 mm")
    mapped = voxel_map(compressed)
    low, high = _tissue_box_mm(mapped)
    if voxel_mm is None:
        voxel_mm = _affordable(float(min(compressed.phantom.voxel_mm)), high - low)
    nx, ny, nz = (max(math.ceil(length / voxel_mm - 1e-6), 1) for length in high - low)
    # Centred on the box, so that no more than half a voxel stands out on either side.
    origin = 0.5 * (low + high) - 0.5 * voxel_mm * (np.array([nx, ny, nz]) - 1)
    frame = VoxelFrame(origin, np.full(3, voxel_mm), (nx, ny, nz))
    map_frame, nodes = _fine_nodes(compressed, mapped)
    axes = [
        np.clip(
            map_frame.index(frame.position_mm(np.arange(count)[:, None]))[:, axis],
            0.0,
            map_frame.shape[axis] - 1.0,
        )
        for axis, count in enumerate(frame.shape)
    ]
    labels = np.empty(frame.shape, dtype=np.uint8)
    carry_labels(*axes, nodes, compressed.phantom.labels, labels)
    return labels, frame


def _fine_nodes(
    compressed: CompressedBreast, mapped: VoxelMap
) -> tuple[VoxelFrame, NDArray[np.float32]]:
    """Nodes of an inverse map of about `MAP_SPACING_MM`: those available, or computed."""
    per_cell = round(float(max(mapped.frame.spacing_mm)) / MAP_SPACING_MM)
    if per_cell < 2 or not compressed.is_compressed:
        return mapped.frame, mapped.nodes
    inverse = compressed.field.inverse_with(per_cell)
    return inverse.frame, voxels_at(compressed, inverse)


def _tissue_box_mm(mapped: VoxelMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner of the box of cells that hold tissue, mm."""
    bounds = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        cells = np.flatnonzero(mapped.tissue.any(axis=others))
        bounds.append((cells[0], cells[-1] + 1))
    low, high = np.array(bounds).T
    return mapped.frame.position_mm(low), mapped.frame.position_mm(high)


def _affordable(voxel_mm: float, extent_mm: NDArray[np.float64]) -> float:
    """The voxel size, enlarged where the box would hold too many voxels."""
    return max(voxel_mm, float(np.cbrt(np.prod(extent_mm + voxel_mm) / MAX_VOXELS)))
