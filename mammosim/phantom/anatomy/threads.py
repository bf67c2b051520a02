"""Fibrous strands: a graph of taut lines that meet in star-shaped nodes and end in the skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame


@dataclass(frozen=True)
class Level:
    """Strands of one scale.

    Parameters
    ----------
    nodes_per_ml : float
        Nodes per mL of breast.
    radius_mm : float
        Median radius of a strand at a node, mm.
    links : int
        Further strands from each node to its nearest neighbours, besides the one that leads
        towards the nipple.
    """

    nodes_per_ml: float
    radius_mm: float
    links: int


LEVELS = (Level(0.2, 0.70, 1), Level(1.2, 0.46, 2), Level(7.0, 0.25, 2))
"""Coarse strands first: finer ones are tied to them too. Nodes are 17, 9 and 5 mm apart. Chosen by
eye."""

RADIUS_SPREAD, RADII_MM = 0.45, (0.05, 0.75)
"""Spread of the logarithm of radii, and bounds, mm. Chosen by eye."""

WAIST, FLARE = 0.55, 0.40
"""Radius of a strand in its middle against that at its nodes, and the share of its length over
which it widens towards each. Chosen by eye."""

AGAINST_NIPPLE = 1.6
"""How much a way counts as longer that does not lead towards the nipple. Chosen."""

NEIGHBOURS = 9
"""Nearest nodes among which a strand's other end is chosen."""

FARTHEST = 2.4
"""Longest strand against the mean distance of nodes."""

SKIN_REACH, SKIN_SLANT = 0.8, 0.6
"""Depth up to which a node hangs at the skin, against the mean distance of nodes, and how far such
a ligament slants, against that depth."""

BOW = 0.05
"""How far a strand's middle leaves the straight line, of its length: strands are under tension."""

AROUND_GLAND = 0.55
"""Share of the density of nodes that is lost where gland has no room. Chosen."""

PIECES, TIED = 7, [2, 5]
"""Straight pieces of a strand, and at which of their ends finer strands are tied to it."""

SKIN_MM = 0.8
"""Depth below the skin's face at which ligaments end, mm, within the skin."""


@dataclass(frozen=True, eq=False)
class Threads:
    """Straight round pieces of ligament, finer than most voxels.

    Parameters
    ----------
    ends_mm : ndarray, (n, 2, 3)
        Both ends, generator coordinates, mm.
    radius_mm : ndarray, (n, 2)
    """

    ends_mm: NDArray[np.float64]
    radius_mm: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tissue:
    """Where strands may be: coarse fields [x, lateral, superior] and their frame.

    Parameters
    ----------
    skin_depth_mm, muscle_depth_mm : ndarray
        Distance below the skin, depth below the muscle's face.
    gland_room : ndarray
        Positive where glandular tissue may be.
    frame : VoxelFrame
    """

    skin_depth_mm: NDArray[np.float64]
    muscle_depth_mm: NDArray[np.float64]
    gland_room: NDArray[np.float64]
    frame: VoxelFrame


def draw_threads(
    tissue: Tissue, foot_mm: float, amount: float, rng: np.random.Generator
) -> Threads:
    """Strands of a breast.

    Parameters
    ----------
    tissue : Tissue
    foot_mm : float
        x of the nipple's foot.
    amount : float
        Number of nodes against that of the mean woman.
    rng : Generator

    Notes
    -----
    Nodes are drawn at random, level by level. From each a strand leads to a near node towards the
    nipple, and others to its nearest neighbours, among which are points of coarser strands. Nodes
    under the skin hang at it (Cooper's ligaments). Strands are taut, and widen at both ends.
    """
    nipple = np.array([foot_mm, 0.0, 0.0])
    tied, tied_radius = np.empty((0, 3)), np.empty(0)
    ends, radii = [], []
    for level in LEVELS:
        nodes = _nodes(tissue, level.nodes_per_ml * amount, rng)
        radius = _radii(level.radius_mm, len(nodes), rng)
        apart = (1000.0 / (level.nodes_per_ml * amount)) ** (1.0 / 3.0)
        places = np.concatenate([nodes, tied])
        thick = np.concatenate([radius, np.minimum(tied_radius, 1.5 * level.radius_mm)])
        links = _links(nodes, places, nipple, level.links, FARTHEST * apart)
        skin, hung = _hung(nodes, tissue, SKIN_REACH * apart, rng)
        start = np.concatenate([places[links[:, 0]], nodes[hung]])
        end = np.concatenate([places[links[:, 1]], skin])
        wide = np.concatenate([thick[links], np.stack([radius[hung], 0.8 * radius[hung]], 1)])
        courses = _courses(start, end, rng)
        own = np.exp(RADIUS_SPREAD * rng.standard_normal(len(start)))
        profile = _profiles(wide, own)
        ends.append(np.stack([courses[:, :-1], courses[:, 1:]], axis=2).reshape(-1, 2, 3))
        radii.append(np.stack([profile[:, :-1], profile[:, 1:]], axis=2).reshape(-1, 2))
        tied = np.concatenate([tied, courses[:, TIED].reshape(-1, 3)])
        tied_radius = np.concatenate([tied_radius, profile[:, TIED].ravel()])
    return _within(np.concatenate(ends), np.concatenate(radii), tissue)


