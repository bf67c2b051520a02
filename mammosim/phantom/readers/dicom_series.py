"""A DICOM series of labels: a folder of files, each one slice."""

from __future__ import annotations

import math
import struct
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.phantom.readers.axes import BREAST_FROM_LPS, axes_of_direction
from mammosim.phantom.readers.bounded import BoundedFile
from mammosim.phantom.readers.slices import SliceOrder, by_number, by_position
from mammosim.phantom.readers.volume import (
    MAX_DEFLATE_RATIO,
    VoxelFile,
    Voxels,
    check_promise,
    checked_origin,
    checked_shape,
    checked_spacing,
    reason_of,
)

DAMAGE = (
    AttributeError, EOFError, KeyError, IndexError, NotImplementedError, OSError, OverflowError,
    RuntimeError, TypeError, ValueError, MemoryError, struct.error,
)  # fmt: skip
"""What pydicom raises, beside an error of its own, on damaged files and unknown codings."""

TAGS = (
    "SeriesInstanceUID", "Rows", "Columns", "NumberOfFrames", "SamplesPerPixel", "BitsAllocated",
    "PixelRepresentation", "RescaleSlope", "RescaleIntercept", "PixelSpacing", "SliceThickness",
    "SpacingBetweenSlices", "ImageOrientationPatient", "ImagePositionPatient", "InstanceNumber",
    "Laterality", "ImageLaterality",
)  # fmt: skip
"""All that is read of a header."""


@dataclass(frozen=True)
class Slice:
    """What a slice's header says; numbers in mm, None where it does not say."""

    path: Path
    series: str
    columns: int
    rows: int
    bits: int
    signed: bool
    slope: float
    intercept: float
    spacing: tuple[float, ...] | None
    orientation: tuple[float, ...] | None
    position: tuple[float, ...] | None
    number: int | None
    thickness: float | None
    laterality: str | None
    compressed: bool

    @property
    def form(self) -> dict[str, Any]:
        """What all slices of a volume have in common."""
        return {
            "size": (self.columns, self.rows), "bits": (self.bits, self.signed),
            "rescaling": (self.slope, self.intercept),
            "PixelSpacing": _rounded(self.spacing),
            "ImageOrientationPatient": _rounded(self.orientation),
        }  # fmt: skip


