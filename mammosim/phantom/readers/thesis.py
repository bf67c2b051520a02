"""The input file of the thesis that the spring model comes from: a cube of 16-bit codes.

The file has no header. Its `inputRead` (appendix of the thesis) takes the side of the cube from the
file's length, reads little-endian codes in the order x, z, y with y fastest, takes every code that
it does not know for fat, and crops the cube to the box around all tissue.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.volume import VoxelFile, Voxels, every_nth
from mammosim.tissues import LABEL_MAPS

AIR, FAT = 220, 203
"""Codes of air and of fat."""

AXES = "LSP"
"""How the file's axes run, the fastest first: y, z, and x from the nipple to the chest wall."""

VOXEL_MM = 1.0
"""The thesis' own estimate of its unit, from a small breast of 6 x 13 x 12 cm (section 3.1)."""


def open_thesis(path: Path) -> VoxelFile:
    """Find the size of the thesis' input file.

    Parameters
    ----------
    path : path
        220 air, 203 fat, 216 gland, 201 abnormality; all other codes are fat, which is noted.

    Returns
    -------
    VoxelFile
        Codes of the label map `thesis`, cropped to the tissue when they are read, voxels of 1 mm.

    Raises
    ------
    InputError
        If the file is not a cube of 2-byte codes; when it is read, if it holds nothing but air.

    Notes
    -----
    The thesis counts x from the nipple to the chest wall: that axis is turned round. It does not
    say which way y goes; y is taken as towards the patient's left, z as superior.

    Positions are the thesis' own where it has any: z in mm is its z index in the cropped cube, so
    that `LowerPlate` and `UpperPlate` are `support_z_mm` and `paddle_z_mm`; x = 0 is the
    chest-wall layer, its index Nx - 1; y = 0 is the middle.
    """
    side = cube_side(path)
    note = (
        f"{path.name} gives no voxel size or position: {VOXEL_MM:g} mm was assumed, x from the "
        f"chest "
        "wall, z as in the file, y towards the patient's left"
    )
    return VoxelFile(
        path, (side, side, side), np.full(3, VOXEL_MM), np.dtype("<i2"),
        partial(_load, path, side), AXES, "by the thesis, but for y", whole_copies=2,
        notes=(note,), files=(path,),
    )  # fmt: skip


def _load(path: Path, side: int, step: int) -> Voxels:
    inner = _cropped(np.memmap(path, "<i2", "r", 0, (side, side, side)), path)
    # [x, z, y] as the file has it -> [y, z, x], the fastest first
    values = np.array(inner.transpose(2, 1, 0))
    notes: tuple[str, ...] = ()
    unknown = ~np.isin(values, list(LABEL_MAPS["thesis"]))
    if unknown.any():
        found = ", ".join(str(code) for code in np.unique(values[unknown])[:20])
        notes = (
            f"{int(unknown.sum())} voxels of {path.name} hold codes that the thesis does not "
            f"define ({found}): treated as fat, as in the thesis",
        )
        values[unknown] = FAT
    ny, _, nx = values.shape
    first = VOXEL_MM * np.array([nx - 1.0, -0.5 * (ny - 1.0), 0.0])
    return Voxels(every_nth(values, step), first, notes)


def cube_side(path: Path) -> int:
    """Side of the cube that a file of this format holds, from its length.

    Raises
    ------
    InputError
        If no cube of 2-byte codes has this length.
    """
    size = path.stat().st_size
    side = round((size / 2) ** (1 / 3))
    if side == 0 or 2 * side**3 != size:
        near = max(side, 1)
        raise InputError(
            f"{path}: holds {size} bytes, expected a cube of 2-byte codes like the thesis' input "
            f"file ({2 * near**3} bytes for a side of {near})"
        )
    return side


def _cropped(codes: NDArray[np.int16], path: Path) -> NDArray[np.int16]:
    """The box around all that is not air."""
    tissue = codes != AIR
    if not tissue.any():
        raise InputError(f"{path}: holds no tissue, every code is {AIR} (air)")
    box = []
    for axis in range(3):
        layers = np.flatnonzero(
            tissue.any(axis=tuple(other for other in range(3) if other != axis))
        )
        box.append(slice(int(layers[0]), int(layers[-1]) + 1))
    return codes[tuple(box)]
