"""NIfTI: read by SimpleITK after its length has been checked.

ITK fills what a truncated NIfTI file lacks with zeros, which would be air, and says nothing that
a program could see.
"""

from __future__ import annotations

import struct
import zlib
from functools import partial
from pathlib import Path
from typing import NamedTuple

from mammosim.errors import InputError
from mammosim.phantom.readers.inflate import GZIP_MAGIC, count_bytes, inflated
from mammosim.phantom.readers.itk import checked_before_loading, open_itk
from mammosim.phantom.readers.volume import (
    MAX_DEFLATE_RATIO,
    VoxelFile,
    check_promise,
    checked_spacing,
)

LONGEST_HEADER = 540
"""Bytes of a NIfTI-2 header; one of NIfTI-1 has 348 (nifti2.h, nifti1.h)."""


class NiftiHeader(NamedTuple):
    """What a NIfTI header says that ITK does not tell.

    Parameters
    ----------
    file_bytes : int
        Length of the whole file.
    voxel_mm : tuple of float
    says_axes : bool
        Whether it has a qform or an sform; without either, axes are in no known direction.
    """

    file_bytes: int
    voxel_mm: tuple[float, ...]
    says_axes: bool


def open_nifti(path: Path) -> VoxelFile:
    """Read the header of a NIfTI-1 or NIfTI-2 file in one piece.

    Raises
    ------
    InputError
        If the file is not NIfTI, holds fewer voxels than its header says, or for `open_itk`'s
        reasons.
    """
    with path.open("rb") as stream:
        zipped = stream.read(2) == GZIP_MAGIC
        stream.seek(0)
        try:
            content = (inflated(stream) if zipped else stream).read(LONGEST_HEADER)
        except (EOFError, zlib.error) as error:
            raise InputError(f"{path}: gzip data truncated or damaged ({error})") from None
    header = _header(content, path)
    # ITK would take its absolute value, and 1 for 0.
    checked_spacing(header.voxel_mm, path)
    ratio = MAX_DEFLATE_RATIO if zipped else 1
    check_promise(header.file_bytes, path.stat().st_size, ratio, path)
    check = partial(_check_length, path, header.file_bytes, zipped)
    return checked_before_loading(open_itk(path, header.says_axes), check)


def _check_length(path: Path, expected: int, zipped: bool) -> None:
    with path.open("rb") as stream:
        try:
            found = count_bytes(inflated(stream) if zipped else stream, expected)
        except (EOFError, zlib.error) as error:
            raise InputError(f"{path}: gzip data truncated or damaged ({error})") from None
    if found < expected:
        raise InputError(
            f"{path}: holds {found} bytes, expected {expected} from its header; truncated"
        )


def _header(content: bytes, path: Path) -> NiftiHeader:
    """Length, voxel size and orientation (nifti1.h, nifti2.h)."""
    for order in "<>":
        size = struct.unpack_from(order + "i", content.ljust(4, b"\0"))[0]
        if size == 348 and len(content) >= 348:
            places = {"dim": ("8h", 40), "bitpix": ("h", 72), "pixdim": ("8f", 76),
                      "start": ("f", 108), "codes": ("2h", 252)}  # fmt: skip
        elif size == 540 and len(content) >= 540:
            places = {"dim": ("8q", 16), "bitpix": ("h", 14), "pixdim": ("8d", 104),
                      "start": ("q", 168), "codes": ("2i", 344)}  # fmt: skip
        else:
            continue
        fields = {
            name: struct.unpack_from(order + form, content, at)
            for name, (form, at) in places.items()
        }
        (bits,), (start,) = fields["bitpix"], fields["start"]
        count = 1
        for side in fields["dim"][1 : 1 + max(0, min(fields["dim"][0], 7))]:
            count *= max(side, 0)
        if count > 0 and 0 <= start < 2**40 and bits > 0:
            length = int(start) + (count * bits + 7) // 8
            return NiftiHeader(length, fields["pixdim"][1:4], any(fields["codes"]))
    raise InputError(f"{path}: not a whole NIfTI file, its header cannot be used")
