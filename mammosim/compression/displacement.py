"""The displacement field of a compressed breast, and its inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame


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


@dataclass(frozen=True, eq=False)
class DisplacementField:
    """Displacement at the nodes of a lattice in the compression frame.

    Parameters
    ----------
    frame : VoxelFrame
        Lattice at rest, **compression frame**, mm.
    displacement_mm : ndarray of float32, [x, y, z, 3]
        Displacement of each node, components in the **compression frame**, mm; continued into
        the air around the tissue.
    tissue : ndarray of bool, [x, y, z]
        Nodes that are tissue.
    rotation : ndarray, (3, 3)
        Breast frame to compression frame.
    """

    frame: VoxelFrame
    displacement_mm: NDArray[np.float32]
    tissue: NDArray[np.bool_]
    rotation: NDArray[np.float64]
