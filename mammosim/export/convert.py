"""From one format of labelled volumes to another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.config import real_path
from mammosim.errors import InputError
from mammosim.export.voxel_files import writer_of
from mammosim.geometry import VoxelFrame
from mammosim.phantom import LABELS_FILE, Volume, count_values, open_voxels, read_volume, translated
from mammosim.tissues import load_label_map

NUMBER_TYPES = (np.uint8, np.int8, np.uint16, np.int16, np.int32)
"""The first that holds all labels is taken: bytes where they do, as most programs expect."""


@dataclass(frozen=True)
class Conversion:
    """What was converted.

    Parameters
    ----------
    frame : VoxelFrame
        Where the voxels are, breast frame, mm.
    counts : dict of int to int
        How often each written label occurs.
    orientation : str
        How the source's axes were taken to lie, in words.
    notes : tuple of str
        What was assumed or mended.
    """

    frame: VoxelFrame
    counts: dict[int, int]
    orientation: str
    notes: tuple[str, ...]


def convert_volume(
    source: str | PathLike[str],
    target: str | PathLike[str],
    labels: str | None = None,
    axes: str | None = None,
    voxel_mm: ArrayLike | None = None,
    reduce: int = 1,
) -> Conversion:
    """Read a labelled volume and write it in another format, voxel by voxel at the same place.

    Parameters
    ----------
    source : path
        Any file that `read_phantom` reads.
    target : path
        Its ending says the format (`WRITERS`); what is there is replaced.
    labels : str, optional
        Label map by which values become mammosim's own labels; left out, values stay as they are,
        but for those that are no whole numbers.
    axes, voxel_mm, reduce
        As in `read_phantom`.

    Raises
    ------
    InputError
        If the source cannot be used or the target cannot be written.
    """
    source, target = Path(source), Path(target)
    write = writer_of(target)
    _check_other_files(source, target)
    label_map: Mapping[Any, str] | None = None if labels is None else load_label_map(labels)
    volume = read_volume(source, axes, voxel_mm, reduce, label_map)
    if volume.decimals:
        label_map = volume.label_map  # in whole numbers
    counts = count_values(volume.values, source)
    if label_map is None:
        values = _in_fewest_bits(volume, counts, source)
    else:
        voxel_mm3 = float(np.prod(volume.voxel_mm))
        values = translated(
            volume.values, counts, label_map, voxel_mm3, source, decimals=volume.decimals
        )
        counts = count_values(values, source)
    nx, ny, nz = values.shape
    frame = VoxelFrame(volume.origin_mm, volume.voxel_mm, (nx, ny, nz))
    write(values, frame, target)
    notes = volume.notes
    if volume.table is not None:
        notes = (
            *notes,
            f"{LABELS_FILE} beside {source.name} (side, view, plates, lesions) was not converted: "
            f"set laterality, phantom.compressed_for and phantom.labels",
        )
    return Conversion(frame, counts, volume.orientation, notes)


def _check_other_files(source: Path, target: Path) -> None:
    """The source's own files must not be written over while they are read."""
    mine = {real_path(file) for file in open_voxels(source).files}
    beside = target.with_name(f"{target.name.removesuffix(target.suffix)}.raw.gz")
    written = (target, beside) if target.suffix == ".mhd" else (target,)
    others = {real_path(file) for file in written}
    if mine & others or real_path(target) == real_path(source):
        raise InputError(f"{target}: is the source itself; give another name")


def _in_fewest_bits(
    volume: Volume, counts: dict[int, int], source: Path
) -> NDArray[np.integer[Any]]:
    lowest, highest = min(counts), max(counts)
    for number_type in NUMBER_TYPES:
        info = np.iinfo(number_type)
        if info.min <= lowest and highest <= info.max:
            return volume.values.astype(number_type, copy=False)
    raise InputError(f"{source}: labels from {lowest} to {highest} do not fit into 32 bits")
