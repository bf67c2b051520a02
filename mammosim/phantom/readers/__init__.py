"""Readers of voxel files, one file a format: file name's ending -> function."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mammosim.errors import InputError
from mammosim.phantom.readers.itk import read_itk
from mammosim.phantom.readers.metaimage import read_metaimage
from mammosim.phantom.readers.nifti import read_nifti
from mammosim.phantom.readers.numpy_files import read_npy, read_npz
from mammosim.phantom.readers.thesis import read_thesis
from mammosim.phantom.readers.volume import Volume

READERS: dict[str, Callable[[Path], Volume]] = {
    ".mhd": read_metaimage,
    ".mha": read_itk,
    ".nrrd": read_itk,
    ".nhdr": read_itk,
    ".nii": read_nifti,
    ".nii.gz": read_nifti,
    ".npy": read_npy,
    ".npz": read_npz,
    ".bin": read_thesis,
}
"""Reader of each known ending."""


def read_volume(path: str | Path) -> Volume:
    """Read any known voxel file.

    Parameters
    ----------
    path : path
        The file; its ending decides which reader is used.

    Raises
    ------
    InputError
        If the ending is not known or there is no such file, or the reader's own errors.
    """
    path = Path(path)
    name = path.name.lower()
    matching = [suffix for suffix in READERS if name.endswith(suffix)]
    if not matching:
        raise InputError(f"{path}: unknown format, expected a file ending in {', '.join(READERS)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    return READERS[max(matching, key=len)](path)


__all__ = ["READERS", "Volume", "read_volume"]
