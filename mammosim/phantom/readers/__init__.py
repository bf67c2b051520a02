"""Readers of voxel files, one file a format: file name's ending -> function.

A reader takes the header alone and holds it against the file's length (`VoxelFile`); the voxels
are read when somebody has made sure that they fit into memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mammosim.errors import InputError
from mammosim.phantom.label_table import LABELS_FILE, find_label_table
from mammosim.phantom.readers.axes import BREAST_AXES
from mammosim.phantom.readers.dicom_series import open_dicom_series
from mammosim.phantom.readers.metaimage import open_metaimage
from mammosim.phantom.readers.nifti import open_nifti
from mammosim.phantom.readers.nrrd import open_nrrd
from mammosim.phantom.readers.numpy_files import open_npy, open_npz
from mammosim.phantom.readers.openvct import open_openvct
from mammosim.phantom.readers.thesis import open_thesis
from mammosim.phantom.readers.tiff import TIFF_AXES_KEY, open_tiff
from mammosim.phantom.readers.uwcem import open_uwcem
from mammosim.phantom.readers.volume import Volume, VoxelFile, Voxels

READERS: dict[str, Callable[[Path], VoxelFile]] = {
    ".mhd": open_metaimage,
    ".mha": open_metaimage,
    ".nrrd": open_nrrd,
    ".nhdr": open_nrrd,
    ".nii": open_nifti,
    ".nii.gz": open_nifti,
    ".npy": open_npy,
    ".npz": open_npz,
    ".tif": open_tiff,
    ".tiff": open_tiff,
    ".vctx": open_openvct,
    ".bin": open_thesis,
    ".txt": open_uwcem,
}
"""What reads the header of each known ending; a folder is a DICOM series."""


def open_voxels(path: str | Path) -> VoxelFile:
    """Read the header of any known voxel file, and no voxel.

    Parameters
    ----------
    path : path
        A file, whose ending decides which reader is used, or the folder of a DICOM series.

    Raises
    ------
    InputError
        If the ending is not known or there is no such file, or the reader's own errors.
    """
    path = Path(path)
    try:
        opened = _reader_of(path)(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    table = find_label_table(opened.path)
    if table is None:
        return opened
    return replace(
        opened, table=table, laterality=table.laterality, label_map=table.tissue_of_value,
        files=(*opened.files, path.parent / LABELS_FILE),
    )  # fmt: skip


def _reader_of(path: Path) -> Callable[[Path], VoxelFile]:
    if path.is_dir():
        return open_dicom_series
    name = path.name.lower()
    if name.endswith(".dcm") and path.is_file():
        raise InputError(
            f"{path}: is one DICOM file, expected the folder of a series; give {path.parent}"
        )
    matching = [suffix for suffix in READERS if name.endswith(suffix)]
    if not matching:
        raise InputError(
            f"{path}: unknown format, expected a file ending in {', '.join(READERS)}, or a folder "
            "with a DICOM series"
        )
    if not path.is_file():
        what = "is a pipe, device or socket, expected a file" if path.exists() else "no such file"
        raise InputError(f"{path}: {what}")
    return READERS[max(matching, key=len)]


__all__ = [
    "BREAST_AXES",
    "READERS",
    "TIFF_AXES_KEY",
    "Volume",
    "VoxelFile",
    "Voxels",
    "open_voxels",
]
