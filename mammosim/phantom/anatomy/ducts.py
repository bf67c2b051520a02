"""Lobes: duct trees that start in the nipple, divide, and end in lobular units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.outline import mesh
from mammosim.phantom.anatomy.tubes import Piece
from mammosim.tissues import TISSUES

LOBES = (11, 19)
"""Fewest and most lobes, one a duct that opens in the nipple: 15 to 20 in textbooks, mean 9 active
ones by ultrasound (Ramsay et al. 2005, J Anat 206:525-534) and over 15 in sections."""

DUCT_MM = (0.9, 0.22)
"""Radius of a duct near the nipple and far from it, mm: main ducts are about 2 mm wide
(Ramsay et al. 2005); the narrow end is a choice."""

NARROWS_OVER_MM = 22.0
"""Way along which a duct's radius falls by a factor e, mm. Chosen."""

UNIT_MM = (0.5, 1.0)
"""Radius of a terminal ductal lobular unit, mm: units are 1 to 2 mm across."""

PIECE_MM = 3.0
"""Longest straight piece of a duct, mm."""

BEND = 0.13
"""How far a branch leaves the straight line, of its length. Chosen."""

BACK = 1.35
"""How much a way within the tree counts against a new branch of the same length: above 1 makes
branches leave early and run beside each other, as ducts of one lobe do. Chosen."""


@dataclass(frozen=True, eq=False)
class DuctTrees:
    """The ducts of all lobes.

    Parameters
    ----------
    pieces : list of Piece
        Ducts and lobular units.
    nodes_mm : ndarray, (n, 3)
        Ends of all duct pieces, generator coordinates, mm.
    lobe : ndarray of int, (n,)
        Lobe of each.
    """

    pieces: list[Piece]
    nodes_mm: NDArray[np.float64]
    lobe: NDArray[np.int64]


def grow_ducts(
    room: NDArray[np.float64],
    frame: VoxelFrame,
    nipple_mm: NDArray[np.float64],
    units_a_lobe: float,
    rng: np.random.Generator,
) -> DuctTrees:
    """Trees that fill the room that glandular tissue has.

    Parameters
    ----------
    room : ndarray, [x, lateral, superior]
        Positive where glandular tissue may be; ends are the denser, the larger it is.
    frame : VoxelFrame
    nipple_mm : ndarray, (2,)
        x of the nipple's foot and of its tip, mm.
    units_a_lobe : float
        Mean number of terminal units of a lobe.
    rng : Generator

    Notes
    -----
    Ends are drawn in the room and dealt out to lobes by their direction from the nipple. Each
    tree grows from the nipple by joining the next end, near ones first, to that node of the tree
    from which the way to the nipple, old and new, is shortest with the old part counting 1/BACK.
    """
    lobes = int(rng.integers(LOBES[0], LOBES[1] + 1))
    ends = _ends(room, frame, int(lobes * units_a_lobe), rng)
    directions = _directions(lobes, rng)
    lobe_of = _nearest_direction(ends, nipple_mm[0], directions)
    pieces: list[Piece] = []
    nodes, members = [], []
    for lobe in range(lobes):
        grown, places = _tree(ends[lobe_of == lobe], directions[lobe], nipple_mm, rng)
        pieces += grown
        nodes.append(places)
        members.append(np.full(len(places), lobe))
    return DuctTrees(pieces, np.concatenate(nodes), np.concatenate(members))


