"""Multi-page TIFF: a page a layer.

TIFF knows no patient and no third axis. Voxel size and position are taken where ImageJ's or OME's
description says them; directions only from the key that mammosim's own writer adds to ImageJ's.
"""

from __future__ import annotations

import logging
import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import are_axes
from mammosim.phantom.readers.bounded import BoundedFile
from mammosim.phantom.readers.plain_xml import parse_xml
from mammosim.phantom.readers.volume import (
    VoxelFile,
    Voxels,
    check_promise,
    checked_shape,
    checked_spacing,
    reason_of,
)

TIFF_AXES_KEY = "patient_axes"
"""Key of ImageJ's description under which mammosim writes the letters of the axes."""

MM_OF_UNIT = {
    "mm": 1.0, "millimeter": 1.0, "millimeters": 1.0, "cm": 10.0, "centimeter": 10.0, "m": 1e3,
    "um": 1e-3, "\u00b5m": 1e-3, "\u03bcm": 1e-3, r"\u00B5m": 1e-3, "micron": 1e-3,
    "microns": 1e-3, "nm": 1e-6, "inch": 25.4,
}  # fmt: skip
"""Length units of ImageJ and OME, mm; ImageJ writes its micro sign as an escape."""

MAX_RATIO = 3000.0
"""Above the greatest compression of a TIFF's usual codings: LZW stands for at most 4 kB by each
12-bit code (TIFF 6.0, section 13), Deflate reaches 1032."""

DAMAGE = (
    ValueError, TypeError, KeyError, IndexError, OSError, EOFError,
    RuntimeError, MemoryError, OverflowError, NotImplementedError, ImportError, struct.error,
    ZeroDivisionError, AssertionError, AttributeError, zlib.error,
)  # fmt: skip
"""What tifffile raises, beside its own error, on damaged files and codings it does not know."""


def open_tiff(path: Path) -> VoxelFile:
    """Read the headers of a TIFF's pages.

    Raises
    ------
    InputError
        If the file is no TIFF, its pages are no one volume, or it is shorter than they say.
    """
    import tifffile

    try:
        with _errors_raised(), BoundedFile(path) as file, tifffile.TiffFile(file) as tiff:
            len(tiff.pages)  # walks to the last page, which ImageJ's series do not need
            series = tiff.series
            shape = _volume_shape(series, path)
            page, dtype = tiff.pages.first, np.dtype(series[0].dtype)
            imagej, ome = dict(tiff.imagej_metadata or {}), tiff.ome_metadata
            resolution = _resolution(page)
            compressed = page.compression != tifffile.COMPRESSION.NONE
    except (*DAMAGE, tifffile.TiffFileError) as error:
        raise InputError(f"{path}: not a whole TIFF file ({reason_of(error)})") from None
    promised = shape[0] * shape[1] * shape[2] * dtype.itemsize
    check_promise(promised, path.stat().st_size, MAX_RATIO if compressed else 1.0, path)
    spacing = _spacing(imagej, ome, resolution, path)
    axes = str(imagej.get(TIFF_AXES_KEY, ""))
    said = are_axes(axes) if axes else False
    size = np.ones(3) if spacing is None else spacing
    return VoxelFile(
        path, shape, size, dtype, partial(_load, path, shape, dtype), axes if said else None,
        "by mammosim, which wrote it", spacing is not None, _first(imagej, size) if said else None,
        files=(path,),
    )  # fmt: skip


def _volume_shape(series: list[Any], path: Path) -> tuple[int, int, int]:
    """Columns, rows and pages."""
    if len(series) != 1:
        raise InputError(
            f"{path}: holds {len(series)} images of different sizes, expected one volume"
        )
    sides = [side for side in series[0].shape if side != 1]
    if len(sides) != 3 or series[0].keyframe.samplesperpixel != 1:
        raise InputError(
            f"{path}: its pages make an array {list(series[0].shape)} ({series[0].axes}), "
            f"expected one value per pixel on two or more pages"
        )
    return checked_shape(sides[::-1], path)


