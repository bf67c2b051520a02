"""What SimpleITK reads for us: NRRD and NIfTI, once their own readers have checked the length."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.config import utf8_path
from mammosim.errors import InputError
from mammosim.phantom.label_table import find_label_table
from mammosim.phantom.readers.axes import BREAST_FROM_LPS, axes_of_direction
from mammosim.phantom.readers.volume import (
    VoxelFile,
    Voxels,
    checked_origin,
    checked_shape,
    checked_spacing,
    every_nth,
)

DTYPES = {
    "8-bit unsigned integer": "u1", "8-bit signed integer": "i1",
    "16-bit unsigned integer": "u2", "16-bit signed integer": "i2",
    "32-bit unsigned integer": "u4", "32-bit signed integer": "i4",
    "64-bit unsigned integer": "u8", "64-bit signed integer": "i8",
    "32-bit float": "f4", "64-bit float": "f8",
}  # fmt: skip
"""NumPy's name of each of SimpleITK's scalar types."""

COPIES = 2
"""Of all voxels, while an image becomes an array: ITK's and NumPy's."""


def open_itk(path: Path, says_axes: bool, files: tuple[Path, ...] = ()) -> VoxelFile:
    """Read the header of a file that SimpleITK knows.

    Parameters
    ----------
    path : path
        A file with patient axes (LPS inside SimpleITK, whatever the format's own).
    says_axes : bool
        Whether the header says how its axes lie in the patient.
    files : tuple of path
        The files it consists of.

    Raises
    ------
    InputError
        If the file cannot be read, is not one scalar volume, or its axes are oblique.
    """
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetFileName(utf8_path(path))
    with _plain_errors(path):
        reader.ReadImageInformation()
    size, pixel = reader.GetSize(), sitk.GetPixelIDValueAsString(reader.GetPixelID())
    if any(side != 1 for side in size[3:]) or len(size) < 3 or pixel not in DTYPES:
        raise InputError(
            f"{path}: found size {list(size)} of {pixel} with {reader.GetNumberOfComponents()} "
            "values per voxel, expected one volume of labels"
        )
    shape = checked_shape(size[:3], path)
    spacing = checked_spacing(reader.GetSpacing()[:3], path)
    from_lps = frame_from_lps(path)
    first = from_lps @ checked_origin(reader.GetOrigin()[:3], path)
    direction = np.array(reader.GetDirection()).reshape(len(size), len(size))[:3, :3]
    return VoxelFile(
        path, shape, spacing, np.dtype(DTYPES[pixel]), partial(_load, path, shape),
        axes_of_direction(direction, path, from_lps) if says_axes else None, "by its header", True,
        first if says_axes else None, whole_copies=COPIES, files=files or (path,),
    )  # fmt: skip


def frame_from_lps(path: Path) -> NDArray[np.float64]:
    """(3, 3) from LPS to a phantom's frame: the breast frame, or of a compressed breast that
    mammosim wrote the compression frame that its axes lie along."""
    table = find_label_table(path)
    return BREAST_FROM_LPS if table is None else table.rotation @ BREAST_FROM_LPS


def checked_before_loading(opened: VoxelFile, check: Callable[[], None]) -> VoxelFile:
    """The same file, whose voxels are read after a check that may raise."""

    def load(step: int) -> Voxels:
        check()
        return opened.load(step)

    return replace(opened, load=load)


def _load(path: Path, shape: tuple[int, int, int], step: int) -> Voxels:
    import SimpleITK as sitk

    with _plain_errors(path):
        image = sitk.ReadImage(utf8_path(path))
    values = sitk.GetArrayFromImage(image).reshape(shape[::-1])
    return Voxels(every_nth(values.transpose(2, 1, 0), step))


@contextmanager
def _plain_errors(path: Path) -> Iterator[None]:
    """ITK's errors as ours, its warnings not on the terminal."""
    import SimpleITK as sitk

    shown = sitk.ProcessObject.GetGlobalWarningDisplay()
    sitk.ProcessObject.GlobalWarningDisplayOff()
    try:
        yield
    except (RuntimeError, MemoryError) as error:
        reason = (str(error).strip() or "no memory").splitlines()[-1].strip()
        raise InputError(
            f"{path}: cannot be read, truncated or not its format ({reason})"
        ) from None
    finally:
        sitk.ProcessObject.SetGlobalWarningDisplay(shown)