def tree_distance(
    trees: DuctTrees, room: NDArray[np.float64], frame: VoxelFrame
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distance to the nearest duct, mm, and the lobe it belongs to, on the coarse grid.

    Far from where gland may be the distance is 30 mm and the lobe the first.
    """
    inside = room > -2.0
    x, lateral, superior = np.broadcast_arrays(*mesh(frame))
    points = np.stack([x[inside], lateral[inside], superior[inside]], axis=-1)
    gap, nearest = cKDTree(trees.nodes_mm).query(points, distance_upper_bound=30.0)
    distance, lobe = np.full(room.shape, 30.0), np.zeros(room.shape, np.int64)
    distance[inside] = np.minimum(gap, 30.0)
    lobe[inside] = np.append(trees.lobe, 0)[nearest]
    return distance, lobe


def _ends(
    room: NDArray[np.float64], frame: VoxelFrame, number: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Random points, likelier where there is more room, (n, 3) mm."""
    weight = np.clip(room, 0.0, 1.0).ravel() ** 1.5
    total = np.cumsum(weight)
    drawn = np.searchsorted(total, rng.random(number) * total[-1])
    index = np.stack(np.unravel_index(drawn, room.shape), axis=-1)
    return frame.position_mm(index + rng.uniform(-0.5, 0.5, index.shape))


def _directions(lobes: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n, 2) tangents of the lobes' angles from straight back, evenly spread but jittered."""
    order = np.arange(lobes)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * order + rng.uniform(0.0, 2.0 * np.pi)
    spread = 1.3 * np.sqrt((order + 0.5) / lobes)
    jitter = 0.12 * rng.standard_normal((lobes, 2))
    return np.stack([spread * np.cos(angle), spread * np.sin(angle)], axis=-1) + jitter


def _nearest_direction(
    points_mm: NDArray[np.float64], foot_mm: float, directions: NDArray[np.float64]
) -> NDArray[np.int64]:
    behind = np.maximum(foot_mm + 8.0 - points_mm[:, 0], 8.0)
    seen = points_mm[:, 1:] / behind[:, None]
    gap: NDArray[np.float64] = np.linalg.norm(seen[:, None] - directions, axis=-1)
    return gap.argmin(axis=1)


def _tree(
    ends_mm: NDArray[np.float64],
    direction: NDArray[np.float64],
    nipple_mm: NDArray[np.float64],
    rng: np.random.Generator,
) -> tuple[list[Piece], NDArray[np.float64]]:
    """Pieces and nodes of one lobe: through the nipple, then from branch to branch."""
    foot, tip = nipple_mm
    out = np.array([0.0, *direction]) / 1.3
    opening = np.array([tip - 0.5, 0.0, 0.0]) + 2.0 * out
    sinus = np.array([foot - 4.0, 0.0, 0.0]) + 3.0 * out
    label = TISSUES["duct"].label
    pieces: list[Piece] = [(opening, sinus, 0.5, DUCT_MM[0], label)]
    nodes, ways = sinus[None], np.zeros(1)
    for end in ends_mm[np.argsort(np.linalg.norm(ends_mm - sinus, axis=1))]:
        gap = np.linalg.norm(nodes - end, axis=1)
        start = int(np.argmin(gap + ways / BACK))
        path = _path(nodes[start], end, rng)
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        way = ways[start] + np.concatenate([[0.0], np.cumsum(lengths)])
        radius = DUCT_MM[1] + (DUCT_MM[0] - DUCT_MM[1]) * np.exp(-way / NARROWS_OVER_MM)
        pieces += [
            (path[n], path[n + 1], radius[n], radius[n + 1], label) for n in range(len(lengths))
        ]
        nodes, ways = np.concatenate([nodes, path[1:]]), np.concatenate([ways, way[1:]])
        pieces += _unit(end, rng)
    return pieces, nodes


def _path(
    start: NDArray[np.float64], end: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """A curved line in pieces of at most `PIECE_MM`, (n, 3)."""
    length = float(np.linalg.norm(end - start))
    t = np.linspace(0.0, 1.0, max(2, int(np.ceil(length / PIECE_MM)) + 1))[:, None]
    bow = BEND * length * rng.standard_normal((2, 3))
    path: NDArray[np.float64] = start + t * (end - start)
    path += np.sin(np.pi * t) * bow[0] + 0.5 * np.sin(2.0 * np.pi * t) * bow[1]
    return path


def _unit(end: NDArray[np.float64], rng: np.random.Generator) -> list[Piece]:
    """A terminal ductal lobular unit: a few balls that overlap."""
    radius, label = rng.uniform(*UNIT_MM), TISSUES["tdlu"].label
    middles = end + 0.6 * radius * rng.standard_normal((3, 3))
    return [(middle, middle, 0.8 * radius, 0.8 * radius, label) for middle in middles]
