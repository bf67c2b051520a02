"""The open end of a phantom: in an oblique view it leaves the picture, in others it stays off."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.breast import BreastPhantom

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

    There the arm is down and the fold of the axilla stays outside of the plates, which could not
    close on it.

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
        f"{kind} '{thing.name}' at {np.round(thing.position_mm, 1).tolist()} mm lies in the way to "
        "the axilla, which only oblique views hold; move it or leave the other views out"
        for kind, things in (("lesion", breast.lesions), ("landmark", breast.landmarks))
        for thing in things
        if (thing.position_mm - end.off_point_mm) @ end.off_normal > 0.0
    ]
    if problems:
        raise InputError(problems)
    y, z = (
        breast.origin_mm[axis] + breast.voxel_mm[axis] * np.arange(breast.labels.shape[axis])
        for axis in (1, 2)
    )
    across = y[:, None] * end.off_normal[1] + z * end.off_normal[2]
    kept = across <= end.off_point_mm @ end.off_normal
    rows, columns = np.flatnonzero(kept.any(axis=1)), np.flatnonzero(kept.any(axis=0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    labels = np.empty((breast.labels.shape[0], rows.size, columns.size), np.uint8)
    for layer, plane in zip(labels, breast.labels, strict=True):
        np.multiply(plane[box], kept[box], out=layer)
    origin = breast.origin_mm + breast.voxel_mm * [0, rows[0], columns[0]]
    return dataclasses.replace(breast, labels=labels, origin_mm=origin, open_end=None)
