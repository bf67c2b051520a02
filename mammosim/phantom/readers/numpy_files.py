"""NPY, a bare array, and NPZ, which is [x, y, z] in the breast frame."""

from __future__ import annotations

import lzma
import struct
import tokenize
import warnings
import zipfile
import zlib
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import BREAST_AXES
from mammosim.phantom.readers.bounded import BoundedFile
from mammosim.phantom.readers.volume import (
    MAX_DEFLATE_RATIO,
    VoxelFile,
    Voxels,
    check_promise,
    checked_origin,
    checked_shape,
    checked_spacing,
    every_nth,
    reason_of,
)

NPZ_KEYS = ("labels", "voxel_mm", "origin_mm")
"""Arrays an NPZ phantom holds."""

HEADER_READERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""By version of the NPY format."""

DAMAGE = (
    ValueError, EOFError, OSError, OverflowError, NotImplementedError, RuntimeError, TypeError,
    LookupError, AttributeError, SyntaxError, MemoryError, tokenize.TokenError, struct.error,
    zipfile.BadZipFile, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""What NumPy and zipfile raise on damaged files: a header is a Python literal, which is parsed."""

MAX_SMALL_BYTES = 4096
"""Of the arrays beside the labels, which hold three numbers."""


class ArrayHeader(NamedTuple):
    """Header of an NPY file."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran: bool
    start: int


def open_npy(path: Path) -> VoxelFile:
    """Read the header of a bare array; it says neither directions, voxel size nor position.

    Raises
    ------
    InputError
        If the file is not a whole NPY file of a three-dimensional array.
    """
    with BoundedFile(path) as stream:
        header = _array_header(stream, path)
    shape = _three_dimensional(header.shape, path)
    on_disk = path.stat().st_size - header.start
    check_promise(_bytes(header), on_disk, 1, path)
    load = partial(_load_npy, path, header)
    return VoxelFile(path, shape, np.ones(3), header.dtype, load, says_voxel=False, files=(path,))


def _load_npy(path: Path, header: ArrayHeader, step: int) -> Voxels:
    order = "F" if header.fortran else "C"
    values = np.memmap(path, header.dtype, "r", header.start, header.shape, order)  # type: ignore[call-overload]
    return Voxels(every_nth(values, step))


def open_npz(path: Path) -> VoxelFile:
    """Read the headers of an archive with `labels` [x, y, z], `voxel_mm` and `origin_mm` (3,).

    Raises
    ------
    InputError
        If the file is not a whole NPZ archive, or an array is missing or unusable.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name.removesuffix(".npy") for name in archive.namelist()]
            if any(names.count(key) != 1 for key in NPZ_KEYS):
                raise InputError(
                    f"{path}: holds {', '.join(names) or 'nothing'}, expected arrays "
                    f"{', '.join(NPZ_KEYS)}"
                )
            voxel, origin = (_small_array(archive, key, path) for key in NPZ_KEYS[1:])
            member = archive.getinfo("labels.npy")
            with archive.open(member) as stream:
                header = _array_header(stream, path)
    except DAMAGE as error:
        raise InputError(f"{path}: not a whole NPZ archive ({reason_of(error)})") from None
    promised = header.start + _bytes(header)
    check_promise(promised, min(member.compress_size, path.stat().st_size), MAX_DEFLATE_RATIO, path)
    return VoxelFile(
        path, _three_dimensional(header.shape, path),
        checked_spacing(np.full(3, voxel) if voxel.ndim == 0 else voxel, path), header.dtype,
        partial(_load_npz, path, header), BREAST_AXES, "by the format", True,
        checked_origin(origin, path), whole_copies=1, files=(path,),
    )  # fmt: skip


def _small_array(archive: zipfile.ZipFile, key: str, path: Path) -> NDArray[Any]:
    if archive.getinfo(f"{key}.npy").file_size > MAX_SMALL_BYTES:
        raise InputError(f"{path}: {key} holds more than three numbers")
    with archive.open(f"{key}.npy") as stream:
        values: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    if values.dtype.kind not in "iuf":
        raise InputError(f"{path}: {key} holds {values.dtype}, but must be numbers")
    return values


def _load_npz(path: Path, header: ArrayHeader, step: int) -> Voxels:
    try:
        with zipfile.ZipFile(path) as archive, archive.open("labels.npy") as stream:
            values = np.lib.format.read_array(stream, allow_pickle=False)
    except DAMAGE as error:
        raise InputError(f"{path}: not a whole NPZ archive ({reason_of(error)})") from None
    return Voxels(every_nth(values.reshape(header.shape), step))


def _array_header(stream: BinaryIO | Any, path: Path) -> ArrayHeader:
    try:
        version = np.lib.format.read_magic(stream)
        if version not in HEADER_READERS:
            raise ValueError(f"its version is {version}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Python's parser, about odd literals
            shape, fortran, dtype = HEADER_READERS[version](stream)
    except DAMAGE as error:
        raise InputError(f"{path}: not a whole NPY file ({reason_of(error)})") from None
    if dtype.kind not in "iufb":
        raise InputError(f"{path}: holds {dtype} voxels, expected whole numbers")
    # NumPy takes true for 1 and any length; a memory map of the array would not.
    if not all(type(side) is int and 0 <= side < 2**63 for side in shape):
        raise InputError(f"{path}: labels have shape {shape!r:.100}, expected [x, y, z]")
    return ArrayHeader(shape, dtype, fortran, stream.tell())


def _bytes(header: ArrayHeader) -> int:
    count = header.dtype.itemsize
    for side in header.shape:
        count *= int(side)
    return count


def _three_dimensional(shape: tuple[int, ...], path: Path) -> tuple[int, int, int]:
    if len(shape) != 3:
        raise InputError(f"{path}: labels have shape {shape}, expected [x, y, z]")
    return checked_shape(shape, path)
