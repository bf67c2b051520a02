"""MetaImage, in one file (MHA) or with its voxels in another (MHD), read tolerantly.

Files of FDA's VICTRE_PIPELINE say `CompressedData = False` though the voxels are gzipped, give a
key twice, name `x.raw` where `x.raw.gz` lies, and leave the orientation as `???`. What the bytes
are is therefore seen from the bytes, and what the header got wrong is noted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import BREAST_AXES, axes_of_direction
from mammosim.phantom.readers.inflate import (
    GZIP_MAGIC,
    ZLIB_FIRST_BYTE,
    inflated,
    read_layers,
)
from mammosim.phantom.readers.itk import frame_from_lps
from mammosim.phantom.readers.volume import (
    MAX_DEFLATE_RATIO,
    VoxelFile,
    Voxels,
    check_promise,
    checked_origin,
    checked_spacing,
    every_nth,
)

ELEMENT_TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2",
    "MET_UINT": "u4", "MET_INT": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip
"""NumPy's name of each MetaImage element type."""

MAX_HEADER_BYTES = 1 << 20
"""A header is a page of text: more than this is another kind of file."""

NO_ORIENTATION = {"", "???"}

BY_CUSTOM = "by VICTRE's convention, since its header gives no orientation"


@dataclass(frozen=True)
class VoxelBytes:
    """Where the voxels lie, and how."""

    path: Path
    start: int
    length: int
    compressed: bool


def open_metaimage(path: Path) -> VoxelFile:
    """Read the header of an MHA, or of an MHD and its voxel file.

    Without orientation (`???`, as VICTRE writes) axes are the breast frame's already and
    positions are Offset + index x ElementSpacing. With one (as ITK writes) `TransformMatrix` and
    `Offset` are in LPS.

    Raises
    ------
    InputError
        If the header is not one, something is missing in it, or the voxels do not match it.
    """
    header, header_bytes = _read_header(path)
    shape = _shape(header, path)
    spacing = checked_spacing(_numbers(header, ("ElementSpacing", "ElementSize"), path), path)
    origin = checked_origin(
        _numbers(header, ("Offset", "Position", "UncompressedTarget"), path, 0.0), path
    )
    dtype = _dtype(header, path)
    promised = shape[0] * shape[1] * shape[2] * dtype.itemsize
    voxels, notes = _find_voxels(header, header_bytes, promised, path)
    _check_length(voxels, promised, path)
    if voxels.compressed and header.get("CompressedData", "False").lower() != "true":
        notes.append(
            f"{path.name} says CompressedData = False, but {voxels.path.name} is compressed"
        )
    matrix = _matrix(header, path)
    if header.get("AnatomicalOrientation", "") in NO_ORIENTATION:
        if not np.allclose(matrix, np.eye(3)):
            notes.append(f"{path.name} rotates its axes but gives no orientation: not rotated")
        axes, said_by = BREAST_AXES, BY_CUSTOM
    else:
        from_lps = frame_from_lps(path)
        axes, said_by = axes_of_direction(matrix.T, path, from_lps), "by its header"
        origin = from_lps @ origin
    return VoxelFile(
        path, shape, spacing, dtype, partial(_load, voxels, shape, dtype, path.name), axes, said_by,
        first_mm=origin, notes=tuple(notes), files=tuple(dict.fromkeys((path, voxels.path))),
    )  # fmt: skip


def _read_header(path: Path) -> tuple[dict[str, str], int]:
    """Keys and values, of a key given twice the last; and the header's length in bytes.

    `ElementDataFile` ends a header (MetaIO's documentation): voxels may follow in the same file.
    """
    with path.open("rb") as stream:
        content = stream.read(MAX_HEADER_BYTES)
    header: dict[str, str] = {}
    read = 0
    for line in content.splitlines(keepends=True):
        read += len(line)
        try:
            key, equals, value = line.decode("utf-8").partition("=")
        except UnicodeDecodeError:
            break
        if equals:
            header[key.strip()] = value.strip()
        if key.strip() == "ElementDataFile":
            break
    missing = [key for key in ("DimSize", "ElementType", "ElementDataFile") if key not in header]
    if missing:
        raise InputError(f"{path}: not a MetaImage header, {', '.join(missing)} missing")
    return header, read


def _shape(header: Mapping[str, str], path: Path) -> tuple[int, int, int]:
    words = header["DimSize"].split()
    if len(words) != 3 or not all(word.isascii() and word.isdigit() for word in words):
        raise InputError(f"{path}: DimSize is '{header['DimSize']}', expected three whole numbers")
    nx, ny, nz = (int(word[:18]) for word in words)
    if min(nx, ny, nz) == 0:
        raise InputError(f"{path}: DimSize is '{header['DimSize']}', expected sides of 1 or more")
    return nx, ny, nz


