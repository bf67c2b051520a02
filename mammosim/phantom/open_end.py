"""The open end of a phantom: in an oblique view it leaves the picture, in others it stays off."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.breast import BreastPhantom, OpenEnd
from mammosim.tissues import TISSUES

SEEN_ALONG = 0.9
"""Least cosine between the way out of an open end and the picture's long side for the picture to
end there: 25 degrees either way of the usual oblique view."""


def leaves_picture(breast: BreastPhantom, long_side: NDArray[np.float64]) -> bool:
    """Whether an open end leaves a picture at the end of its long side.

    Parameters
    ----------
    breast : BreastPhantom
    long_side : ndarray, (3,)
        Unit vector along the chest-wall edge of the picture, breast frame.
    """
    end = breast.open_end
    return end is not None and abs(float(end.normal @ long_side)) >= SEEN_ALONG


def as_held(breast: BreastPhantom, long_side: NDArray[np.float64]) -> BreastPhantom:
    """The part of a breast that lies on the support in a view.

    Parameters
    ----------
    breast : BreastPhantom
    long_side : ndarray, (3,)
        Unit vector along the chest-wall edge of the picture, breast frame.

    Raises
    ------
    InputError
        If a lesion or landmark lies in what is left out.
    """
    return breast if leaves_picture(breast, long_side) else without_open_end(breast)


def without_open_end(breast: BreastPhantom) -> BreastPhantom:
    """The breast without its way to the axilla, as other views than oblique ones hold it.

    There the arm is down: the fold of the axilla stays outside of the plates, which could not close
    on it, and the skin of the breast's upper outer part goes on to the chest.

    Raises
    ------
    InputError
        If a lesion or landmark lies in what is left out.

    Notes
    -----
    A copy of the labels is made, of the box around what remains.
    """
    end = breast.open_end
    if end is None:
        return breast
    problems = [
        f"{kind} '{thing.name}' at {np.round(thing.position_mm, 1).tolist()} mm lies towards the "
        f"axilla, which only oblique views show; move it or remove the other views"
        for kind, things in (("lesion", breast.lesions), ("landmark", breast.landmarks))
        for thing in things
        if float(end.held_depth_at(thing.position_mm[None])[0]) < end.skin_mm
    ]
    if problems:
        raise InputError(problems)
    labels = _held_labels(breast, end)
    rows, columns = (np.flatnonzero(labels.any(axis=axes)) for axes in ((0, 2), (0, 1)))
    low = [max(int(found[0]) - 1, 0) for found in (rows, columns)]
    box = np.s_[:, low[0] : rows[-1] + 2, low[1] : columns[-1] + 2]
    origin = breast.origin_mm + breast.voxel_mm * [0, *low]
    held = np.ascontiguousarray(labels[box])
    return dataclasses.replace(breast, labels=held, origin_mm=origin, open_end=None)


def _held_labels(breast: BreastPhantom, end: OpenEnd) -> NDArray[np.uint8]:
    """Labels with air and skin where they are once the axilla is left out."""
    labels = breast.labels.copy()
    skin, nipple = TISSUES["skin"].label, TISSUES["nipple"].label
    changed = np.argwhere(end.held_depth_mm < end.skin_mm + 2.0 * end.held_frame.spacing_mm[0])
    if not len(changed):
        return labels
    # Only the box in which the depth is small is looked at.
    ends = end.held_frame.position_mm(np.array([changed.min(axis=0) - 1, changed.max(axis=0) + 1]))
    index = np.clip(np.rint(breast.frame.index(ends)).astype(int), 0, labels.shape)
    box = tuple(slice(first, last) for first, last in index.T)
    places = [
        _places(breast, end, axis, np.arange(part.start, part.stop))
        for axis, part in enumerate(box)
    ]
    voxel = np.float32(breast.voxel_mm.min())
    field = end.held_depth_mm
    for i, (low, part) in zip(
        range(box[0].start, box[0].stop), zip(*places[0], strict=True), strict=True
    ):
        plane = field[low] + np.float32(part) * (field[low + 1] - field[low])
        depth = _interpolated(_interpolated(plane, *places[1]).T, *places[2]).T
        # Half a voxel to either side, column by column: the surface draws no contour lines.
        rows = np.arange(box[1].start, box[1].stop)
        turn = 0.7548776662466927 * i + 0.5698402909980532 * rows
        depth += voxel * (turn - np.floor(turn) - 0.5).astype(np.float32)[:, None]
        layer = labels[i, box[1], box[2]]
        tissue = (layer != 0) & (layer != nipple)
        layer[tissue & (depth < end.skin_mm)] = skin
        layer[tissue & (depth < 0.0)] = 0
    return labels


def _places(
    breast: BreastPhantom, end: OpenEnd, axis: int, index: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Cell of the coarse grid and place in it of voxels along an axis."""
    at = breast.origin_mm[axis] + breast.voxel_mm[axis] * index
    cells = (at - end.held_frame.origin_mm[axis]) / end.held_frame.spacing_mm[axis]
    cells = np.clip(cells, 0.0, end.held_depth_mm.shape[axis] - 1.001)
    low = cells.astype(np.int64)
    return low, (cells - low).astype(np.float32)


def _interpolated(
    values: NDArray[np.float32], low: NDArray[np.int64], part: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Linear interpolation along the first axis."""
    first = values[low]
    between: NDArray[np.float32] = first + part[:, None] * (values[low + 1] - first)
    return between
