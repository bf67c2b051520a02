"""The inverse map in the phantom's own voxels, with the density that compression leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim._derived import Derived
from mammosim.compression import CompressedBreast, InverseMap
from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.projection._grid_kernels import measure_cells

DENSITY_LIMITS = (0.5, 2.0)
"""Bounds of 1/J: beyond them a cell is collapsed or torn, and its J is no longer physics."""


@dataclass(frozen=True, eq=False)
class VoxelMap:
    """Which voxel of the phantom came to lie at each node of the inverse map.

    Parameters
    ----------
    frame : VoxelFrame
        Grid of the inverse map, compression frame, mm.
    nodes : ndarray of float32, [x, y, z, 4]
        Fractional voxel of the phantom (voxel i covers i to i + 1), then 1/J, the density against
        that before compression; NaN where no tissue came to lie.
    tissue : ndarray of bool, [x, y, z]
        Cells of the grid (one less than nodes along each axis) that hold tissue.
    clipped_fraction : float
        Fraction of the compressed tissue volume whose 1/J was clipped to `DENSITY_LIMITS`.
    """

    frame: VoxelFrame
    nodes: NDArray[np.float32]
    tissue: NDArray[np.bool_]
    clipped_fraction: float


_maps: Derived[CompressedBreast, VoxelMap] = Derived()
"""Projection, scatter and the volumes of one view, which are written beside them, need the same."""


def voxel_map(compressed: CompressedBreast) -> VoxelMap:
    """Fold rotation and voxel grid into the inverse map, and find the density at its nodes.

    Parameters
    ----------
    compressed : CompressedBreast

    Returns
    -------
    VoxelMap

    Raises
    ------
    InputError
        If the inverse map has fewer than two nodes along an axis, or no tissue in it.

    Notes
    -----
    1/J of a cell is the exact volume of its eight mapped corners, joined trilinearly, over the
    cell's own. A node has the mean of the cells around it, weighted by the tissue in them; between
    nodes it is interpolated. A density that jumped from cell to cell would draw the grid into the
    picture. A breast's map is kept as long as the breast is.
    """
    return _maps.of(compressed, lambda: _made_map(compressed))


def _made_map(compressed: CompressedBreast) -> VoxelMap:
    inverse = compressed.inverse
    if min(inverse.frame.shape) < 2:
        raise InputError(
            f"inverse map: found {inverse.frame.shape} nodes, expected at least 2 along each axis"
        )
    nodes = voxels_at(compressed, inverse)
    cells = tuple(size - 1 for size in inverse.frame.shape)
    ratio = np.empty(cells, dtype=np.float64)
    tissue = np.empty(cells, dtype=np.uint8)
    measure_cells(nodes, compressed.phantom.labels, ratio, tissue)
    if not tissue.any():
        raise InputError("inverse map: found no tissue in it, expected the compressed breast")
    ratio *= np.prod(compressed.phantom.voxel_mm) / np.prod(inverse.frame.spacing_mm)
    density = np.clip(ratio, *DENSITY_LIMITS)
    clipped = tissue[(density != ratio) & np.isfinite(ratio)].sum(dtype=np.int64)
    nodes[..., 3] = _at_nodes(density, tissue)
    return VoxelMap(inverse.frame, nodes, tissue > 0, float(clipped / tissue.sum(dtype=np.int64)))


def voxels_at(compressed: CompressedBreast, inverse: InverseMap) -> NDArray[np.float32]:
    """Nodes [x, y, z, 4] of an inverse map with the fractional voxel of each and density 1."""
    phantom, original = compressed.phantom, inverse.original_mm
    nodes = np.ones((*original.shape[:3], 4), dtype=np.float32)
    for plane, place_mm in zip(nodes, original, strict=True):  # a plane at a time spares memory
        index = phantom.frame.index(compressed.view.breast_from_compression(place_mm))
        plane[..., :3] = index + 0.5
    return nodes


def _at_nodes(density: NDArray[np.float64], tissue: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Density at nodes: mean of the cells around, weighted by their tissue.

    Cells without tissue count for next to nothing: the displacement is only continued there.
    """
    weight = np.where(np.isfinite(density), tissue + 1e-6, 0.0)
    product = np.where(weight > 0.0, density, 0.0) * weight
    shape = tuple(size + 1 for size in density.shape)
    total, weights = np.zeros(shape), np.zeros(shape)
    for corner in np.ndindex(2, 2, 2):
        part = tuple(slice(at, at + size) for at, size in zip(corner, density.shape, strict=True))
        total[part] += product
        weights[part] += weight
    return np.divide(total, weights, out=np.ones(shape), where=weights > 0.0)
