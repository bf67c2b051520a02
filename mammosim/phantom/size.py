"""How large a phantom will be, from its header or the generator's settings alone."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from mammosim.errors import InputError
from mammosim.phantom.readers import READERS
from mammosim.phantom.readers.thesis import VOXEL_MM, cube_side
from mammosim.phantom.settings import PhantomSettings

LARGEST_DRAWN_ML = 900.0
"""Largest volume that the generator draws by itself, mL."""

BOX_PART = 3.0
"""Of the breast's volume: the box around it with its muscle; 2.4 to 2.9 was seen."""


def expected_voxels(settings: PhantomSettings) -> tuple[int, float]:
    """Number of voxels and volume of one, mm3, without reading or generating any.

    Parameters
    ----------
    settings : PhantomSettings
        With an absolute path, where it names a file.

    Raises
    ------
    InputError
        If the file is missing, of an unknown format, or has no readable header.
    """
    if settings.generate is not None:
        volume_mm3 = 1e3 * (settings.generate.volume_ml or LARGEST_DRAWN_ML)
        voxel_mm3 = settings.generate.voxel_mm**3
        return int(BOX_PART * volume_mm3 / voxel_mm3), voxel_mm3
    path = Path(str(settings.file))
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if not path.name.lower().endswith(tuple(READERS)):
        raise InputError(f"{path}: unknown format, expected a file ending in {', '.join(READERS)}")
    try:
        shape, spacing = _numpy_header(path) if path.suffix in (".npy", ".npz") else _header(path)
    except (OSError, ValueError, KeyError, RuntimeError, zipfile.BadZipFile):
        raise InputError(f"{path}: its header cannot be read") from None
    return int(np.prod(shape, dtype=np.int64)), float(np.prod(spacing))


def _header(path: Path) -> tuple[tuple[int, ...], tuple[float, ...]]:
    if path.suffix.lower() == ".bin":
        return (cube_side(path),) * 3, (VOXEL_MM,) * 3
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    return reader.GetSize(), reader.GetSpacing()


def _numpy_header(path: Path) -> tuple[tuple[int, ...], tuple[float, ...]]:
    if path.suffix == ".npy":
        return np.load(path, mmap_mode="r", allow_pickle=False).shape, (1.0,)
    with np.load(path, allow_pickle=False) as archive:
        spacing = tuple(float(step) for step in archive["voxel_mm"])
    with zipfile.ZipFile(path) as archive, archive.open("labels.npy") as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            read = np.lib.format.read_array_header_2_0
        return read(stream)[0], spacing
