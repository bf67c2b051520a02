"""Phantoms of the University of Wisconsin's Numerical Breast Phantoms Repository (UWCEM).

A phantom is a folder with `breastInfo.txt` (size of the grid and density class), `mtype.txt` (the
medium of each voxel, a number a line, first index fastest) and `pval.txt` (dielectric properties,
not used). Voxels are cubes of 0.5 mm (instruction manual of the repository; Zastrow et al. 2008,
IEEE Trans Biomed Eng 55:2792). The manual does not say how the axes lie: chest wall and nipple are
found from the voxels.
"""

from __future__ import annotations

import re
import warnings
from functools import partial
from pathlib import Path

import numpy as np

from mammosim.config import open_file, read_text
from mammosim.errors import InputError
from mammosim.phantom.readers.volume import (
    VoxelFile,
    Voxels,
    check_promise,
    checked_shape,
    every_nth,
)
from mammosim.tissues import LABEL_MAPS

INFO_FILE = "breastInfo.txt"
VOXEL_MM = 0.5
"""Edge of a voxel, by the repository's manual (see above)."""

MAX_INFO_BYTES = 100_000
"""Of `breastInfo.txt`, which has five lines."""

MIN_BYTES_PER_VALUE = 2
"""A digit and the end of its line."""

BLOCK_BYTES = 1 << 24
"""Bytes of text that are read at a time."""


def open_uwcem(path: Path) -> VoxelFile:
    """Read the size of a phantom from `breastInfo.txt` beside its `mtype.txt`.

    Raises
    ------
    InputError
        If there is no such file, it says no size, or the voxels cannot be as many; when they are
        read, if they are not.
    """
    beside = path.parent / INFO_FILE
    try:
        text = read_text(beside, MAX_INFO_BYTES)
    except (OSError, ValueError):
        raise InputError(
            f"{path}: text files of voxels need UWCEM's {INFO_FILE} beside them; found none that "
            f"can be read"
        ) from None
    sides = dict(re.findall(r"\bs([123])\s*=\s*(\d{1,6})", text))
    if len(sides) != 3:
        raise InputError(f"{beside}: found no size, expected lines s1=..., s2=..., s3=...")
    shape = checked_shape([int(sides[axis]) for axis in "123"], path)
    count = shape[0] * shape[1] * shape[2]
    check_promise(count * MIN_BYTES_PER_VALUE, path.stat().st_size + 1, 1, path)
    return VoxelFile(
        path, shape, np.full(3, VOXEL_MM), np.dtype(np.float32), partial(_load, path, shape),
        label_map=LABEL_MAPS["uwcem"], whole_copies=1, files=(path, beside),
    )  # fmt: skip


def _load(path: Path, shape: tuple[int, int, int], step: int) -> Voxels:
    values = np.empty(shape[0] * shape[1] * shape[2], np.float32)
    filled, rest = 0, b""
    with open_file(path) as stream:
        while block := stream.read(BLOCK_BYTES):
            lines, _, rest = (rest + block).rpartition(b"\n")
            filled = _append(lines, values, filled, path)
    filled = _append(rest, values, filled, path)
    if filled != values.size:
        raise InputError(
            f"{path}: holds {filled} values, expected {values.size} for {shape[0]} x {shape[1]} x "
            f"{shape[2]} voxels of {INFO_FILE}"
        )
    return Voxels(every_nth(values.reshape(shape, order="F"), step))


def _append(lines: bytes, values: np.ndarray, filled: int, path: Path) -> int:
    """Read numbers behind those that are there; how many there are then."""
    if not lines.strip():
        return filled
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns where a text breaks off
            found = np.fromstring(lines.decode("ascii"), np.float32, sep=" ")
    except (ValueError, DeprecationWarning):
        raise InputError(f"{path}: expected one number per line, as in mtype.txt") from None
    room = values[filled : filled + found.size]
    room[:] = found[: room.size]
    return filled + found.size
