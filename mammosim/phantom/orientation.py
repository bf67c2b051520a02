"""Which breast it is, and where its nipple is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.bodies import find_bodies
from mammosim.tissues import TISSUES

NIPPLE_TIP_MM = 1.0
"""Nipple voxels within this of the most anterior one count as its tip: about one voxel."""

MIN_WEDGE_MM = 0.5
"""Least rise of the muscle's depth across the breast that tells a side: finer than this is the
staircase of voxels."""

RIM_MM = 15.0
"""Columns with less tissue than this, or than half of the most, belong to the breast's rim, where
skin and fat leave no room for muscle. Chosen by generated breasts."""


def nipple_position(
    labels: NDArray[np.uint8],
    frame: VoxelFrame,
    tip_index: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], bool]:
    """Tip of the nipple, or most anterior tissue where none is labelled.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
    frame : VoxelFrame
    tip_index : ndarray, (3,), optional
        Index of the most anterior tissue of the main body, sought where no nipple is labelled.

    Returns
    -------
    position_mm : ndarray, (3,)
        Breast frame, mm.
    labelled : bool
        Whether a nipple is labelled.
    """
    nipple = TISSUES["nipple"].label
    for layer in range(labels.shape[0] - 1, -1, -1):
        if (labels[layer] == nipple).any():
            depth = max(1, round(NIPPLE_TIP_MM / float(frame.spacing_mm[0])))
            start = max(0, layer + 1 - depth)
            centre = np.argwhere(labels[start : layer + 1] == nipple)[:, 1:].mean(axis=0)
            return frame.position_mm([layer, *centre]), True
    tip = find_bodies(labels).tip_index if tip_index is None else tip_index
    return frame.position_mm(tip), False


def side_of_muscle(
    labels: NDArray[np.uint8], frame: VoxelFrame, nipple_mm: NDArray[np.float64]
) -> str | None:
    """Side from the muscle wedge: below the nipple it is thicker medially, as the chest curves.

    The depth of muscle in each column along x within the rim (`RIM_MM`), 0 where it has none, is
    fitted by a line in y. Medial is -y for a left breast and +y for a right one.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
    frame : VoxelFrame
    nipple_mm : ndarray, (3,)

    Returns
    -------
    {"L", "R"} or None
        None where there is too little muscle, or no slope, to tell.
    """
    below = int(np.clip(np.ceil(frame.index(nipple_mm)[2]), 0, labels.shape[2]))
    depth = np.zeros((labels.shape[1], below), np.int32)
    tissue = np.zeros_like(depth)
    for layer in labels[:, :, :below]:
        depth += layer == TISSUES["muscle"].label
        tissue += layer != 0
    tissue_mm = tissue * frame.spacing_mm[0]
    counted = tissue_mm >= min(RIM_MM, 0.5 * float(tissue_mm.max(initial=0.0)))
    y = np.nonzero(counted)[0] * frame.spacing_mm[1]
    if not depth[counted].any() or np.ptp(y) == 0:
        return None
    thickness = depth[counted] * frame.spacing_mm[0]
    slope = float(np.polyfit(y - y.mean(), thickness, 1)[0])
    if abs(slope) * np.ptp(y) < MIN_WEDGE_MM:
        return None
    return "R" if slope > 0 else "L"
