"""How a file's axes lie in the patient, and turning them into the breast frame.

An orientation is three letters, one for each axis of the file, saying towards what the axis runs:
A anterior, P posterior, L the patient's left, R right, S superior, I inferior.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError

BREAST_AXES = "ALS"
"""Letters of the breast frame itself: +x anterior, +y patient's left, +z superior."""

AXES_EXPECTED = (
    f"three letters such as {BREAST_AXES}, the direction of each axis of the file: A or P, L or "
    f"R, S or I"
)
"""What to say of letters that are none."""

AXIS_OF_LETTER = {"A": (0, 1), "P": (0, -1), "L": (1, 1), "R": (1, -1), "S": (2, 1), "I": (2, -1)}
"""Breast-frame axis and sense of each letter."""

BREAST_FROM_LPS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Breast frame (+x anterior, +y patient's left, +z superior) from LPS patient axes."""

OBLIQUE_LIMIT_DEG = 1.0
"""Axes further than this from the breast frame's are refused rather than bent: 1 degree moves a
voxel 75 mm from the centre by 1.3 mm, the resolution at which compression is computed."""


def are_axes(text: str) -> bool:
    """Whether three letters name each direction of the patient once.

    Examples
    --------
    >>> are_axes("RPS"), are_axes("LRS")
    (True, False)
    """
    known = all(letter in AXIS_OF_LETTER for letter in text)
    return known and sorted(AXIS_OF_LETTER[letter][0] for letter in text) == [0, 1, 2]


def axes_of_direction(
    direction: NDArray[np.float64], path: Path, from_lps: NDArray[np.float64] = BREAST_FROM_LPS
) -> str:
    """Letters of a file's axes from their direction cosines.

    Parameters
    ----------
    direction : ndarray, (3, 3)
        Columns are the LPS directions of the file's axes.
    path : path
        For messages.
    from_lps : ndarray, (3, 3)
        Rotation from LPS to the phantom's frame.

    Raises
    ------
    InputError
        If an axis lies obliquely to the patient's.
    """
    turned = from_lps @ direction
    along = np.abs(turned)
    axes = np.argmax(np.where(np.isfinite(along), along, 0.0), axis=0)
    strongest = along[axes, np.arange(3)]
    # Not (>= limit), so that NaN is refused too.
    if sorted(axes) != [0, 1, 2] or not (strongest >= np.cos(np.deg2rad(OBLIQUE_LIMIT_DEG))).all():
        raise InputError(
            f"{path}: its axes (direction {direction.ravel().round(4).tolist()}) are oblique to "
            "the patient's, expected axes along left, posterior and superior (either way round); "
            "resample it first"
        )
    signs = np.sign(turned[axes, np.arange(3)])
    letter_of = {place: letter for letter, place in AXIS_OF_LETTER.items()}
    return "".join(letter_of[int(axis), int(sign)] for axis, sign in zip(axes, signs, strict=True))


def turn(
    values: NDArray[Any],
    voxel_mm: NDArray[np.float64],
    first_mm: NDArray[np.float64],
    axes: str,
    step: int = 1,
) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.float64]]:
    """Turn an array into the breast frame, by a view and not a copy.

    Parameters
    ----------
    values : ndarray, [i, j, k]
        Voxels along the file's own axes.
    voxel_mm : ndarray, (3,)
        Distance of the file's voxels along i, j, k, mm.
    first_mm : ndarray, (3,)
        Centre of the file's voxel [0, 0, 0], breast frame, mm.
    axes : str
        Letters of i, j, k.
    step : int
        `values` holds every n-th voxel of the file, the first at n // 2 (see `every_nth`).

    Returns
    -------
    values : ndarray, [x, y, z]
    voxel_mm : ndarray, (3,)
        Distance of these voxels along x, y, z, mm.
    origin_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0] of the turned array, breast frame, mm.
    """
    origin = np.array(first_mm, dtype=np.float64)
    places = [AXIS_OF_LETTER[letter] for letter in axes]
    for file_axis, (axis, sense) in enumerate(places):
        origin[axis] += sense * voxel_mm[file_axis] * (step // 2)
        if sense < 0:
            origin[axis] -= voxel_mm[file_axis] * step * (values.shape[file_axis] - 1)
            values = np.flip(values, file_axis)
    order = np.argsort([axis for axis, _ in places])
    return values.transpose(order), voxel_mm[order] * step, origin
