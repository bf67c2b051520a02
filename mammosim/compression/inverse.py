"""The inverse of a displacement field on a regular grid of the compressed breast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression._inverse_kernels import KUHN_TETRAHEDRA, rasterise_inverse
from mammosim.compression.continuation import continued
from mammosim.geometry import VoxelFrame

RIM_LAYERS = 1
"""Layers of grid points around the covered ones that are continued, so that interpolation works up
to the skin."""


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
    frame: VoxelFrame, displacement_mm: NDArray[np.float32], tissue: NDArray[np.bool_]
) -> InverseMap:
    """Turn a displacement field round.

    Parameters
    ----------
    frame : VoxelFrame
        Lattice at rest.
    displacement_mm : ndarray, [x, y, z, 3]
        Displacement of its nodes, continued into the air around the tissue.
    tissue : ndarray of bool, [x, y, z]

    Notes
    -----
    Each deformed cell is cut into six tetrahedra in which the field is linear; grid points inside
    get the exact inverse of that. Where tissue folds over itself, cells deeper inside win. The
    grid has the lattice's spacing, and its points coincide with the nodes where nothing moves.
    """
    displacement = displacement_mm / frame.spacing_mm
    index = np.argwhere(tissue)
    moved = index + displacement[tissue]
    shift = np.floor(moved.min(axis=0)) - 2.0
    nx, ny, nz = (int(n) for n in np.ceil(moved.max(axis=0)) + 3.0 - shift)
    shape = (nx, ny, nz)
    original = np.full((*shape, 3), np.nan)
    rank = np.zeros(shape, np.int8)
    rasterise_inverse(displacement, tissue, shift, KUHN_TETRAHEDRA, original, rank)
    covered = rank > 0
    grid = np.indices(shape) + shift[:, None, None, None]
    back = continued(
        np.where(covered, np.moveaxis(original, -1, 0) - grid, 0.0), covered, RIM_LAYERS
    )
    rim = continued(covered[None].astype(np.float32), covered, RIM_LAYERS)[0] > 0.0
    places = np.where(rim, grid + back, np.nan)
    original_mm = frame.origin_mm + np.moveaxis(places, 0, -1) * frame.spacing_mm
    inverse_frame = VoxelFrame(frame.position_mm(shift), frame.spacing_mm, shape)
    return InverseMap(inverse_frame, original_mm.astype(np.float32))
