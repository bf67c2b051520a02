"""From a voxel file to a breast phantom."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.errors import InputError
from mammosim.geometry import VIEW_NAMES, VoxelFrame
from mammosim.phantom.bodies import find_bodies
from mammosim.phantom.breast import BreastPhantom, CompressedState
from mammosim.phantom.cut_ends import Wish, find_open_end
from mammosim.phantom.found_lesions import named_lesions, number_lesions
from mammosim.phantom.label_table import LABELS_FILE
from mammosim.phantom.lesion_pieces import MERGE_MM, MIN_VOLUME_MM3
from mammosim.phantom.orientation import nipple_position, side_of_muscle
from mammosim.phantom.plate_labels import PLATE_LABEL, find_plates
from mammosim.phantom.readers import Volume
from mammosim.phantom.translate import count_values, translated
from mammosim.phantom.voxels import read_volume
from mammosim.tissues import DEFAULT_LABELS, LABEL_MAPS, TISSUES, load_label_map

SECOND_BREAST_SHARE = 0.3
"""Part of the largest body's volume above which a second body is not a speck but may be the other
breast: the smaller breast of a woman has more than this of the larger. Assumed."""


def read_phantom(
    path: str | os.PathLike[str],
    labels: str | None = None,
    laterality: Literal["L", "R"] | None = None,
    axes: str | None = None,
    voxel_mm: ArrayLike | None = None,
    reduce: int = 1,
    compressed_for: str | None = None,
    merge_mm: float = MERGE_MM,
    min_volume_mm3: float = MIN_VOLUME_MM3,
    open_end: Wish = "auto",
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
    compressed_for : {"CC", "MLO", "ML"}, optional
        View for which it was compressed before, z from the breast support to the paddle. Left out:
        what a volume of mammosim's own says.
    merge_mm, min_volume_mm3 : float
        Pieces of masses nearer than this to each other are one lesion, and pieces smaller than
        this belong to the nearest one.
    open_end : "auto", "none" or (3,)
        Where the breast is cut off though the body goes on, as towards the axilla: the way out
        there, breast frame; by default it is looked for.

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
    if compressed_for not in (None, *VIEW_NAMES):
        raise InputError(
            f"compressed_for: found '{compressed_for}', expected one of {', '.join(VIEW_NAMES)}"
        )
    given = None if labels is None else load_label_map(labels)
    volume = read_volume(path, axes, voxel_mm, reduce, given)
    label_map = given or volume.label_map or LABEL_MAPS[DEFAULT_LABELS]
    if volume.decimals and volume.label_map is not None:
        label_map = volume.label_map  # in whole numbers
    own = {} if volume.table is None else dict(volume.table.lesions)
    if volume.table is not None and given is not None:
        label_map = {**volume.table.tissue_of_value, **given}
        own = {value: lesion for value, lesion in own.items() if value not in given}
    voxels = _tissue_labels(volume, label_map, path, own)
    nx, ny, nz = voxels.shape
    frame = VoxelFrame(volume.origin_mm, volume.voxel_mm, (nx, ny, nz))
    held = _compressed_state(volume, frame, label_map, compressed_for, path)
    bodies = find_bodies(voxels)
    nipple_mm, labelled = nipple_position(voxels, frame, bodies.tip_index)
    # Between plates muscle is pressed aside: the wedge of a compressed breast tells no side.
    wedge = side_of_muscle(voxels, frame, nipple_mm) if held is None else None
    side, side_notes = _side(wedge, volume.laterality, laterality, held is not None)
    lesions = named_lesions(voxels, frame, own)
    rest = (merge_mm, min_volume_mm3)
    found, lesion_notes = number_lesions(voxels, frame, str(path), *rest, taken=own)
    lesions += found
    notes = [*volume.notes, *side_notes, *lesion_notes]
    if bodies.second_share > SECOND_BREAST_SHARE:
        notes.append(
            f"two bodies of tissue lie apart, one with {100.0 * bodies.second_share:.0f} % of the "
            "other's volume, possibly both breasts in one file; expected one breast: give each "
            "its own file, as phantom.file: {L: left.mhd, R: right.mhd}"
        )
    elif bodies.specks:
        notes.append(
            f"{bodies.specks} specks ({bodies.speck_voxels} voxels) are separate from the main "
            f"body; they were kept"
        )
    if not labelled:
        notes.append("no nipple is labelled: the most anterior tissue was used")
    end = None
    if held is None:
        end, end_notes = find_open_end(voxels, frame, nipple_mm, open_end)
        notes += end_notes
        if end is not None and volume.table is not None:
            end = replace(end, standing=volume.table.muscle_standing)
    tissue_of_label = {tissue.label: tissue.name for tissue in TISSUES.values()}
    tissue_of_label.update({lesion.label: lesion.tissue for lesion in lesions})
    return BreastPhantom(
        voxels, volume.voxel_mm, volume.origin_mm, side, tissue_of_label, nipple_mm, lesions,
        open_end=end, compressed=held, source=path.name, orientation=volume.orientation,
        notes=tuple(notes),
    )  # fmt: skip


def _compressed_state(
    volume: Volume,
    frame: VoxelFrame,
    label_map: Mapping[int, str],
    given: str | None,
    path: Path,
) -> CompressedState | None:
    """How plates hold the breast: by the file's own table, by their voxels, or as given."""
    table = volume.table
    if table is not None and table.compressed_for is not None:
        if given not in (None, table.compressed_for):
            raise InputError(
                f"phantom.compressed_for: found {given}, but {LABELS_FILE} beside {path.name} says "
                f"{table.compressed_for}"
            )
        return CompressedState(
            table.compressed_for, table.support_z_mm, table.paddle_z_mm, table.plate_edge_mm,
            table.end_side, table.end_points_mm,
        )  # fmt: skip
    plates = None
    if label_map.get(PLATE_LABEL) == "air":
        plates = find_plates(volume.values, frame)
    if plates is None:
        return None if given is None else CompressedState(given)
    return replace(plates, view=given)


def _side(
    wedge: str | None, said: str | None, given: str | None, compressed: bool
) -> tuple[str, list[str]]:
    """The side to use, and what is to be said about it."""
    side = given or said or wedge
    if side is None:
        why = "a compressed breast does not show" if compressed else "no muscle wedge tells"
        return "L", [f"{why} which breast it is: left was assumed; set laterality"]
    if given is None and said is None:
        name = {"L": "left", "R": "right"}[side]
        return side, [
            f"which breast it is was guessed from the muscle wedge: {name} was assumed; set "
            f"laterality"
        ]
    if said is not None and said != side:
        return side, [f"laterality {side} was given, but the file says {said}: used as given"]
    if wedge is not None and wedge != side:
        who = "was given" if given else "says the file"
        return side, [
            f"laterality {side} {who}, but the muscle wedge looks like {wedge}: used as given"
        ]
    return side, []


def _tissue_labels(
    volume: Volume, label_map: Mapping[int, str], path: Path, kept: Collection[int]
) -> NDArray[np.uint8]:
    """Labels of the tissue table, [x, y, z] with z contiguous, from the file's own values."""
    counts = count_values(volume.values, path)
    voxel_mm3 = float(np.prod(volume.voxel_mm))
    labels = translated(volume.values, counts, label_map, voxel_mm3, path, kept, volume.decimals)
    if all(label_map[value] == "air" for value in counts):
        raise InputError(f"{path}: holds no tissue, only labels {sorted(counts)} which are air")
    return labels
