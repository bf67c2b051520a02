"""Plates in a phantom's voxels: a breast that is compressed already."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.breast import CompressedState

PLATE_LABEL = 50
"""Value of both plates in FDA's VICTRE (Constants.py of VICTRE_PIPELINE), and so in mammosim's and
VICTRE's label maps, where it counts as air."""


def find_plates(values: NDArray[Any], frame: VoxelFrame) -> CompressedState | None:
    """Where the plates are that hold a breast, from their voxels.

    Parameters
    ----------
    values : ndarray, [x, y, z]
        Values of the file.
    frame : VoxelFrame
        Where the voxels are, z from the breast support to the paddle, mm.

    Returns
    -------
    CompressedState or None
        None where there are not two plates, one above the other.

    Notes
    -----
    A plate's face is the median over the columns of voxels that both plates cross: tissue may stand
    in a plate here and there, and VICTRE's plates have rounded edges and a lip.
    """
    layers = np.zeros(values.shape[2], bool)
    for part in _slabs(values):
        layers[part[2]] |= (values[part] == PLATE_LABEL).any(axis=(0, 1))
    index = np.flatnonzero(layers)
    if index.size == 0:
        return None
    middle = 0.5 * (index[0] + index[-1])
    lower = np.full(values.shape[:2], -1, np.int32)
    upper = np.full(values.shape[:2], values.shape[2], np.int32)
    for part in _slabs(values):
        plate = values[part] == PLATE_LABEL
        z = np.arange(values.shape[2], dtype=np.int32)[part[2]]
        below = np.where(plate & (z < middle), z, -1).max(axis=2)
        above = np.where(plate & (z > middle), z, values.shape[2]).min(axis=2)
        lower[part[:2]] = np.maximum(lower[part[:2]], below)
        upper[part[:2]] = np.minimum(upper[part[:2]], above)
    both = (lower >= 0) & (upper < values.shape[2]) & (upper - lower > 1)
    if not both.any():
        return None
    step = frame.spacing_mm[2]
    support = frame.origin_mm[2] + step * (float(np.median(lower[both])) + 0.5)
    paddle = frame.origin_mm[2] + step * (float(np.median(upper[both])) - 0.5)
    first = int(np.flatnonzero(both.any(axis=1))[0])
    edge = frame.origin_mm[0] + frame.spacing_mm[0] * (first - 0.5)
    return CompressedState(None, float(support), float(paddle), float(edge))


def _slabs(values: NDArray[Any]) -> list[tuple[slice, slice, slice]]:
    """Layers along the slowest axis, one after the other."""
    axis = int(np.argmax(np.abs(values.strides)))
    slabs = []
    for at in range(values.shape[axis]):
        part = [slice(None)] * 3
        part[axis] = slice(at, at + 1)
        slabs.append((part[0], part[1], part[2]))
    return slabs