def _load(path: Path, shape: tuple[int, int, int], dtype: np.dtype[Any], step: int) -> Voxels:
    """Page by page, so that no more than what is kept is in memory."""
    nx, ny, nz = shape
    start = step // 2
    out: NDArray[Any] | None = None
    import tifffile

    try:
        with _errors_raised(), BoundedFile(path) as file, tifffile.TiffFile(file) as tiff:
            series = tiff.series[0]
            if series.dataoffset is not None:
                values = np.memmap(path, series.dtype.newbyteorder(tiff.byteorder), "r",
                                   series.dataoffset, (nz, ny, nx))  # fmt: skip
                return Voxels(values[start::step, start::step, start::step].transpose(2, 1, 0))
            for k in range(start, nz, step):
                page = series.pages[k].asarray().reshape(ny, nx)[start::step, start::step]
                if out is None:
                    out = np.empty((len(range(start, nz, step)), *page.shape), dtype)
                out[k // step] = page
    except (*DAMAGE, tifffile.TiffFileError) as error:
        raise InputError(f"{path}: not a whole TIFF file ({reason_of(error)})") from None
    if out is None:
        out = np.empty((0, 0, 0), dtype)
    return Voxels(out.transpose(2, 1, 0))


class _Raising(logging.Handler):
    """Raises what is logged as an error; what is less is kept from the terminal."""

    def emit(self, record: logging.LogRecord) -> None:
        """Raise it."""
        if record.levelno >= logging.ERROR:
            raise ValueError(record.getMessage())


@contextmanager
def _errors_raised() -> Iterator[None]:
    """Let errors be seen that tifffile only logs, as pages that are missing at the end."""
    log, handler = logging.getLogger("tifffile"), _Raising()
    propagate, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.propagate = propagate


def _resolution(page: Any) -> tuple[float, float, float]:
    """Pixel width and height in the resolution's own unit, and that unit in mm; 0 if not said."""
    sides = []
    for tag in ("XResolution", "YResolution"):
        value = page.tags.valueof(tag, (0, 1))
        above, below = (float(part) for part in value)
        sides.append(below / above if above > 0 and below > 0 else 0.0)
    unit = {2: 25.4, 3: 10.0}.get(int(page.tags.valueof("ResolutionUnit", 1)), 0.0)
    return sides[0], sides[1], unit


def _spacing(
    imagej: Mapping[str, Any], ome: str | None, resolution: tuple[float, float, float], path: Path
) -> NDArray[np.float64] | None:
    """Voxel size by OME's or ImageJ's description, mm."""
    if ome:
        sizes = _ome_sizes(ome)
        if sizes is not None:
            return checked_spacing(sizes, path)
    width, height, unit = resolution
    # ImageJ's own unit, else that of the tag; pages without a distance are no volume.
    unit = MM_OF_UNIT.get(str(imagej.get("unit", "")).strip(), unit)
    depth = imagej.get("spacing")
    if unit and width and height and isinstance(depth, int | float):
        return checked_spacing([width * unit, height * unit, float(depth) * unit], path)
    return None


def _ome_sizes(text: str) -> list[float] | None:
    """PhysicalSizeX, Y and Z of OME-XML, mm, or None where one is missing."""
    try:
        pixels = next(item for item in parse_xml(text).iter() if item.tag.endswith("}Pixels"))
        return [
            float(pixels.attrib[f"PhysicalSize{axis}"])
            * MM_OF_UNIT[pixels.attrib.get(f"PhysicalSize{axis}Unit", "\u00b5m")]
            for axis in "XYZ"
        ]
    except (ParseError, StopIteration, KeyError, ValueError):
        return None


def _first(imagej: Mapping[str, Any], spacing: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Centre of the first voxel by ImageJ's origin, which is the index of the point 0."""
    try:
        origin = [float(imagej.get(f"{axis}origin", 0.0)) for axis in "xyz"]
    except (TypeError, ValueError):
        return None
    first = -np.array(origin) * spacing
    return first if all(math.isfinite(value) for value in first) else None
