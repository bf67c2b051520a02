"""The open end of a phantom: in an oblique view it leaves the picture, in others it stays off."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mammosim._derived import Derived
from mammosim.errors import InputError
from mammosim.phantom._open_end_kernels import (
    CoarseDepth,
    copy_held,
    count_left_out,
    held_extent,
    muscle_fronts,
)
from mammosim.phantom.anatomy.muscle import COVER_MM
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


_held: Derived[BreastPhantom, BreastPhantom] = Derived()
"""Held parts of breasts: a run checks first that one can be compressed."""


def without_open_end(breast: BreastPhantom) -> BreastPhantom:
    """The breast without its axillary extension, as views other than oblique ones hold it.

    There the arm is down: the fold of the axilla stays outside of the plates, which could not close
    on it, and the skin of the breast's upper outer part goes on to the chest. Fat lies under that
    skin, over what is left of the muscle. The muscle is not drawn forward there: it stands off the
    chest wall by only `OpenEnd.standing` of its distance in oblique views.

    Raises
    ------
    InputError
        If a lesion or landmark lies in what is left out.

    Notes
    -----
    A copy of the labels is made, of the box around what remains; it is kept as long as the breast
    is.
    """
    end = breast.open_end
    if end is None:
        return breast
    return _held.of(breast, lambda: _without_axilla(breast, end))


def _without_axilla(breast: BreastPhantom, end: OpenEnd) -> BreastPhantom:
    problems = [
        f"{kind} '{thing.name}' at {np.round(thing.position_mm, 1).tolist()} mm lies towards the "
        f"axilla, which only oblique views show; move it or remove the other views"
        for kind, things in (("lesion", breast.lesions), ("landmark", breast.landmarks))
        for thing in things
        if float(end.held_depth_at(thing.position_mm[None])[0]) < end.skin_mm
    ]
    if problems:
        raise InputError(problems)
    held, first = _held_labels(breast, end)
    origin = breast.origin_mm + breast.voxel_mm * [0, *first]
    return dataclasses.replace(
        breast, labels=held, origin_mm=origin, open_end=None, muscle_standing=end.standing
    )


def _held_labels(
    breast: BreastPhantom, end: OpenEnd
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Labels with air, skin and muscle where they are without the axilla, in the box around them.

    Also where the box begins along y and z.
    """
    labels = breast.labels
    deepest = max(end.skin_mm, COVER_MM) + 2.0 * end.held_frame.spacing_mm[0]
    changed = np.argwhere(end.held_depth_mm < deepest)
    box = np.zeros((3, 2), np.int64)
    if len(changed):
        # Only the box in which the depth is small is looked at.
        ends = np.array([changed.min(axis=0) - 1, changed.max(axis=0) + 1])
        index = np.rint(breast.frame.index(end.held_frame.position_mm(ends))).astype(np.int64)
        box = np.clip(index, 0, labels.shape).T
    depth = _coarse_depth(breast, end)
    names = [TISSUES[name].label for name in ("skin", "nipple", "muscle", "adipose")]
    voxel_mm, of_names = np.float32(breast.voxel_mm.min()), np.array(names, np.uint8)
    rows = np.zeros((labels.shape[0], labels.shape[1]), bool)
    columns = np.zeros((labels.shape[0], labels.shape[2]), bool)
    held_extent(depth, box, voxel_mm, of_names[1], labels, rows, columns)
    used = [np.flatnonzero(found.any(axis=0)) for found in (rows, columns)]
    first = np.array([max(int(index[0]) - 1, 0) for index in used])
    sizes = [
        min(int(index[-1]) + 2, size) - low
        for index, size, low in zip(used, labels.shape[1:], first, strict=True)
    ]
    held = np.empty((labels.shape[0], *sizes), np.uint8)
    fronts = np.zeros(labels.shape[1:], np.int32)
    muscle_fronts(labels, of_names[2], fronts)
    copy_held(
        depth, box, voxel_mm, np.float32(COVER_MM), np.float32(end.standing), fronts, of_names,
        labels, first, held,
    )  # fmt: skip
    return held, first


def _coarse_depth(breast: BreastPhantom, end: OpenEnd) -> CoarseDepth:
    """Depth in views without the axilla, and where in its grid the voxels lie."""
    (cells_x, part_x), (cells_y, part_y), (cells_z, part_z) = (
        _places(breast, end, axis, np.arange(count))
        for axis, count in enumerate(breast.labels.shape)
    )
    return CoarseDepth(
        end.held_depth_mm, np.float32(end.skin_mm), cells_x, part_x, cells_y, part_y, cells_z,
        part_z,
    )  # fmt: skip


def abdominal_counts(breast: BreastPhantom) -> NDArray[np.int64]:
    """Number of voxels of each label below the inframammary fold, [256].

    They are what views other than oblique ones leave out on the side away from the open end.

    Parameters
    ----------
    breast : BreastPhantom
    """
    end = breast.open_end
    if end is None:
        return np.zeros(256, np.int64)
    return _abdominal.of(breast, lambda: _count_abdominal(breast, end))


_abdominal: Derived[BreastPhantom, NDArray[np.int64]] = Derived()
"""Counts of breasts, whose volume is asked for several times in a run."""


def _count_abdominal(breast: BreastPhantom, end: OpenEnd) -> NDArray[np.int64]:
    y, z = (breast.frame.axis_mm(axis) - breast.nipple_mm[axis] for axis in (1, 2))
    counts = np.zeros((breast.labels.shape[0], 256), np.int64)
    depth = _coarse_depth(breast, end)
    count_left_out(depth, end.normal[1] * y, end.normal[2] * z, breast.labels, counts)
    return counts.sum(axis=0)


def _places(
    breast: BreastPhantom, end: OpenEnd, axis: int, index: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Cell of the coarse grid and place in it of voxels along an axis."""
    at = breast.origin_mm[axis] + breast.voxel_mm[axis] * index
    cells = (at - end.held_frame.origin_mm[axis]) / end.held_frame.spacing_mm[axis]
    cells = np.clip(cells, 0.0, end.held_depth_mm.shape[axis] - 1.001)
    low = cells.astype(np.int64)
    return low, (cells - low).astype(np.float32)
