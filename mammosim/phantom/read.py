"""From a voxel file to a breast phantom."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.bodies import find_bodies
from mammosim.phantom.breast import BreastPhantom
from mammosim.phantom.found_lesions import number_lesions
from mammosim.phantom.orientation import nipple_position, side_of_muscle
from mammosim.phantom.readers import Volume
from mammosim.phantom.translate import count_values, translated
from mammosim.phantom.voxels import read_volume
from mammosim.tissues import DEFAULT_LABELS, LABEL_MAPS, TISSUES, load_label_map


def read_phantom(
    path: str | os.PathLike[str],
    labels: str | None = None,
    laterality: Literal["L", "R"] | None = None,
    axes: str | None = None,
    voxel_mm: ArrayLike | None = None,
    reduce: int = 1,
) -> BreastPhantom:
    """Read a labelled voxel breast.

    Parameters
    ----------
    path : path
        MHD with its raw file, MHA, NRRD, NIfTI, multi-page TIFF, OpenVCT's VCTX, NPY, NPZ, the
        thesis' own BIN, or the folder of a DICOM series.
    labels : str, optional
        Name of a label map, or path of a YAML file with one; left out, what the file itself says
        (VCTX), else mammosim's own.
    laterality : {"L", "R"}, optional
        Which breast it is. Left out: what the file says, else what the muscle wedge shows, else L.
        It never mirrors.
    axes : str, optional
        Towards what the file's axes run, as ``ALS``, instead of what the file says or shows.
    voxel_mm : float or (3,), optional
        Voxel size along the file's axes, mm, instead of what the file says.
    reduce : int
        Of every n voxels along each axis one is kept.

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
    given = None if labels is None else load_label_map(labels)
    volume = read_volume(path, axes, voxel_mm, reduce, given)
    voxels = _tissue_labels(volume, given or volume.label_map or LABEL_MAPS[DEFAULT_LABELS], path)
    nx, ny, nz = voxels.shape
    frame = VoxelFrame(volume.origin_mm, volume.voxel_mm, (nx, ny, nz))
    bodies = find_bodies(voxels)
    nipple_mm, labelled = nipple_position(voxels, frame, bodies.tip_index)
    wedge = side_of_muscle(voxels, frame, nipple_mm)
    side, side_notes = _side(wedge, volume.laterality, laterality)
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
        source=path.name, orientation=volume.orientation, notes=tuple(notes),
    )  # fmt: skip


def _side(wedge: str | None, said: str | None, given: str | None) -> tuple[str, list[str]]:
    """The side to use, and what is to be said about it."""
    side = given or said or wedge
    if side is None:
        return "L", ["no muscle wedge tells which breast it is: left was taken"]
    if said is not None and said != side:
        return side, [f"laterality {side} was given, but the file says {said}: taken as given"]
    if wedge is not None and wedge != side:
        who = "was given" if given else "says the file"
        return side, [
            f"laterality {side} {who}, but the muscle wedge looks like {wedge}: taken as given"
        ]
    return side, []


def _tissue_labels(volume: Volume, label_map: Mapping[int, str], path: Path) -> NDArray[np.uint8]:
    """Labels of the tissue table, [x, y, z] with z contiguous, from the file's own values."""
    counts = count_values(volume.values, path)
    labels = translated(volume.values, counts, label_map, float(np.prod(volume.voxel_mm)), path)
    if all(label_map[value] == "air" for value in counts):
        raise InputError(f"{path}: holds no tissue, only labels {sorted(counts)} which are air")
    return labels