def _numbers(
    header: Mapping[str, str], keys: tuple[str, ...], path: Path, default: float | None = None
) -> list[float]:
    key = next((key for key in keys if key in header), None)
    if key is None:
        if default is None:
            raise InputError(f"{path}: {keys[0]} is missing")
        return [default] * 3
    try:
        return [float(word) for word in header[key].split()]
    except ValueError:
        raise InputError(f"{path}: {key} is '{header[key]}', expected numbers") from None


def _matrix(header: Mapping[str, str], path: Path) -> NDArray[np.float64]:
    key = next((k for k in ("TransformMatrix", "Rotation", "Orientation") if k in header), None)
    if key is None:
        return np.eye(3)
    numbers = _numbers(header, (key,), path)
    if len(numbers) != 9:
        raise InputError(f"{path}: {key} is '{header[key]}', expected nine numbers")
    return np.array(numbers).reshape(3, 3)


def _dtype(header: Mapping[str, str], path: Path) -> np.dtype[Any]:
    name = header["ElementType"]
    if name not in ELEMENT_TYPES:
        raise InputError(
            f"{path}: ElementType is '{name}', expected one of {', '.join(ELEMENT_TYPES)}"
        )
    if header.get("ElementNumberOfChannels", "1") != "1":
        raise InputError(f"{path}: more than one value per voxel, expected a volume of labels")
    if header.get("BinaryData", "True").lower() != "true":
        raise InputError(f"{path}: BinaryData = {header['BinaryData']}, expected voxels in binary")
    big = header.get("BinaryDataByteOrderMSB", header.get("ElementByteOrderMSB", "False"))
    return np.dtype((">" if big.lower() == "true" else "<") + ELEMENT_TYPES[name])


def _find_voxels(
    header: Mapping[str, str], header_bytes: int, promised: int, path: Path
) -> tuple[VoxelBytes, list[str]]:
    """Where the voxels are; whether they are compressed is seen from their first bytes."""
    name, notes = header["ElementDataFile"], []
    if name.upper() == "LOCAL":
        data_path, start = path, header_bytes
    else:
        data_path, start = _data_path(name, path), 0
        if data_path.name != name:
            notes.append(f"{path.name} names {name}; {data_path.name} was read")
    start += _skipped_bytes(header, data_path.stat().st_size - start, promised, path)
    length = max(data_path.stat().st_size - start, 0)
    with data_path.open("rb") as stream:
        stream.seek(start)
        magic = stream.read(2)
    # A header may lie either way; voxels of exactly the promised length may begin with any byte.
    says = header.get("CompressedData", "False").lower() == "true"
    packed = magic == GZIP_MAGIC or magic[:1] == ZLIB_FIRST_BYTE
    return VoxelBytes(data_path, start, length, packed and (says or length != promised)), notes


def _skipped_bytes(header: Mapping[str, str], held: int, promised: int, path: Path) -> int:
    """HeaderSize: bytes of another header before the voxels; -1 puts them at the file's end."""
    text = header.get("HeaderSize", "0")
    digits = text.removeprefix("-")
    if not (digits.isascii() and digits.isdigit()) or len(digits) > 18 or int(text) < -1:
        raise InputError(f"{path}: HeaderSize is '{text}', expected a whole number from -1")
    return max(held - promised, 0) if text == "-1" else int(text)


def _data_path(name: str, path: Path) -> Path:
    if Path(name).name != name or "\\" in name or "\0" in name:
        # A file from elsewhere must not make us open anything outside its own folder.
        raise InputError(f"{path}: ElementDataFile is '{name}', expected a file beside the header")
    named = path.parent / name
    other = named.with_suffix("") if named.suffix == ".gz" else Path(f"{named}.gz")
    if named.is_file():
        return named
    if other.is_file():
        return other
    raise InputError(f"{path}: its voxel file {named} does not exist, nor does {other.name}")


def _check_length(voxels: VoxelBytes, promised: int, path: Path) -> None:
    if voxels.compressed:
        check_promise(promised, voxels.length, MAX_DEFLATE_RATIO, voxels.path)
    elif voxels.length != promised:
        raise InputError(
            f"{voxels.path}: holds {voxels.length} bytes of voxels, expected {promised} from "
            f"{path.name}"
        )


def _load(
    voxels: VoxelBytes, shape: tuple[int, int, int], dtype: np.dtype[Any], header: str, step: int
) -> Voxels:
    if not voxels.compressed:
        flat = np.memmap(voxels.path, dtype, "r", voxels.start, shape[::-1])
        return Voxels(every_nth(flat.transpose(2, 1, 0), step))
    with voxels.path.open("rb") as stream:
        stream.seek(voxels.start)
        return read_layers(inflated(stream), shape, dtype, step, voxels.path, header)