def open_dicom_series(path: Path) -> VoxelFile:
    """Read the headers of a folder of DICOM slices.

    Parameters
    ----------
    path : path
        The folder; files in it that are not DICOM pictures are passed over, which is noted.

    Raises
    ------
    InputError
        If the slices are no one volume: more than one series, different sizes, a slice missing or
        there twice, uneven distances.

    Notes
    -----
    Slices are put in order by ImagePositionPatient, or where that is missing by InstanceNumber.
    """
    slices, others = _read_headers(path)
    _check_one_volume(slices, path)
    order, notes = _order(slices, path)
    if others:
        notes.append(
            f"{len(others)} files of {path.name} are not DICOM images and were skipped "
            f"({', '.join(sorted(others)[:3])})"
        )
    first = slices[order.index[0]]
    rows_mm, columns_mm = first.spacing or (1.0, 1.0)
    spacing = checked_spacing([columns_mm, rows_mm, order.step_mm or 1.0], path)
    says_voxel = first.spacing is not None and order.step_mm is not None
    shape = checked_shape([first.columns, first.rows, len(slices)], path)
    dtype = _dtype(first, path)
    stored = shape[0] * shape[1] * max(first.bits // 8, 1)
    for entry in slices:
        ratio = MAX_DEFLATE_RATIO if entry.compressed else 1.0
        check_promise(stored, entry.path.stat().st_size, ratio, entry.path)
    axes, at = None, None
    if first.orientation is not None:
        axes = axes_of_direction(_direction(first.orientation, path), path)
        if first.position is not None and order.by_position:
            at = BREAST_FROM_LPS @ checked_origin(first.position, path)
    files = tuple(slices[number].path for number in order.index)
    sides = {entry.laterality for entry in slices} - {None}
    return VoxelFile(
        path, shape, spacing, dtype, partial(_load, files, first, shape, dtype), axes,
        "by its headers", says_voxel, at, laterality=sides.pop() if len(sides) == 1 else None,
        notes=tuple(notes), files=files,
    )  # fmt: skip


def _read_headers(path: Path) -> tuple[list[Slice], list[str]]:
    """Headers of all pictures, and names of the files that are none."""
    import pydicom

    slices, others = [], []
    for file in sorted(item for item in path.iterdir() if item.is_file()):
        if file.name.startswith("."):
            continue
        try:
            with _quiet(), BoundedFile(file) as stream:
                header = pydicom.dcmread(stream, stop_before_pixels=True, specific_tags=list(TAGS))
        except pydicom.errors.InvalidDicomError:
            others.append(file.name)
            continue
        except (*DAMAGE, pydicom.errors.BytesLengthException) as error:
            raise InputError(f"{file}: damaged DICOM file ({reason_of(error)})") from None
        if "Rows" not in header or "Columns" not in header:
            others.append(file.name)
            continue
        try:
            slices.append(_slice(header, file))
        except (*DAMAGE, pydicom.errors.BytesLengthException) as error:
            raise InputError(f"{file}: damaged DICOM header ({reason_of(error)})") from None
    if not slices:
        raise InputError(
            f"{path}: the folder contains no DICOM images, expected a series of slices"
        )
    return slices, others


def _slice(header: Any, file: Path) -> Slice:
    with _quiet():
        frames = int(header.get("NumberOfFrames") or 1)
        samples = int(header.get("SamplesPerPixel") or 1)
        side = str(header.get("ImageLaterality") or header.get("Laterality") or "")
        number = header.get("InstanceNumber")
        found = Slice(
            file, str(header.get("SeriesInstanceUID", "")), int(header.Columns), int(header.Rows),
            int(header.get("BitsAllocated") or 0), bool(header.get("PixelRepresentation")),
            float(header.get("RescaleSlope") or 1.0), float(header.get("RescaleIntercept") or 0.0),
            _numbers(header, "PixelSpacing", 2), _numbers(header, "ImageOrientationPatient", 6),
            _numbers(header, "ImagePositionPatient", 3), None if number is None else int(number),
            _distance(header), side if side in ("L", "R") else None,
            bool(header.file_meta.TransferSyntaxUID.is_compressed),
        )  # fmt: skip
    if frames != 1 or samples != 1:
        raise InputError(
            f"{file}: holds {frames} frames with {samples} values per pixel, expected one slice "
            f"of labels"
        )
    return found


def _numbers(header: Any, tag: str, count: int) -> tuple[float, ...] | None:
    value = header.get(tag)
    if value is None or len(value) == 0:
        return None
    numbers = tuple(float(item) for item in value)
    if len(numbers) != count:
        raise ValueError(f"{tag} holds {len(numbers)} numbers, expected {count}")
    if not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{tag} holds numbers that are not finite")
    return numbers


def _rounded(numbers: Sequence[float] | None) -> tuple[float, ...] | None:
    """To what all writers of a header keep: 0.1 um, or 0.006 degrees."""
    return None if numbers is None else tuple(round(number, 4) for number in numbers)


def _distance(header: Any) -> float | None:
    """Distance of slices by the header, where positions do not tell."""
    for tag in ("SpacingBetweenSlices", "SliceThickness"):
        if header.get(tag):
            return abs(float(header.get(tag)))
    return None


def _check_one_volume(slices: Sequence[Slice], path: Path) -> None:
    series = Counter(entry.series for entry in slices)
    if len(series) > 1:
        counts = ", ".join(f"{count} of {uid or 'none'}" for uid, count in series.most_common(5))
        raise InputError(
            f"{path}: holds {len(series)} series ({counts}), expected one; put each into its own "
            f"folder"
        )
    common = slices[0].form
    problems = [
        f"{entry.path}: {name} is {value}, but {common[name]} in {slices[0].path.name}"
        for entry in slices[1:]
        for name, value in entry.form.items()
        if value != common[name]
    ]
    if problems:
        raise InputError([*problems[:10], f"{path}: its slices do not form one volume"])


def _order(slices: Sequence[Slice], path: Path) -> tuple[SliceOrder, list[str]]:
    """The slices in their order, and what was assumed."""
    names = [entry.path.name for entry in slices]
    positions = [entry.position for entry in slices]
    orientation = slices[0].orientation
    placed = orientation is not None and None not in positions
    if placed and (len(slices) == 1 or len(set(positions)) > 1):
        normal = _direction(orientation, path)[:, 2]  # type: ignore[arg-type]
        at = np.array(positions, dtype=np.float64)
        return by_position(at, normal, names, slices[0].thickness, path), []
    note = f"{path.name} gives no slice positions: slices were ordered by InstanceNumber"
    numbers = [entry.number for entry in slices]
    return by_number(numbers, names, slices[0].thickness, path), [note]


def _direction(orientation: Sequence[float], path: Path) -> NDArray[np.float64]:
    """(3, 3) LPS directions of columns' index, rows' index and slices, as columns."""
    along_row, down_column = np.array(orientation, dtype=np.float64).reshape(2, 3)
    direction = np.stack([along_row, down_column, np.cross(along_row, down_column)], axis=1)
    # Cosines as a header rounds them are within 1e-4 of unit length.
    if not np.allclose(direction.T @ direction, np.eye(3), atol=1e-3):
        raise InputError(
            f"{path}: ImageOrientationPatient is {list(orientation)}, expected two unit vectors at "
            "right angles"
        )
    return direction


def _dtype(entry: Slice, path: Path) -> np.dtype[Any]:
    if entry.bits not in (1, 8, 16, 32):
        raise InputError(
            f"{path}: its pixels have {entry.bits} bits, expected whole numbers of 8, 16 or 32"
        )
    if entry.slope == 1.0 and entry.intercept == 0.0:
        return np.dtype(f"{'i' if entry.signed else 'u'}{max(entry.bits // 8, 1)}")
    return np.dtype(np.float64)


def _load(
    files: Sequence[Path], first: Slice, shape: tuple[int, int, int], dtype: np.dtype[Any],
    step: int,
) -> Voxels:  # fmt: skip
    """Slice by slice, so that no more than what is kept is in memory."""
    import pydicom

    nx, ny, nz = shape
    start = step // 2
    kept = tuple(len(range(start, side, step)) for side in (nz, ny, nx))
    out = np.empty(kept, dtype)
    for k in range(start, nz, step):
        try:
            with _quiet(), BoundedFile(files[k]) as stream:
                stored = pydicom.dcmread(stream).pixel_array.reshape(ny, nx)
        except (*DAMAGE, pydicom.errors.BytesLengthException) as error:
            raise InputError(
                f"{files[k]}: its pixels cannot be read ({reason_of(error)})"
            ) from None
        values = stored[start::step, start::step]
        out[k // step] = values if dtype.kind in "iu" else values * first.slope + first.intercept
    return Voxels(out.transpose(2, 1, 0))


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep pydicom's remarks on odd headers from the terminal; what matters is checked here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
