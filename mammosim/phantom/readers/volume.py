"""What every reader returns: voxels in the breast frame, values as they are in the file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError

BREAST_FROM_LPS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Breast frame (+x anterior, +y patient's left, +z superior) from LPS patient axes."""

OBLIQUE_LIMIT_DEG = 1.0
"""Axes further than this from the breast frame's are refused rather than bent: 1 degree moves a
voxel 75 mm from the centre by 1.3 mm, the resolution at which compression is computed."""


@dataclass(frozen=True, eq=False)
class Volume:
    """Voxels of a file.

    Parameters
    ----------
    values : ndarray, [x, y, z]
        Values as in the file, axes along the breast frame's; may be a strided view.
    voxel_mm : ndarray, (3,)
        Voxel size, mm.
    origin_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0], breast frame, mm.
    notes : tuple of str
        What was assumed or mended.
    """

    values: NDArray[Any]
    voxel_mm: NDArray[np.float64]
    origin_mm: NDArray[np.float64]
    notes: tuple[str, ...] = field(default=())


def checked_spacing(spacing_mm: ArrayLike, path: Path) -> NDArray[np.float64]:
    """(3,) voxel size, refused unless positive and finite."""
    spacing = np.asarray(spacing_mm, dtype=np.float64)
    if spacing.shape != (3,) or not (np.isfinite(spacing).all() and (spacing > 0).all()):
        raise InputError(
            f"{path}: voxel size is {np.asarray(spacing_mm).tolist()} mm, expected three positive "
            "numbers"
        )
    return spacing


def checked_origin(origin_mm: ArrayLike, path: Path) -> NDArray[np.float64]:
    """(3,) position of the first voxel, refused unless finite."""
    origin = np.asarray(origin_mm, dtype=np.float64)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise InputError(
            f"{path}: origin is {np.asarray(origin_mm).tolist()} mm, expected three finite numbers"
        )
    return origin


def from_patient_axes(
    values: NDArray[Any],
    spacing_mm: NDArray[np.float64],
    origin_lps_mm: NDArray[np.float64],
    direction: NDArray[np.float64],
    path: Path,
) -> Volume:
    """Turn an array with LPS patient axes into the breast frame, by a view and not a copy.

    Parameters
    ----------
    values : ndarray, [i, j, k]
        Voxels along the file's own axes.
    spacing_mm : ndarray, (3,)
        Distance of voxels along i, j, k, mm.
    origin_lps_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0] in LPS, mm.
    direction : ndarray, (3, 3)
        Columns are the LPS directions of i, j, k.
    path : path
        For messages.

    Raises
    ------
    InputError
        If an axis lies obliquely to the breast frame's.
    """
    turned = BREAST_FROM_LPS @ direction
    axes = np.abs(turned).argmax(axis=0)
    signs = np.sign(turned[axes, np.arange(3)])
    along = np.abs(turned[axes, np.arange(3)])
    # Not (>= limit), so that NaN is refused too.
    if sorted(axes) != [0, 1, 2] or not (along >= np.cos(np.deg2rad(OBLIQUE_LIMIT_DEG))).all():
        raise InputError(
            f"{path}: its axes (direction {direction.ravel().round(4).tolist()}) are oblique to "
            "the patient's, expected axes along left, posterior and superior (either way round); "
            "resample it first"
        )
    origin = BREAST_FROM_LPS @ origin_lps_mm
    order = np.argsort(axes)
    for file_axis in range(3):
        if signs[file_axis] < 0:
            step = spacing_mm[file_axis] * (values.shape[file_axis] - 1)
            origin[axes[file_axis]] -= step
            values = np.flip(values, file_axis)
    return Volume(values.transpose(order), spacing_mm[order], origin)
