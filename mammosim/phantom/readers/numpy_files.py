"""NPY and NPZ: arrays that are [x, y, z] in the breast frame already."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import Volume, checked_origin, checked_spacing

NPZ_KEYS = ("labels", "voxel_mm", "origin_mm")
"""Arrays an NPZ phantom holds."""


def read_npy(path: Path) -> Volume:
    """Read a bare array [x, y, z]; voxels are taken as 1 mm, which is noted.

    Raises
    ------
    InputError
        If the file is not a whole NPY file of a three-dimensional array.
    """
    try:
        values = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(f"{path}: not a whole NPY file ({_reason(error)})") from None
    note = f"{path.name} says no voxel size and position: 1 mm and the origin were taken"
    return Volume(_three_dimensional(values, path), np.ones(3), np.zeros(3), (note,))


def read_npz(path: Path) -> Volume:
    """Read an archive with `labels` [x, y, z], `voxel_mm` (3,) and `origin_mm` (3,).

    Raises
    ------
    InputError
        If the file is not a whole NPZ archive, or an array is missing or unusable.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            missing = [key for key in NPZ_KEYS if key not in archive]
            if missing:
                raise InputError(
                    f"{path}: holds {', '.join(archive.files) or 'nothing'}, expected arrays "
                    f"{', '.join(NPZ_KEYS)}"
                )
            values, voxel, origin = (archive[key] for key in NPZ_KEYS)
    except (ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f"{path}: not a whole NPZ archive ({_reason(error)})") from None
    if voxel.dtype.kind not in "iuf" or origin.dtype.kind not in "iuf":
        raise InputError(f"{path}: voxel_mm and origin_mm must be numbers")
    voxel = np.full(3, voxel) if voxel.ndim == 0 else voxel
    return Volume(
        _three_dimensional(values, path), checked_spacing(voxel, path), checked_origin(origin, path)
    )


def _three_dimensional(values: NDArray[Any], path: Path) -> NDArray[Any]:
    if values.ndim != 3:
        raise InputError(f"{path}: labels have shape {values.shape}, expected [x, y, z]")
    return values


def _reason(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
