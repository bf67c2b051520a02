"""MetaImage with its voxels in a file of their own (MHD), read tolerantly.

Files of FDA's VICTRE_PIPELINE say `CompressedData = False` though the voxels are gzipped, give a
key twice, name `x.raw` where `x.raw.gz` lies, and leave the orientation as `???`. What the bytes
are is therefore seen from the bytes, and what the header got wrong is noted.
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import (
    Volume,
    checked_origin,
    checked_spacing,
    from_patient_axes,
)

ELEMENT_TYPES = {
    "MET_UCHAR": "u1", "MET_CHAR": "i1", "MET_USHORT": "u2", "MET_SHORT": "i2",
    "MET_UINT": "u4", "MET_INT": "i4", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip
"""NumPy's name of each MetaImage element type."""

GZIP_MAGIC, ZLIB_FIRST_BYTE = b"\x1f\x8b", b"\x78"

MAX_HEADER_BYTES = 1 << 20
"""A header is a page of text: more than this is another kind of file."""

MAX_DEFLATE_RATIO = 1032
"""Deflate's greatest compression (zlib technical details): a header that promises more lies."""

NO_ORIENTATION = {"", "???"}


def read_metaimage(path: Path) -> Volume:
    """Read an MHD header and its voxel file.

    Without orientation (`???`, as VICTRE writes) axes are the breast frame's already and
    positions are Offset + index x ElementSpacing. With one (as ITK writes) `TransformMatrix` and
    `Offset` are in LPS.

    Raises
    ------
    InputError
        If the header is not one, something is missing in it, or the voxels do not match it.
    """
    header = _read_header(path)
    shape = _shape(header, path)
    spacing = checked_spacing(_numbers(header, ("ElementSpacing", "ElementSize"), path), path)
    origin = checked_origin(_numbers(header, ("Offset", "Position", "Origin"), path, 0.0), path)
    dtype = _dtype(header, path)
    data_path, notes = _data_path(header, path)
    flat, compressed = _read_voxels(data_path, dtype, int(np.prod(shape, dtype=object)), path)
    if compressed and header.get("CompressedData", "False").lower() != "true":
        notes.append(f"{path.name} says CompressedData = False, but {data_path.name} is compressed")
    values = flat.reshape(shape[::-1]).transpose(2, 1, 0)
    if header.get("AnatomicalOrientation", "") in NO_ORIENTATION:
        matrix = _matrix(header, path)
        if not np.allclose(matrix, np.eye(3)):
            notes.append(f"{path.name} turns its axes but says no orientation: not turned")
        return Volume(values, spacing, origin, tuple(notes))
    turned = from_patient_axes(values, spacing, origin, _matrix(header, path).T, path)
    return Volume(turned.values, turned.voxel_mm, turned.origin_mm, tuple(notes))


def _read_header(path: Path) -> dict[str, str]:
    """Keys and values; of a key given twice the last counts."""
    with path.open("rb") as stream:
        content = stream.read(MAX_HEADER_BYTES + 1)
    try:
        text = content.decode("utf-8") if len(content) <= MAX_HEADER_BYTES else ""
    except UnicodeDecodeError:
        text = ""
    pairs = (line.split("=", 1) for line in text.splitlines() if "=" in line)
    header = {key.strip(): value.strip() for key, value in pairs}
    missing = [key for key in ("DimSize", "ElementType", "ElementDataFile") if key not in header]
    if missing:
        raise InputError(f"{path}: not a MetaImage header, {', '.join(missing)} missing")
    return header


def _shape(header: dict[str, str], path: Path) -> tuple[int, ...]:
    words = header["DimSize"].split()
    if len(words) != 3 or not all(word.isascii() and word.isdigit() for word in words):
        raise InputError(f"{path}: DimSize is '{header['DimSize']}', expected three whole numbers")
    shape = tuple(int(word) for word in words)
    if min(shape) == 0:
        raise InputError(f"{path}: DimSize is '{header['DimSize']}', expected sides of 1 or more")
    return shape


