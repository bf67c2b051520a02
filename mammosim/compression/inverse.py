"""The inverse of a displacement field on a regular grid of the compressed breast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_cdt

from mammosim.compression._inverse_kernels import (
    KUHN_TETRAHEDRA,
    MAX_DEPTH,
    places_before,
    rasterise_inverse,
    refine_inverse,
    shifts_back,
)
from mammosim.compression.continuation import continue_into_air
from mammosim.geometry import VoxelFrame

RIM_LAYERS = 1
"""Layers of lattice cells around the covered points that are continued, so that interpolation works
up to the skin."""


@dataclass(frozen=True, eq=False)
class InverseMap:
    """Where each point of the compressed breast came from, on a regular grid.

    Parameters
    ----------
    frame : VoxelFrame
        Grid in the **compression frame**, mm.
    original_mm : ndarray of float32, [x, y, z, 3]
        Place in the uncompressed breast, **compression frame** (rotate by the view's rotation
        transposed for the breast frame), mm. NaN where no tissue, nor its neighbourhood, came
        to lie.
    """

    frame: VoxelFrame
    original_mm: NDArray[np.float32]


def invert(
    frame: VoxelFrame,
    displacement_mm: NDArray[np.float32],
    tissue: NDArray[np.bool_],
    per_cell: int = 1,
) -> InverseMap:
    """Turn a displacement field round.

    Parameters
    ----------
    frame : VoxelFrame
        Lattice at rest.
    displacement_mm : ndarray, [x, y, z, 3]
        Displacement of its nodes, continued into the air around the tissue.
    tissue : ndarray of bool, [x, y, z]
    per_cell : int
        Grid points of the inverse per lattice cell along each axis.

    Notes
    -----
    Each deformed cell is cut into six tetrahedra in which the field is linear; grid points inside
    get the exact inverse of that. Where tissue folds over itself, cells deeper below the surface
    win. With one point per cell the grid's points coincide with the nodes where nothing moves. With
    more, Newton steps lead from there to the inverse of the trilinear field, which other programs
    take from `displacement.nii.gz`.
    """
    displacement = displacement_mm / frame.spacing_mm
    index = np.argwhere(tissue)
    moved = per_cell * (index + displacement[tissue])
    shift = np.floor(moved.min(axis=0)) - 2.0
    nx, ny, nz = (int(n) for n in np.ceil(moved.max(axis=0)) + 3.0 - shift)
    shape = (nx, ny, nz)
    original = np.empty((3, *shape))
    rank = np.zeros(shape, np.int8)
    depth = distance_transform_cdt(np.pad(tissue, 1))[1:-1, 1:-1, 1:-1]  # beyond the lattice is air
    depth = np.minimum(depth, MAX_DEPTH).astype(np.int8)
    rasterise_inverse(displacement, depth, float(per_cell), shift, KUHN_TETRAHEDRA, original, rank)
    if per_cell > 1:
        refine_inverse(displacement, float(per_cell), shift, rank, original)
    shifts_back(original, rank, float(per_cell), shift)
    layer = continue_into_air(original, rank > 0, per_cell * RIM_LAYERS)
    original_mm = np.empty((*shape, 3), np.float32)
    places_before(
        original, layer, float(per_cell), shift, frame.origin_mm, frame.spacing_mm, original_mm
    )
    inverse_frame = VoxelFrame(
        frame.position_mm(shift / per_cell), frame.spacing_mm / per_cell, shape
    )
    return InverseMap(inverse_frame, original_mm)
