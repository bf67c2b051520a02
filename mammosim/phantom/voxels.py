"""Any voxel file as a volume in the breast frame."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError
from mammosim.phantom.chest_wall import find_axes, find_chest_wall
from mammosim.phantom.memory import MAX_REDUCED, check_memory
from mammosim.phantom.readers import Volume, VoxelFile, open_voxels
from mammosim.phantom.readers.axes import AXES_EXPECTED, are_axes, turn
from mammosim.phantom.readers.volume import checked_spacing
from mammosim.phantom.translate import whole_labels
from mammosim.tissues import DEFAULT_LABELS, LABEL_MAPS, decimals_of, in_whole_numbers

MIN_LENGTH_MM, MAX_LENGTH_MM = 5.0, 1000.0
"""Of a volume's longest side: shorter or longer ones are some other unit's. Chosen."""


def open_checked(path: str | Path, axes: str | None = None, reduce: int = 1) -> VoxelFile:
    """Read a file's header, and make sure of all that can be known before its voxels are read.

    Parameters
    ----------
    path, axes, reduce
        As in `read_volume`.

    Raises
    ------
    InputError
        If the file cannot be used or does not fit into memory.
    """
    opened = open_voxels(path)
    _check_wishes(opened, axes, reduce)
    if opened.dtype.kind not in "iufb":
        raise InputError(f"{path}: holds {opened.dtype} voxels, expected whole numbers")
    check_memory(opened, reduce)
    return opened


def read_volume(
    path: str | Path,
    axes: str | None = None,
    voxel_mm: ArrayLike | None = None,
    reduce: int = 1,
    label_map: Mapping[int, str] | None = None,
) -> Volume:
    """Read any known voxel file and turn it into the breast frame.

    Parameters
    ----------
    path : path
        A file, whose ending decides which reader is used, or the folder of a DICOM series.
    axes : str, optional
        Towards what the file's axes run, three letters as `ALS` (see `axes`), instead of what the
        file says or its voxels show.
    voxel_mm : float or (3,), optional
        Voxel size along the file's axes, mm, instead of what the file says.
    reduce : int
        Of every n voxels along each axis one is kept.
    label_map : mapping of int to str, optional
        Tissue of each value, for finding the chest wall; left out, what the file says, else
        mammosim's own.

    Raises
    ------
    InputError
        If the file cannot be used or does not fit into memory.

    Notes
    -----
    Keeping the middle voxel of each block keeps the share of every tissue, on average; a vote
    within the block would lose walls and ducts thinner than half of it.
    """
    opened = open_checked(path, axes, reduce)
    try:
        voxels = opened.load(reduce)
    except (OSError, MemoryError) as error:
        raise InputError(f"{path}: cannot be read ({error or 'no memory'})") from None
    spacing, notes = opened.voxel_mm, [*opened.notes, *voxels.notes]
    if voxel_mm is not None:
        given = np.asarray(voxel_mm, dtype=np.float64)
        spacing = checked_spacing(np.full(3, given) if given.ndim == 0 else given, opened.path)
    elif not opened.says_voxel:
        notes.append(
            f"{opened.path.name} does not give its voxel size: 1 mm was assumed where it is "
            f"missing; set phantom.voxel_mm"
        )
    if reduce > 1:
        notes.append(
            f"one voxel of {reduce} was kept along each axis: "
            f"{' x '.join(map(str, voxels.values.shape))} of {opened.count / 1e6:.4g} million"
        )
    tissue_of = label_map or opened.label_map or LABEL_MAPS[DEFAULT_LABELS]
    decimals = decimals_of(tissue_of)
    if decimals:
        tissue_of = in_whole_numbers(tissue_of, decimals)
        values = whole_labels(voxels.values, decimals, opened.path)
        voxels = voxels._replace(values=values)
    found = find_chest_wall(voxels.values, tissue_of)
    letters, orientation, remarks = _orientation(opened, axes, found)
    first = voxels.first_mm if voxels.first_mm is not None else opened.first_mm
    if first is None or letters != (opened.axes or letters):
        orientation += "; its corner voxel is at 0, since its position is not known"
        first = np.zeros(3)
    remarks += _size_remarks(opened, spacing)
    values, spacing, origin = turn(voxels.values, spacing, first, letters, reduce)
    return Volume(
        values, spacing, origin, orientation, opened.laterality,
        tissue_of if decimals else opened.label_map, (*notes, *remarks), opened.table, decimals,
    )  # fmt: skip


def _size_remarks(opened: VoxelFile, spacing_mm: NDArray[np.float64]) -> list[str]:
    """What is to be said of a volume that no breast fills, as where its unit is not the mm."""
    longest = float(max(spacing_mm * opened.shape))
    if MIN_LENGTH_MM <= longest <= MAX_LENGTH_MM:
        return []
    return [
        f"{opened.path.name} is {longest:.3g} mm long: if its voxel size is in another unit, set "
        f"phantom.voxel_mm in mm"
    ]


def _check_wishes(opened: VoxelFile, axes: str | None, reduce: int) -> None:
    problems = []
    if axes is not None and not are_axes(axes):
        problems.append(f"phantom.axes: found '{axes}', expected {AXES_EXPECTED}")
    most = min(MAX_REDUCED, *opened.shape)
    if not 1 <= reduce <= most:
        problems.append(
            f"phantom.reduce: found {reduce}, expected 1 to {most} for {opened.path.name} of "
            f"{' x '.join(map(str, opened.shape))} voxels"
        )
    if problems:
        raise InputError(problems)


def _orientation(
    opened: VoxelFile, given: str | None, found: tuple[int, int] | None
) -> tuple[str, str, list[str]]:
    """Letters of the axes, how they are known, and what the voxels say against it."""
    seen = find_axes(found)
    other = "say otherwise with phantom.axes"
    if given is not None:
        return given, f"axes run {given}, as given", []
    if opened.axes is None:
        how = "the chest wall and nipple were found" if found else "no chest wall was found"
        note = (
            f"{opened.path.name} does not give its axis directions: {how}, {seen} was assumed "
            f"(left and superior by their order); {other}"
        )
        return seen, f"axes run {seen}, from the voxels; {other}", [note]
    says = f"axes run {opened.axes} {opened.said_by}; {other}"
    if found is not None and opened.axes[found[0]] != ("A" if found[1] > 0 else "P"):
        note = (
            f"{opened.path.name}: its axes are {opened.axes} {opened.said_by}, but its chest wall "
            f"suggests {seen}: used as given; {other}"
        )
        return opened.axes, says, [note]
    return opened.axes, says, []
