"""Pieces of lesions in a volume, and which of them belong together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame

CLUSTER_MM = 10.0
"""Calcifications nearer than this to another belong to its cluster: grouped calcifications lie
within 1 cm of each other (ACR BI-RADS Atlas, Mammography, 5th edition, 2013, "Grouped")."""


MERGE_MM = 2.0
"""Pieces of masses nearer than this to each other are one lesion: spicules are thinner than a
voxel here and there, and break up. Chosen."""

MIN_VOLUME_MM3 = 0.05
"""Pieces of a mass smaller than this are crumbs of the nearest one: 47 of 48 in VICTRE's first
phantom with a lesion are, a ball of 0.46 mm. Chosen."""

MAX_PIECES = 5000
"""Of masses in a file, whose distances are looked at: a noisy segmentation has more."""

Voxels = NDArray[np.int64]
"""Indices of voxels, (n, 3)."""


def pieces_of(labels: NDArray[np.uint8], label: int) -> list[Voxels]:
    """Voxels of each piece of a label."""
    box = bounding_box(labels, label)
    if box is None:
        return []
    corner = np.array([side.start for side in box])
    pieces, _ = ndimage.label(labels[box] == label, np.ones((3, 3, 3)))
    index = np.argwhere(pieces)
    piece = pieces[tuple(index.T)]
    order = np.argsort(piece, kind="stable")
    return np.split(index[order] + corner, np.flatnonzero(np.diff(piece[order])) + 1)


def check_pieces(count: int, where: str) -> None:
    """Refuse more pieces than distances can be looked at of.

    Raises
    ------
    InputError
        With both numbers.
    """
    if count > MAX_PIECES:
        raise InputError(
            f"{where}: holds {count} separate pieces of masses, expected at most {MAX_PIECES}; "
            "remove small ones"
        )


def joined(pieces: Sequence[Voxels], group: NDArray[np.int32]) -> list[Voxels]:
    """Pieces of one group together, groups by number."""
    return [
        np.concatenate([pieces[int(member)] for member in np.flatnonzero(group == number)])
        for number in np.unique(group)
    ]


def merged(
    pieces: Sequence[Voxels],
    spacing_mm: NDArray[np.float64],
    merge_mm: float,
    min_volume_mm3: float,
) -> list[Voxels]:
    """Masses: pieces near each other, and with them the crumbs that are nearest."""
    groups = joined(pieces, _near_each_other(pieces, spacing_mm, merge_mm))
    volume = np.array([len(voxels) for voxels in groups]) * float(np.prod(spacing_mm))
    large = volume >= min_volume_mm3
    if not large.any() or large.all():
        return groups
    masses = [voxels for voxels, is_large in zip(groups, large, strict=True) if is_large]
    owner = np.repeat(np.arange(len(masses)), [len(voxels) for voxels in masses])
    tree = cKDTree(np.concatenate(masses) * spacing_mm)
    parts = [[voxels] for voxels in masses]
    for voxels, is_large in zip(groups, large, strict=True):
        if not is_large:
            distance, nearest = tree.query(voxels * spacing_mm)
            parts[owner[nearest[distance.argmin()]]].append(voxels)
    return [np.concatenate(part) for part in parts]


def _near_each_other(
    pieces: Sequence[Voxels], spacing_mm: NDArray[np.float64], gap_mm: float
) -> NDArray[np.int32]:
    """Group number of each piece; groups are joined by gaps up to a length.

    The gap of two pieces is that between the faces of their nearest voxels.
    """
    low = np.array([voxels.min(axis=0) for voxels in pieces]) * spacing_mm
    high = np.array([voxels.max(axis=0) + 1 for voxels in pieces]) * spacing_mm
    joined: list[tuple[int, int]] = []
    trees: dict[int, cKDTree] = {}
    reach = gap_mm + float(np.linalg.norm(spacing_mm))
    for first in range(len(pieces)):
        apart = np.maximum(low[first + 1 :] - high[first], low[first] - high[first + 1 :])
        near = np.linalg.norm(np.maximum(apart, 0.0), axis=1) <= gap_mm
        for second in first + 1 + np.flatnonzero(near):
            small, large = sorted((first, int(second)), key=lambda number: len(pieces[number]))
            if large not in trees:
                trees[large] = cKDTree(pieces[large] * spacing_mm)
            if _gap_mm(pieces[small], pieces[large], trees[large], spacing_mm, reach) <= gap_mm:
                joined.append((small, large))
    size = len(pieces)
    pairs = np.array(joined, dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    groups: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return groups


def _gap_mm(
    small: Voxels, large: Voxels, tree: cKDTree, spacing_mm: NDArray[np.float64], reach_mm: float
) -> float:
    """Gap between the faces of two pieces' nearest voxels, mm."""
    distance, nearest = tree.query(small * spacing_mm, distance_upper_bound=reach_mm)
    found = np.isfinite(distance)
    if not found.any():
        return float("inf")
    steps = np.abs(small[found] - large[nearest[found]])
    between = np.maximum(steps - 1, 0) * spacing_mm
    return float(np.linalg.norm(between, axis=1).min())


def merge_note(
    pieces: Sequence[Voxels], groups: Sequence[Voxels], spacing_mm: NDArray[np.float64]
) -> str:
    """One sentence that counts what was merged."""
    largest = max(len(voxels) for voxels in pieces) * float(np.prod(spacing_mm))
    total = sum(len(voxels) for voxels in pieces) * float(np.prod(spacing_mm))
    masses = "one lesion" if len(groups) == 1 else f"{len(groups)} lesions"
    return (
        f"{len(pieces)} pieces of mass were merged into {masses} (the largest piece has "
        f"{largest:.1f} of {total:.1f} mm3); see phantom.lesions_from_labels"
    )


def clusters(pieces: Sequence[Voxels], frame: VoxelFrame) -> NDArray[np.int32]:
    """Cluster number of each calcification."""
    centres_mm = np.array([voxels.mean(axis=0) for voxels in pieces]) * frame.spacing_mm
    pairs = cKDTree(centres_mm).query_pairs(CLUSTER_MM, output_type="ndarray")
    size = len(centres_mm)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    numbers: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return numbers


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
