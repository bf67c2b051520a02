"""VICTRE's pair of files: gzipped voxels and a MetaImage header that says what they are."""

from __future__ import annotations

import gzip
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.export.atomic import whole_file, write_text
from mammosim.geometry import VoxelFrame

ELEMENT_TYPES = {
    "u1": "MET_UCHAR", "i1": "MET_CHAR", "u2": "MET_USHORT", "i2": "MET_SHORT",
    "u4": "MET_UINT", "i4": "MET_INT",
}  # fmt: skip
"""MetaImage's name of each type of whole numbers."""

LAYERS_AT_ONCE = 8
"""Layers turned into the file's order at a time: a few megabytes."""

DECIMALS = 12
"""Of positions and sizes in mm: rounding beyond them comes from sums, not from any phantom."""

GZIP_LEVEL = 6
"""zlib's own default: labels shrink to some hundredths at any level."""


def write_metaimage(
    values: NDArray[np.integer[Any]], frame: VoxelFrame, path: str | PathLike[str]
) -> None:
    """Write ``NAME.mhd`` and, beside it, ``NAME.raw.gz``.

    Parameters
    ----------
    values : ndarray of whole numbers, [x, y, z]
        x is the fastest in the file; may be a strided view.
    frame : VoxelFrame
        Where the voxels are, mm.
    path : path
        Ends in ``.mhd``.

    Raises
    ------
    InputError
        If a file cannot be written, or the numbers need more than 32 bits.

    Notes
    -----
    Axes and positions are those of `frame`, without patient orientation, as VICTRE writes them
    and its own readers need them: the lines keep VICTRE's order (breastCompress.cxx reads offset,
    spacing and size by line number), numbers have no exponent. Unlike VICTRE's, the header says
    that the voxels are compressed and in which file, so that ITK reads them too.
    """
    path = Path(path)
    kind = ELEMENT_TYPES.get(values.dtype.str[1:])
    if kind is None:
        raise InputError(f"{path}: cannot hold {values.dtype}, expected whole numbers of 32 bits")
    raw_path = path.with_name(f"{path.name.removesuffix(path.suffix)}.raw.gz")
    with whole_file(raw_path) as part, part.open("wb") as stream:
        _write_voxels(values, stream)
    lines = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": "True",
        "TransformMatrix": "1 0 0 0 1 0 0 0 1",
        "Offset": _numbers(frame.origin_mm),
        "CenterOfRotation": "0 0 0",
        "ElementSpacing": _numbers(frame.spacing_mm),
        "DimSize": " ".join(str(side) for side in values.shape),
        "AnatomicalOrientation": "???",
        "ElementType": kind,
        "ElementDataFile": raw_path.name,
    }
    write_text(path, "".join(f"{key} = {value}\n" for key, value in lines.items()))


def _write_voxels(values: NDArray[np.integer[Any]], stream: BinaryIO) -> None:
    little = values.dtype.newbyteorder("<")
    # Without name and time, so that the same voxels give the same bytes.
    with gzip.GzipFile("", "wb", GZIP_LEVEL, stream, mtime=0) as packed:
        for start in range(0, values.shape[2], LAYERS_AT_ONCE):
            layers = values[:, :, start : start + LAYERS_AT_ONCE].transpose(2, 1, 0)
            packed.write(layers.astype(little, order="C", copy=False).tobytes())


def _numbers(values: NDArray[np.float64]) -> str:
    """Decimals without exponent, to a billionth of a micrometre, where 0.1 + 0.2 is 0.3."""
    rounded = np.round(np.asarray(values, dtype=np.float64), DECIMALS)
    return " ".join(np.format_float_positional(value, trim="-") for value in rounded)