def _nodes(tissue: Tissue, per_ml: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Random places between skin and muscle, denser where gland may be, (n, 3) mm."""
    frame = tissue.frame
    room = (tissue.skin_depth_mm > 2.5) & (tissue.muscle_depth_mm < 0.0)
    room[: max(int(-frame.origin_mm[0] / frame.spacing_mm[0]), 0)] = False
    cells = np.argwhere(room)
    gland = np.clip(tissue.gland_room[room], 0.0, 1.0)
    total = np.cumsum(1.0 - AROUND_GLAND * (1.0 - gland))
    number = int(per_ml * len(cells) * float(frame.spacing_mm.prod()) / 1000.0)
    chosen = cells[np.searchsorted(total, rng.random(number) * total[-1])]
    return frame.position_mm(chosen + rng.uniform(-0.5, 0.5, chosen.shape))


def _radii(median_mm: float, number: int, rng: np.random.Generator) -> NDArray[np.float64]:
    spread = np.exp(RADIUS_SPREAD * rng.standard_normal(number))
    radii: NDArray[np.float64] = np.clip(median_mm * spread, *RADII_MM)
    return radii


def _links(
    nodes: NDArray[np.float64],
    places: NDArray[np.float64],
    nipple_mm: NDArray[np.float64],
    others: int,
    farthest_mm: float,
) -> NDArray[np.int64]:
    """Pairs of places (the first of which are the nodes) that strands join, each pair once."""
    if len(places) < 2 + others:
        return np.empty((0, 2), np.int64)
    gap, near = cKDTree(places).query(nodes, k=min(NEIGHBOURS + 1, len(places)))
    gap, near = gap[:, 1:], near[:, 1:]  # a node is its own nearest
    way = places[near] - nodes[:, None]
    towards = nipple_mm - nodes
    along = (way * towards[:, None]).sum(axis=-1)
    along /= np.maximum(gap * np.linalg.norm(towards, axis=-1)[:, None], 1e-9)
    first = (gap * (1.0 + AGAINST_NIPPLE * (1.0 - along))).argmin(axis=1)
    order = np.concatenate([first[:, None], np.tile(np.arange(others), (len(nodes), 1))], axis=1)
    row = np.arange(len(nodes))[:, None]
    pairs = np.stack([np.broadcast_to(row, order.shape), near[row, order]], axis=-1)
    pairs = pairs[(gap[row, order] < farthest_mm) & (gap[row, order] > 1.0)]
    unique: NDArray[np.int64] = np.unique(np.sort(pairs, axis=1), axis=0)
    return unique


def _hung(
    nodes: NDArray[np.float64], tissue: Tissue, reach_mm: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Points of the skin at which nodes below it hang, and which of them do."""
    depth, outward = _at(nodes, tissue)
    hung = depth < reach_mm
    start, out, deep = nodes[hung], outward[hung], (depth - SKIN_MM)[hung, None]
    aside = SKIN_SLANT * rng.standard_normal(out.shape)
    end = start + deep * (out + aside - (aside * out).sum(axis=1)[:, None] * out)
    depth, outward = _at(end, tissue)
    return end + (depth - SKIN_MM)[:, None] * outward, hung


def _at(
    places: NDArray[np.float64], tissue: Tissue
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth below the skin at places, mm, and the direction out, (n, 3)."""
    field, index = tissue.skin_depth_mm, tissue.frame.index(places).T
    depth, *slope = (
        ndimage.map_coordinates(part, index, order=1, mode="nearest")
        for part in (field, *np.gradient(field, *tissue.frame.spacing_mm))
    )
    return depth, -_unit(np.stack(slope, axis=-1))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: NDArray[np.float64] = vectors / np.maximum(length, 1e-9)
    return unit


def _courses(
    start: NDArray[np.float64], end: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Places along all strands, (strand, piece + 1, 3) mm: straight but for a slight bow."""
    way = end - start
    length = np.linalg.norm(way, axis=1)[:, None]
    bow, bend = BOW * length * rng.standard_normal((2, *way.shape))
    t = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    places: NDArray[np.float64] = start[:, None] + t * way[:, None]
    places += np.sin(np.pi * t) * bow[:, None] + 0.4 * np.sin(2.0 * np.pi * t) * bend[:, None]
    return places


def _profiles(ends_mm: NDArray[np.float64], own: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radius at each place along strands, (strand, piece + 1) mm, from those at their nodes."""
    t = np.linspace(0.0, 1.0, PIECES + 1)
    waist = WAIST * own * np.sqrt(ends_mm[:, 0] * ends_mm[:, 1])
    waist = np.minimum(waist, ends_mm.min(axis=1))[:, None]
    profile = np.broadcast_to(waist, (len(ends_mm), t.size)).copy()
    for end, away in ((0, t), (1, 1.0 - t)):
        near = np.clip(1.0 - away / FLARE, 0.0, 1.0) ** 2
        profile += (ends_mm[:, end, None] - waist) * near
    return profile


def _within(
    ends_mm: NDArray[np.float64], radius_mm: NDArray[np.float64], tissue: Tissue
) -> Threads:
    """The pieces in front of the muscle and within the skin."""
    frame = tissue.frame
    index = np.rint(frame.index(ends_mm.mean(axis=1))).astype(int)
    i, j, k = np.clip(index, 0, np.array(frame.shape) - 1).T
    kept = (tissue.skin_depth_mm[i, j, k] > 0.0) & (tissue.muscle_depth_mm[i, j, k] < 0.0)
    return Threads(ends_mm[kept], radius_mm[kept])
