"""NRRD: read by SimpleITK after its length has been checked.

The header is lines of text up to an empty line; the voxels follow, or lie in the file that
`data file` names (teem's definition of the format, nrrd/format.html).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from mammosim.errors import InputError
from mammosim.phantom.readers.inflate import count_bytes, inflated
from mammosim.phantom.readers.itk import checked_before_loading, open_itk
from mammosim.phantom.readers.volume import MAX_DEFLATE_RATIO, VoxelFile, check_promise

MAX_HEADER_BYTES = 1 << 20
"""A header is a page of text: more than this is another kind of file."""

RATIO_OF_ENCODING = {
    "raw": 1.0, "gzip": MAX_DEFLATE_RATIO, "gz": MAX_DEFLATE_RATIO, "ascii": 8.0, "text": 8.0,
    "txt": 8.0, "hex": 1.0,
}  # fmt: skip
"""Bytes of voxels a byte of each encoding can stand for; a number as text takes a byte or more.
SimpleITK reads no bzip2."""


def open_nrrd(path: Path) -> VoxelFile:
    """Read the header of an NRRD, or of an NHDR and its voxel file.

    Without `space` axes are in no known direction.

    Raises
    ------
    InputError
        If the file is not NRRD, holds fewer voxels than its header says, or for `open_itk`'s
        reasons.
    """
    header, start = _read_header(path)
    encoding = header.get("encoding", "raw").lower()
    if encoding not in RATIO_OF_ENCODING:
        raise InputError(
            f"{path}: encoding is '{encoding}', expected one of {', '.join(RATIO_OF_ENCODING)}"
        )
    data_path = path
    name = header.get("data file") or header.get("datafile")
    if name is not None:
        data_path, start = _data_path(name, path), 0
    on_disk = data_path.stat().st_size - start
    says_axes = "space" in header and "space directions" in header
    opened = open_itk(path, says_axes, tuple(dict.fromkeys((path, data_path))))
    promised = opened.count * opened.dtype.itemsize + _skipped_bytes(header, path)
    check_promise(promised, on_disk, RATIO_OF_ENCODING[encoding], data_path)
    check = partial(_check_length, data_path, start, encoding, promised)
    return checked_before_loading(opened, check)


def _skipped_bytes(header: Mapping[str, str], path: Path) -> int:
    """Bytes before the voxels; -1, which counts from the end of the file, skips none for sure."""
    text = header.get("byte skip") or header.get("byteskip") or "0"
    try:
        return max(int(text), 0)
    except ValueError:
        raise InputError(f"{path}: byte skip is '{text}', expected a whole number") from None


def _read_header(path: Path) -> tuple[dict[str, str], int]:
    """Fields by name in small letters, and the header's length in bytes."""
    with path.open("rb") as stream:
        content = stream.read(MAX_HEADER_BYTES)
    if not content.startswith(b"NRRD000"):
        raise InputError(f"{path}: not an NRRD file, its first line is not 'NRRD000' and a number")
    header: dict[str, str] = {}
    read = 0
    for line in content.splitlines(keepends=True):
        read += len(line)
        text = line.decode("latin-1").strip()
        if not text:
            break
        field, colon, value = text.partition(":")
        if colon and not text.startswith("#"):
            header[field.strip().lower()] = value.strip()
    return header, read


def _data_path(name: str, path: Path) -> Path:
    if Path(name).name != name or "\\" in name or name.upper().startswith("LIST") or "%" in name:
        # A file from elsewhere must not make us open anything outside its own folder.
        raise InputError(f"{path}: data file is '{name}', expected one file beside the header")
    if not (path.parent / name).is_file():
        raise InputError(f"{path}: its voxel file {path.parent / name} does not exist")
    return path.parent / name


def _check_length(data_path: Path, start: int, encoding: str, promised: int) -> None:
    """Refuse compressed voxels that break off: ITK leaves what is missing as it finds it."""
    zipped = encoding in ("gzip", "gz")
    with data_path.open("rb") as stream:
        stream.seek(start)
        try:
            found = count_bytes(inflated(stream) if zipped else stream, promised)
        except (EOFError, zlib.error) as error:
            raise InputError(
                f"{data_path}: compressed data truncated or damaged ({error})"
            ) from None
    if encoding not in ("ascii", "text", "txt", "hex"):
        check_promise(promised, found, 1, data_path)
