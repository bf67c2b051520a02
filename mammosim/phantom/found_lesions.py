"""Lesions that a file brings along: each gets a label of its own."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.breast import Lesion
from mammosim.phantom.label_table import LabelledLesion
from mammosim.phantom.lesion_kinds import LESION_KINDS, lesion_tissues
from mammosim.phantom.lesion_pieces import (
    MERGE_MM,
    MIN_VOLUME_MM3,
    bounding_box,
    check_pieces,
    clusters,
    joined,
    merge_note,
    merged,
    pieces_of,
)
from mammosim.tissues import LESION_LABELS, TISSUES


def named_lesions(
    labels: NDArray[np.uint8], frame: VoxelFrame, named: Mapping[int, LabelledLesion]
) -> tuple[Lesion, ...]:
    """Lesions whose names and labels the file itself says.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
    frame : VoxelFrame
    named : mapping of int to LabelledLesion
        By label; those without a voxel are left out.
    """
    lesions = []
    for label, entry in sorted(named.items()):
        box = bounding_box(labels, label)
        if box is None:
            continue
        corner = np.array([side.start for side in box])
        voxels = np.argwhere(labels[box] == label) + corner
        centre = frame.position_mm(voxels.mean(axis=0))
        volume = entry.fill * len(voxels) * float(np.prod(frame.spacing_mm))
        tissue = LESION_KINDS[entry.kind].tissue
        lesions.append(Lesion(entry.name, entry.kind, label, tissue, centre, volume, entry.fill))
    return tuple(lesions)


def number_lesions(
    labels: NDArray[np.uint8],
    frame: VoxelFrame,
    where: str,
    merge_mm: float = MERGE_MM,
    min_volume_mm3: float = MIN_VOLUME_MM3,
    taken: Collection[int] = (),
) -> tuple[tuple[Lesion, ...], tuple[str, ...]]:
    """Give every mass, cluster of calcifications and clip its own label, in place.

    Pieces are voxels joined by face, edge or corner. Masses are pieces that lie near each other,
    and crumbs with the nearest of them; calcifications are gathered into clusters; every clip is
    one. Within a kind the largest comes first.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Changed in place.
    frame : VoxelFrame
    where : str
        File name, for messages.
    merge_mm, min_volume_mm3 : float
        Gap up to which pieces of masses are one lesion, and volume below which a piece is a crumb;
        0 merges nothing.
    taken : collection of int
        Labels that other lesions have.

    Returns
    -------
    lesions : tuple of Lesion
    notes : tuple of str
        How many pieces were merged.

    Raises
    ------
    InputError
        If there are more lesions than labels for them.
    """
    free = [label for label in LESION_LABELS if label not in taken]
    found, notes = [], []
    kinds = lesion_tissues()
    for tissue, kind in kinds.items():
        pieces = pieces_of(labels, TISSUES[tissue].label)
        groups = pieces
        if LESION_KINDS[kind].clustered and pieces:
            groups = joined(pieces, clusters(pieces, frame))
        elif LESION_KINDS[kind].crumbles and len(pieces) > 1:
            check_pieces(len(pieces), where)
            groups = merged(pieces, frame.spacing_mm, merge_mm, min_volume_mm3)
            if len(groups) < len(pieces):
                notes.append(merge_note(pieces, groups, frame.spacing_mm))
        found += [(kind, voxels) for voxels in sorted(groups, key=len, reverse=True)]
    if len(found) > len(free):
        raise InputError(
            f"{where}: holds {len(found)} separate lesions, at most {len(free)} can be "
            f"distinguished; merge or remove small ones (phantom.lesions_from_labels)"
        )
    lesions, number = [], dict.fromkeys(kinds.values(), 0)
    for (kind, voxels), label in zip(found, free, strict=False):
        number[kind] += 1
        labels[tuple(voxels.T)] = label
        volume = len(voxels) * float(np.prod(frame.spacing_mm))
        centre = frame.position_mm(voxels.mean(axis=0))
        lesions.append(Lesion(f"{kind} {number[kind]}", kind, label, kind, centre, volume))
    return tuple(lesions), tuple(notes)
