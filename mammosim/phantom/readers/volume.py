"""What every reader returns: first the header alone, then the voxels in the breast frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError
from mammosim.phantom.label_table import LabelTable

MAX_DEFLATE_RATIO = 1032
"""Deflate's greatest compression (zlib technical details): a header that promises more lies."""

MIN_MM, MAX_MM = 1e-6, 1e3
"""Of a voxel: far beyond any phantom in either direction, even with its size in metres or nm."""

MAX_ORIGIN_MM = 1e6
"""Largest coordinate of the first voxel: scanners give up to a few metres, and double precision
still resolves 1e-10 mm there."""


class Voxels(NamedTuple):
    """Voxels as they are in the file.

    Parameters
    ----------
    values : ndarray, [i, j, k]
        Along the file's own axes; may be a strided view.
    first_mm : ndarray, (3,), optional
        Centre of voxel [0, 0, 0] in the breast frame, mm, where it is known only now.
    notes : tuple of str
        What was assumed or mended while reading them.
    """

    values: NDArray[Any]
    first_mm: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class VoxelFile:
    """A voxel file whose header was read and held against its length; no voxel was read yet.

    Parameters
    ----------
    path : path
    shape : tuple of int
        Voxels along the file's own axes i, j, k.
    voxel_mm : ndarray, (3,)
        Voxel size along i, j, k, mm; 1 where the file does not say.
    dtype : dtype
        Of the values in the file.
    load : callable
        Gives `Voxels`: every n-th voxel along each axis, the first at n // 2, for a given n.
    axes : str or None
        Letters of i, j, k (see `axes`); None where neither the file nor its format says.
    said_by : str
        By whom it is said how the axes lie, in words.
    says_voxel : bool
        Whether the file says its voxel size.
    first_mm : ndarray, (3,), or None
        Centre of voxel [0, 0, 0] of the file, breast frame, mm; None where the file does not say.
    whole_copies : int
        How often all voxels are in memory while they are loaded, whatever n is.
    laterality : {"L", "R"} or None
        Which breast it is, where the file says.
    label_map : mapping of int to str, optional
        What each value stands for, where the file says.
    notes : tuple of str
        What was assumed or mended.
    files : tuple of path
        The files it consists of; the path alone where left out.
    table : LabelTable, optional
        Of a volume that mammosim wrote: what its values stand for, and how it was held.
    """

    path: Path
    shape: tuple[int, int, int]
    voxel_mm: NDArray[np.float64]
    dtype: np.dtype[Any]
    load: Callable[[int], Voxels]
    axes: str | None = None
    said_by: str = ""
    says_voxel: bool = True
    first_mm: NDArray[np.float64] | None = None
    whole_copies: int = 0
    laterality: str | None = None
    label_map: Mapping[int, str] | None = None
    notes: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    table: LabelTable | None = None

    @property
    def count(self) -> int:
        """Number of voxels."""
        nx, ny, nz = self.shape
        return nx * ny * nz


@dataclass(frozen=True, eq=False)
class Volume:
    """Voxels of a file, turned into the breast frame.

    Parameters
    ----------
    values : ndarray, [x, y, z]
        Values as in the file, axes along the breast frame's; may be a strided view.
    voxel_mm : ndarray, (3,)
        Voxel size, mm.
    origin_mm : ndarray, (3,)
        Centre of voxel [0, 0, 0], breast frame, mm.
    orientation : str
        How the file's axes were taken to lie, in words.
    laterality : {"L", "R"} or None
        Which breast it is, where the file says.
    label_map : mapping of int to str, optional
        What each value stands for, where the file says.
    notes : tuple of str
        What was assumed or mended.
    table : LabelTable, optional
        Of a volume that mammosim wrote.
    decimals : int
        Where the labels are no whole numbers, their decimals: `values` and `label_map` are 10 to
        that power times the file's.
    """

    values: NDArray[Any]
    voxel_mm: NDArray[np.float64]
    origin_mm: NDArray[np.float64]
    orientation: str = ""
    laterality: str | None = None
    label_map: Mapping[int, str] | None = None
    notes: tuple[str, ...] = ()
    table: LabelTable | None = None
    decimals: int = 0


def checked_shape(shape: ArrayLike, path: Path) -> tuple[int, int, int]:
    """Three sides, refused unless each is at least one voxel."""
    sides = [int(side) for side in np.asarray(shape, dtype=object).ravel()]
    if len(sides) != 3 or min(sides) < 1:
        raise InputError(f"{path}: its size is {sides} voxels, expected three sides of 1 or more")
    return sides[0], sides[1], sides[2]


def checked_spacing(spacing_mm: ArrayLike, path: Path) -> NDArray[np.float64]:
    """(3,) voxel size, refused unless positive and of this world."""
    spacing = np.asarray(spacing_mm, dtype=np.float64)
    # Not (< least), so that NaN is refused too.
    if spacing.shape != (3,) or not ((spacing >= MIN_MM) & (spacing <= MAX_MM)).all():
        raise InputError(
            f"{path}: voxel size is {np.asarray(spacing_mm).tolist()} mm, expected three positive "
            f"numbers from {MIN_MM:g} to {MAX_MM:g}"
        )
    return spacing


def checked_origin(origin_mm: ArrayLike, path: Path) -> NDArray[np.float64]:
    """(3,) position of the first voxel, refused if not finite or too far from the origin."""
    origin = np.asarray(origin_mm, dtype=np.float64)
    if origin.shape != (3,) or not (np.abs(origin) <= MAX_ORIGIN_MM).all():
        raise InputError(
            f"{path}: origin is {np.asarray(origin_mm).tolist()} mm, expected three numbers from "
            f"{-MAX_ORIGIN_MM:g} to {MAX_ORIGIN_MM:g}"
        )
    return origin


def check_promise(promised: int, on_disk: int, ratio: float, path: Path) -> None:
    """Refuse a header that promises more bytes of voxels than the file can hold.

    Parameters
    ----------
    promised : int
        Bytes of voxels by the header.
    on_disk : int
        Bytes in the file that can hold them.
    ratio : float
        Greatest compression of the file's coding; 1 where it has none.
    path : path
        For messages.
    """
    if promised > on_disk * ratio:
        raise InputError(
            f"{path}: {on_disk} bytes cannot hold the {promised} bytes of voxels that the header "
            "promises; truncated or damaged"
        )


def every_nth(values: NDArray[Any], step: int) -> NDArray[Any]:
    """View of every n-th voxel along each axis, the middle one of each block."""
    start = step // 2
    return values[start::step, start::step, start::step] if step > 1 else values


def reason_of(error: Exception) -> str:
    """The first line of a library's error, or its name where it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0]
