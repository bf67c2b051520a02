"""Writers of labelled volumes, one function a format: file name's ending -> function.

All write an array [x, y, z] in the breast frame; what they write, `mammosim.phantom` reads back
voxel by voxel at the same place.
"""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.export.atomic import whole_file
from mammosim.export.metaimage_files import write_metaimage
from mammosim.export.volumes import write_labels, x_fastest
from mammosim.geometry import VoxelFrame
from mammosim.phantom import BREAST_AXES, TIFF_AXES_KEY

MAX_TIFF_BYTES = 1 << 32
"""A TIFF's offsets have 32 bits (TIFF 6.0); ImageJ does not read BigTIFF with its description."""

Writer = Callable[[NDArray[np.integer[Any]], VoxelFrame, Path], None]


def _write_itk(values: NDArray[np.integer[Any]], frame: VoxelFrame, path: Path) -> None:
    write_labels(values, frame, np.eye(3), path)


def _write_npz(values: NDArray[np.integer[Any]], frame: VoxelFrame, path: Path) -> None:
    with whole_file(path) as part:
        np.savez_compressed(
            part, labels=values, voxel_mm=frame.spacing_mm, origin_mm=frame.origin_mm
        )


def _write_tiff(values: NDArray[np.integer[Any]], frame: VoxelFrame, path: Path) -> None:
    """As ImageJ does: a page a layer of z, columns along x, rows along y, not compressed."""
    import tifffile

    if values.dtype not in (np.uint8, np.uint16) or values.nbytes >= MAX_TIFF_BYTES:
        raise InputError(
            f"{path}: a TIFF holds labels from 0 to 65535 in less than {MAX_TIFF_BYTES / 1e9:.1f} "
            f"GB, found {values.dtype} in {values.nbytes / 1e9:.1f} GB; use .nrrd"
        )
    width, height, depth = (float(step) for step in frame.spacing_mm)
    zero = -frame.origin_mm / frame.spacing_mm  # ImageJ keeps the index of the point 0
    described = {
        "axes": "ZYX", "spacing": depth, "unit": "mm", TIFF_AXES_KEY: BREAST_AXES,
        **{f"{axis}origin": float(index) for axis, index in zip("xyz", zero, strict=True)},
    }  # fmt: skip
    with whole_file(path) as part:
        tifffile.imwrite(
            part, x_fastest(values), imagej=True,
            resolution=(1.0 / width, 1.0 / height), metadata=described,
        )  # fmt: skip


WRITERS: dict[str, Writer] = {
    ".mhd": write_metaimage,
    ".mha": _write_itk,
    ".nrrd": _write_itk,
    ".nii": _write_itk,
    ".nii.gz": _write_itk,
    ".npz": _write_npz,
    ".tif": _write_tiff,
    ".tiff": _write_tiff,
}
"""Writer of each ending."""


def writer_of(path: str | PathLike[str]) -> Writer:
    """The writer for a file's name.

    Raises
    ------
    InputError
        If the ending is none of `WRITERS`.
    """
    name = Path(path).name.lower()
    matching = [suffix for suffix in WRITERS if name.endswith(suffix)]
    if not matching:
        raise InputError(
            f"{path}: cannot be written in this format, expected a name ending in "
            f"{', '.join(WRITERS)}"
        )
    return WRITERS[max(matching, key=len)]