def _numbers(
    header: dict[str, str], keys: tuple[str, ...], path: Path, default: float | None = None
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


def _matrix(header: dict[str, str], path: Path) -> NDArray[np.float64]:
    if "TransformMatrix" not in header:
        return np.eye(3)
    numbers = _numbers(header, ("TransformMatrix",), path)
    if len(numbers) != 9:
        raise InputError(
            f"{path}: TransformMatrix is '{header['TransformMatrix']}', expected nine numbers"
        )
    return np.array(numbers).reshape(3, 3)


def _dtype(header: dict[str, str], path: Path) -> np.dtype[Any]:
    name = header["ElementType"]
    if name not in ELEMENT_TYPES:
        raise InputError(
            f"{path}: ElementType is '{name}', expected one of {', '.join(ELEMENT_TYPES)}"
        )
    if header.get("ElementNumberOfChannels", "1") != "1":
        raise InputError(f"{path}: more than one value a voxel, expected a volume of labels")
    big = header.get("BinaryDataByteOrderMSB", header.get("ElementByteOrderMSB", "False"))
    return np.dtype((">" if big.lower() == "true" else "<") + ELEMENT_TYPES[name])


def _data_path(header: dict[str, str], path: Path) -> tuple[Path, list[str]]:
    name = header["ElementDataFile"]
    if Path(name).name != name:
        # A file from elsewhere must not make us open anything outside its own folder.
        raise InputError(f"{path}: ElementDataFile is '{name}', expected a file beside the header")
    named = path.parent / name
    other = named.with_suffix("") if named.suffix == ".gz" else Path(f"{named}.gz")
    if named.is_file():
        return named, []
    if other.is_file():
        return other, [f"{path.name} names {name}; {other.name} was read"]
    raise InputError(f"{path}: its voxel file {named} does not exist, nor does {other.name}")


def _read_voxels(
    data_path: Path, dtype: np.dtype[Any], count: int, path: Path
) -> tuple[NDArray[Any], bool]:
    """Exactly `count` elements, and whether they were compressed."""
    expected = count * dtype.itemsize
    on_disk = data_path.stat().st_size
    with data_path.open("rb") as stream:
        magic = stream.read(2)
        stream.seek(0)
        if magic == GZIP_MAGIC:
            with gzip.GzipFile(fileobj=stream) as unzipped:
                found, raw = _inflate(unzipped, expected, on_disk, data_path)
        elif on_disk != expected and magic[:1] == ZLIB_FIRST_BYTE:
            inflated = zlib.decompressobj().decompress(stream.read(), expected + 1)
            found, raw = len(inflated), np.frombuffer(inflated, np.uint8)
        else:
            found, raw = on_disk, np.empty(0, np.uint8)
            if found == expected:
                raw = np.fromfile(stream, np.uint8)
    if found != expected:
        amount = f"more than {expected}" if found == expected + 1 else str(found)
        raise InputError(
            f"{data_path}: holds {amount} bytes of voxels, expected {expected} from {path.name}"
        )
    return raw.view(dtype), magic == GZIP_MAGIC or on_disk != expected


def _inflate(
    stream: BinaryIO | gzip.GzipFile, expected: int, on_disk: int, data_path: Path
) -> tuple[int, NDArray[np.uint8]]:
    """Unzip at most one byte more than expected; how much came, and the bytes."""
    if expected > on_disk * MAX_DEFLATE_RATIO:
        raise InputError(
            f"{data_path}: {on_disk} bytes cannot hold the {expected} bytes of voxels that the "
            "header promises"
        )
    raw = np.empty(expected, np.uint8)
    view, found = raw.data, 0
    try:
        while found < expected:
            step = stream.readinto(view[found : found + (1 << 24)])  # type: ignore[union-attr]
            if not step:
                return found, raw
            found += step
        return found + len(stream.read(1)), raw
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(
            f"{data_path}: gzip data truncated or damaged after {found} of {expected} bytes "
            f"({error})"
        ) from None
