"""Gzip and zlib data as a stream of bytes, read no further than asked for."""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import Voxels

GZIP_MAGIC, ZLIB_FIRST_BYTE = b"\x1f\x8b", b"\x78"
"""First bytes of each (RFC 1952; RFC 1950 with the usual window of 32 kB)."""

CHUNK_BYTES = 1 << 16
"""Compressed bytes that are read at a time."""

GZIP_OR_ZLIB = 47
"""zlib's window bits for "largest window, either header" (zlib manual, inflateInit2)."""


class Inflated(io.RawIOBase):
    """The content of gzip (one member or more) or zlib data, from where a stream stands.

    Parameters
    ----------
    stream : binary file
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._left = b""
        self._inflator = zlib.decompressobj(GZIP_OR_ZLIB)

    def readable(self) -> bool:
        """Always."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer as far as the next chunk goes; 0 at the end.

        Raises
        ------
        zlib.error, EOFError
            If the data are damaged or break off.
        """
        while len(buffer):
            if self._inflator.eof:
                left = self._inflator.unused_data or self._stream.read(CHUNK_BYTES)
                if not left.startswith(GZIP_MAGIC):
                    return 0
                self._left, self._inflator = left, zlib.decompressobj(GZIP_OR_ZLIB)
            chunk = self._left or self._stream.read(CHUNK_BYTES)
            if not chunk:
                raise EOFError("the data break off")
            content = self._inflator.decompress(chunk, len(buffer))
            self._left = self._inflator.unconsumed_tail
            if content:
                buffer[: len(content)] = content
                return len(content)
        return 0


def inflated(stream: BinaryIO) -> io.BufferedReader:
    """The content of gzip or zlib data, from where a stream stands."""
    return io.BufferedReader(Inflated(stream), CHUNK_BYTES)


def read_layers(
    stream: BinaryIO,
    shape: tuple[int, int, int],
    dtype: np.dtype[Any],
    step: int,
    path: Path,
    header: str,
) -> Voxels:
    """Read exactly one volume, i fastest on disk, layer by layer.

    Parameters
    ----------
    stream : binary file
        Stands at the first voxel; nothing but voxels may follow.
    shape : tuple of int
        Voxels along i, j, k.
    dtype : dtype
    step : int
        Of every n voxels along each axis one is kept.
    path : path
        For messages.
    header : str
        What says the shape, for messages.

    Raises
    ------
    InputError
        If there are fewer or more voxels, or the data are damaged.
    """
    nx, ny, nz = shape
    start, layer_bytes = step // 2, nx * ny * dtype.itemsize
    expected = nz * layer_bytes
    kept = tuple(len(range(start, side, step)) for side in (nz, ny, nx))
    out = np.empty(kept, dtype)
    layer = np.empty((ny, nx), dtype)
    found = 0
    try:
        for k in range(nz):
            keep = k % step == start
            target = out[k] if step == 1 else layer
            found += _fill(stream, target.reshape(-1).view(np.uint8))
            if found < (k + 1) * layer_bytes:
                break
            if keep and step > 1:
                out[k // step] = layer[start::step, start::step]
        else:
            found += len(stream.read(1))
    except (EOFError, zlib.error) as error:
        raise InputError(
            f"{path}: compressed data truncated or damaged after {found} of {expected} bytes "
            f"({error})"
        ) from None
    if found != expected:
        amount = f"more than {expected}" if found > expected else str(found)
        raise InputError(
            f"{path}: holds {amount} bytes of voxels, expected {expected} from {header}"
        )
    return Voxels(out.transpose(2, 1, 0))


def _fill(stream: BinaryIO, target: NDArray[np.uint8]) -> int:
    """Bytes that came; fewer than wanted at the end of the stream."""
    view, found = target.data, 0
    while found < len(view):
        step = stream.readinto(view[found:])  # type: ignore[attr-defined]
        if not step:
            break
        found += step
    return found


def count_bytes(stream: BinaryIO, most: int) -> int:
    """How many bytes a stream still holds, counted up to `most`.

    One more byte is read, so that data which end there have their checksum verified.
    """
    found = 0
    while found < most:
        step = len(stream.read(min(CHUNK_BYTES, most - found)))
        if step == 0:
            break
        found += step
    stream.read(1)
    return found
