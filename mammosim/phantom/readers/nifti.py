"""NIfTI: read by SimpleITK after its length has been checked.

ITK fills what a truncated NIfTI file lacks with zeros, which would be air, and says nothing that
a program could see.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

from mammosim.errors import InputError
from mammosim.phantom.readers.itk import read_itk
from mammosim.phantom.readers.volume import Volume

GZIP_MAGIC = b"\x1f\x8b"

CHUNK_BYTES = 1 << 24


def read_nifti(path: Path) -> Volume:
    """Read a NIfTI-1 or NIfTI-2 file in one piece.

    Raises
    ------
    InputError
        If the file is not NIfTI, holds fewer voxels than its header says, or for `read_itk`'s
        reasons.
    """
    with path.open("rb") as stream:
        zipped = stream.read(2) == GZIP_MAGIC
    try:
        with gzip.open(path) if zipped else path.open("rb") as content:
            expected = _promised_bytes(content.read(540), path)
            content.seek(0)
            found = 0
            while found < expected:
                step = len(content.read(min(CHUNK_BYTES, expected - found)))
                if step == 0:
                    break
                found += step
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise InputError(f"{path}: gzip data truncated or damaged ({error})") from None
    if found < expected:
        raise InputError(f"{path}: holds {found} bytes, expected {expected} from its header")
    return read_itk(path)


def _promised_bytes(header: bytes, path: Path) -> int:
    """Length of the whole file by its header (nifti1.h, nifti2.h: dim, bitpix, vox_offset)."""
    for order in "<>":
        size = struct.unpack_from(order + "i", header.ljust(4, b"\0"))[0]
        if size == 348 and len(header) >= 348:
            dim = struct.unpack_from(order + "8h", header, 40)
            (bits,) = struct.unpack_from(order + "h", header, 72)
            (start,) = struct.unpack_from(order + "f", header, 108)
        elif size == 540 and len(header) >= 540:
            dim = struct.unpack_from(order + "8q", header, 16)
            (bits,) = struct.unpack_from(order + "h", header, 14)
            (start,) = struct.unpack_from(order + "q", header, 168)
        else:
            continue
        count = 1
        for side in dim[1 : 1 + max(0, min(dim[0], 7))]:
            count *= max(side, 0)
        if count > 0 and 0 <= start < 2**40:
            return int(start) + count * bits // 8
    raise InputError(f"{path}: not a whole NIfTI file, its header cannot be used")
