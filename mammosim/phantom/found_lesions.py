"""Lesions that a file brings along: each gets a label of its own."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom.breast import Lesion
from mammosim.phantom.lesion_kinds import LESION_KINDS, lesion_tissues
from mammosim.tissues import LESION_LABELS, TISSUES

CLUSTER_MM = 10.0
"""Calcifications nearer than this to another belong to its cluster: grouped calcifications lie
within 1 cm of each other (ACR BI-RADS Atlas, Mammography, 5th edition, 2013, "Grouped")."""


def number_lesions(labels: NDArray[np.uint8], frame: VoxelFrame, where: str) -> tuple[Lesion, ...]:
    """Give every mass, cluster of calcifications and clip its own label, in place.

    Masses and clips are pieces joined by face, edge or corner; calcifications are gathered into
    clusters. Within a kind the largest comes first.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Changed in place.
    frame : VoxelFrame
    where : str
        File name, for messages.

    Raises
    ------
    InputError
        If there are more lesions than labels for them.
    """
    kinds = lesion_tissues()
    found = [
        (kind, voxels)
        for kind in kinds.values()
        for voxels in _lesions_of_kind(labels, frame, kind)
    ]
    if len(found) > len(LESION_LABELS):
        raise InputError(
            f"{where}: holds {len(found)} separate lesions, at most {len(LESION_LABELS)} can be "
            "told apart; merge or remove small ones"
        )
    lesions, number = [], dict.fromkeys(kinds.values(), 0)
    for (kind, voxels), label in zip(found, LESION_LABELS, strict=False):
        number[kind] += 1
        labels[tuple(voxels.T)] = label
        volume = len(voxels) * float(np.prod(frame.spacing_mm))
        centre = frame.position_mm(voxels.mean(axis=0))
        lesions.append(Lesion(f"{kind} {number[kind]}", kind, label, kind, centre, volume))
    return tuple(lesions)


def _lesions_of_kind(
    labels: NDArray[np.uint8], frame: VoxelFrame, kind: str
) -> list[NDArray[np.int64]]:
    """Voxel indices (n, 3) of each lesion of a kind, largest first."""
    box = bounding_box(labels, TISSUES[kind].label)
    if box is None:
        return []
    corner = np.array([side.start for side in box])
    pieces, count = ndimage.label(labels[box] == TISSUES[kind].label, np.ones((3, 3, 3)))
    index = np.argwhere(pieces)
    piece = pieces[tuple(index.T)] - 1
    if LESION_KINDS[kind].clustered:
        centres = np.array(
            [np.bincount(piece, index[:, axis], count) for axis in range(3)]
        ).T / np.bincount(piece, minlength=count).reshape(-1, 1)
        piece = _clusters(centres * frame.spacing_mm)[piece]
    order = np.argsort(piece, kind="stable")
    groups = np.split(index[order] + corner, np.flatnonzero(np.diff(piece[order])) + 1)
    return sorted(groups, key=len, reverse=True)


def bounding_box(labels: NDArray[np.uint8], label: int) -> tuple[slice, ...] | None:
    """Smallest box around a label or None, layer by layer, so that no mask of the whole is made."""
    layers, rows, columns = [], [], []
    for layer, plane in enumerate(labels):
        mask = plane == label
        if mask.any():
            layers.append(layer)
            rows.append(_ends(np.flatnonzero(mask.any(axis=1))))
            columns.append(_ends(np.flatnonzero(mask.any(axis=0))))
    if not layers:
        return None
    sides = (layers, [v for ends in rows for v in ends], [v for ends in columns for v in ends])
    return tuple(slice(int(min(side)), int(max(side)) + 1) for side in sides)


def _ends(values: NDArray[np.intp]) -> Iterable[int]:
    return int(values[0]), int(values[-1])


def _clusters(centres_mm: NDArray[np.float64]) -> NDArray[np.int32]:
    """Cluster number of each calcification (n, 3)."""
    pairs = cKDTree(centres_mm).query_pairs(CLUSTER_MM, output_type="ndarray")
    size = len(centres_mm)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    numbers: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return numbers
