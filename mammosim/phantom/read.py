"""From a voxel file to a breast phantom."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.bodies import find_bodies
from mammosim.phantom.breast import BreastPhantom
from mammosim.phantom.found_lesions import number_lesions
from mammosim.phantom.orientation import nipple_position, side_of_muscle
from mammosim.phantom.readers import Volume, read_volume
from mammosim.tissues import TISSUES, load_label_map

BLOCK_LAYERS = 32
"""Layers turned and mapped at a time: a block of a large phantom stays within 10 MB."""


def read_phantom(
    path: str | os.PathLike[str], labels: str | None = None, laterality: str | None = None
) -> BreastPhantom:
    """Read a labelled voxel breast.

    Parameters
    ----------
    path : path
        MHD with its raw file, MHA, NRRD, NIfTI, NPY, NPZ, or the thesis' own BIN.
    labels : str, optional
        Name of a label map, or path of a YAML file with one; mammosim's own by default.
    laterality : {"L", "R"}, optional
        Which breast it is. Left out: what the muscle wedge shows, else L. It never mirrors.

    Returns
    -------
    BreastPhantom
        In the file's own physical coordinates. Each mass, cluster of calcifications and clip in
        it is a lesion with its own label.

    Raises
    ------
    InputError
        If the file cannot be used; the message says what was found and what is allowed.

    Notes
    -----
    Nothing is deleted: specks of tissue apart from the main body stay, and are noted.
    """
    path = Path(path)
    if laterality not in (None, "L", "R"):
        raise InputError(f"laterality: found '{laterality}', expected L or R")
    label_map = load_label_map(labels or "mammosim")
    volume = read_volume(path)
    voxels = _tissue_labels(volume, label_map, path)
    nx, ny, nz = voxels.shape
    frame = VoxelFrame(volume.origin_mm, volume.voxel_mm, (nx, ny, nz))
    bodies = find_bodies(voxels)
    nipple_mm, labelled = nipple_position(voxels, frame, bodies.tip_index)
    side, side_notes = _side(side_of_muscle(voxels, frame, nipple_mm), laterality)
    lesions = number_lesions(voxels, frame, str(path))
    notes = [*volume.notes, *side_notes]
    if bodies.specks:
        notes.append(
            f"{bodies.specks} specks ({bodies.speck_voxels} voxels) lie apart from the main body; "
            "they were kept"
        )
    if not labelled:
        notes.append("no nipple is labelled: the most anterior tissue was taken for it")
    tissue_of_label = {tissue.label: tissue.name for tissue in TISSUES.values()}
    tissue_of_label.update({lesion.label: lesion.tissue for lesion in lesions})
    return BreastPhantom(
        voxels, volume.voxel_mm, volume.origin_mm, side, tissue_of_label, nipple_mm, lesions,
        source=path.name, notes=tuple(notes),
    )  # fmt: skip


def _side(seen: str | None, given: str | None) -> tuple[str, list[str]]:
    """The side to use, and what is to be said about it."""
    if given is None:
        if seen is None:
            return "L", ["no muscle wedge tells which breast it is: left was taken"]
        return seen, []
    if seen is not None and seen != given:
        return given, [
            f"laterality {given} was given, but the muscle wedge looks like {seen}: taken as given"
        ]
    return given, []


def _tissue_labels(volume: Volume, label_map: Mapping[int, str], path: Path) -> NDArray[np.uint8]:
    """Labels of the tissue table, [x, y, z] with z contiguous, from the file's own values."""
    values = volume.values
    if values.dtype.kind not in "iufb":
        raise InputError(f"{path}: holds {values.dtype} voxels, expected whole numbers")
    if values.size == 0:
        raise InputError(f"{path}: its shape is {values.shape}, expected at least one voxel")
    counts = _count_values(values, path)
    _check_known(counts, label_map, float(np.prod(volume.voxel_mm)), path)
    if all(label_map[value] == "air" for value in counts):
        raise InputError(f"{path}: holds no tissue, only labels {sorted(counts)} which are air")
    table = np.zeros(256, np.uint8)
    for value in counts:
        if 0 <= value < 256:
            table[value] = TISSUES[label_map[value]].label
    out = np.empty(values.shape, np.uint8)
    for start in range(0, values.shape[2], BLOCK_LAYERS):
        block = values[:, :, start : start + BLOCK_LAYERS]
        if max(counts) < 256 and min(counts) >= 0:
            mapped = table[block.astype(np.uint8, copy=False)]
        else:
            mapped = np.zeros(block.shape, np.uint8)
            for value in counts:
                mapped[block == value] = TISSUES[label_map[value]].label
        out[:, :, start : start + BLOCK_LAYERS] = mapped
    return out


def _count_values(values: NDArray[Any], path: Path) -> dict[int, int]:
    """How often each value occurs; refused unless whole."""
    counts: dict[int, int] = {}
    for start in range(0, values.shape[2], BLOCK_LAYERS):
        block = values[:, :, start : start + BLOCK_LAYERS]
        if block.dtype == np.uint8:
            found = np.bincount(block.ravel(order="K"), minlength=256)
            pairs = [(int(value), int(found[value])) for value in np.flatnonzero(found)]
        else:
            each, how_many = np.unique(block, return_counts=True)
            if each.dtype.kind == "f" and not (np.isfinite(each) & (each == np.rint(each))).all():
                odd = each[~(np.isfinite(each) & (each == np.rint(each)))][0]
                raise InputError(f"{path}: holds the value {odd}, expected whole-number labels")
            pairs = [(int(v), int(n)) for v, n in zip(each, how_many, strict=True)]
        for value, number in pairs:
            counts[value] = counts.get(value, 0) + number
        if len(counts) > 4096:
            raise InputError(f"{path}: holds over 4096 different values, expected tissue labels")
    return counts


def _check_known(
    counts: dict[int, int], label_map: Mapping[int, str], voxel_mm3: float, path: Path
) -> None:
    unknown = [value for value in sorted(counts) if value not in label_map]
    if not unknown:
        return
    known = ", ".join(f"{label} {tissue}" for label, tissue in label_map.items())
    shown = [
        f"{path}: label {value} ({counts[value] * voxel_mm3 / 1000:.3g} mL) is not in the label map"
        for value in unknown[:20]
    ]
    if len(unknown) > 20:
        shown.append(f"{path}: and {len(unknown) - 20} more labels that are not in the label map")
    raise InputError([*shown, f"{path}: known labels: {known}"])
