"""Fibrous strands: bundles of fibres along the edges of the foam of fat lobules.

Where three lobules meet, their walls share a strand, as films of a foam meet in a Plateau border;
where four meet, strands join in a node. A strand is a bundle of fibres. Each fibre runs along
several edges, turns little at nodes, and cuts their corners: fibres lie side by side in the middle
of an edge and part in a smooth curve before the node. Finer fibres fray off and run on by
themselves through the fat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim._side_by_side import both
from mammosim.phantom.anatomy._net_kernels import Net
from mammosim.phantom.anatomy.foam import foam_edges, net_around
from mammosim.phantom.anatomy.tissue import Tissue
from mammosim.phantom.anatomy.web import LONG, WEB, Courses, draw_web, web_directions


@dataclass(frozen=True)
class Bundles:
    """Fibres along the edges of one foam.

    Parameters
    ----------
    per_edge : float
        Fibres along an edge whose walls have the mean thickness.
    radius_mm, spread : float
        Median radius of a fibre and spread of its logarithm.
    edges : float
        Mean number of edges that a fibre follows.
    apart_mm : float
        Spread of the fibres of a bundle about the node's place, along each axis, mm.
    pieces : int
        Straight pieces from the middle of one edge to that of the next.
    """

    per_edge: float
    radius_mm: float
    spread: float
    edges: float
    apart_mm: float
    pieces: int


BUNDLES = (Bundles(3.0, 0.055, 0.8, 6.0, 0.6, 3), Bundles(1.0, 0.05, 0.85, 7.0, 0.5, 2))
"""Of the coarse and the fine foam. Chosen by eye."""

THINNEST_MM, THICKEST_MM = 0.025, 0.5
"""Radius below which a fibre ends, and the most, mm. Chosen by eye."""

STRAIGHT = 3.0
"""How strongly a fibre prefers the edge along which it turns least: the odds of an edge are the
exponential of this by the cosine of the turn. Chosen by eye."""

UNEVEN = 0.3
"""Spread of a fibre's thickness along it, against its mean. Chosen by eye."""

LONGEST = 16
"""Most edges that a fibre follows."""

NEAR_MM = 4.0
"""Nodes farther from all tissue than this, in coordinates of the foam, are left out."""

TURNS = 6
"""Steps of the search for the place that has given coordinates of the foam."""

TILE_MM = (3.2, 2.0, 4.0)
"""Pieces are painted box by box of this size, so that the voxels they change are in the cache."""

Foam = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]
"""Nodes of a foam, (n, 3) mm, the two of each edge, (m, 2), and the edges' strengths, (m,)."""


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


def draw_threads(
    tissue: Tissue,
    nets: tuple[Net, Net],
    amount: float,
    stoutness: float,
    rng: np.random.Generator,
) -> Threads:
    """Strands of a breast.

    Parameters
    ----------
    tissue : Tissue
    nets : tuple of Net
        Coarse and fine foam.
    amount, stoutness : float
        Number and radius of fibres against those of the mean woman.
    rng : Generator

    Notes
    -----
    An edge holds fibres in proportion to the thickness of the second of its three walls; where only
    one of them is present there is none.
    """
    foams = both(*(partial(_edges_in, net, tissue) for net in nets))
    pieces = [
        _pieces(*_bundles(foam, kind, amount, rng))
        for foam, kind in zip(foams, BUNDLES, strict=True)
    ]
    strands = np.concatenate([ends for ends, _ in pieces])
    field = web_directions(tissue, rng)
    pieces += [
        _pieces(*draw_web(kind, strands, field, amount, tissue, rng)) for kind in (WEB, LONG)
    ]
    ends, radii = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return _within(ends, stoutness * radii, tissue)


def _edges_in(net: Net, tissue: Tissue) -> Foam:
    """The foam of a net, in and near tissue."""
    nodes, edges, strength = foam_edges(net_around(net, tissue.places_mm))
    kept = _near(nodes, tissue)[edges].all(axis=1) & (strength > 0.0)
    edges, strength = edges[kept], strength[kept]
    used, edges = np.unique(edges, return_inverse=True)
    return _places(nodes[used], tissue), edges.reshape(-1, 2), strength


def _bundles(foam: Foam, kind: Bundles, amount: float, rng: np.random.Generator) -> Courses:
    """Fibres along the edges of a foam."""
    nodes, edges, strength = foam
    count = int(amount * kind.per_edge * strength.sum() / kind.edges)
    path, length = _walks(nodes, edges, strength, count, kind.edges, rng)
    at = nodes[path] + kind.apart_mm * rng.standard_normal((*path.shape, 3))
    radius = kind.radius_mm * np.exp(
        kind.spread * rng.standard_normal((count, 1)) + UNEVEN * rng.standard_normal(path.shape)
    )
    return _spline(at, radius, length, kind.pieces)


def _walks(
    nodes: NDArray[np.float64],
    edges: NDArray[np.int64],
    strength: NDArray[np.float64],
    count: int,
    mean_edges: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Nodes that fibres pass, (fibre, LONGEST + 1), and how many edges each follows.

    Fibres start anywhere, on strong edges more often, and go on where they turn least.
    """
    ends = np.concatenate([edges, edges[:, ::-1]])  # each edge in both directions
    order = np.argsort(ends[:, 0], kind="stable")
    ends, weight = ends[order], np.concatenate([strength, strength])[order]
    first = np.searchsorted(ends[:, 0], np.arange(len(nodes) + 1))
    way = nodes[ends[:, 1]] - nodes[ends[:, 0]]
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    step = rng.choice(len(ends), count, p=weight / weight.sum())
    path = np.empty((count, LONGEST + 1), np.int64)
    path[:, 0], path[:, 1] = ends[step].T
    wanted = np.minimum(1 + rng.geometric(1.0 / mean_edges, count), LONGEST)
    length = np.ones(count, np.int64)
    for turn in range(2, LONGEST + 1):
        here = path[:, turn - 1]
        options = first[here, None] + np.arange(4)
        open_ = options < first[here + 1, None]
        options = np.minimum(options, len(ends) - 1)
        open_ &= ends[options, 1] != path[:, turn - 2, None]
        score = STRAIGHT * (way[options] * way[step, None]).sum(axis=2) + np.log(weight[options])
        score += rng.gumbel(size=score.shape)
        best = np.where(open_, score, -np.inf).argmax(axis=1)
        step = options[np.arange(count), best]
        goes_on = (length == turn - 1) & (turn <= wanted) & open_.any(axis=1)
        length[goes_on] = turn
        path[:, turn] = np.where(goes_on, ends[step, 1], here)
    return path, length


def _spline(
    at: NDArray[np.float64], radius: NDArray[np.float64], length: NDArray[np.int64], pieces: int
) -> Courses:
    """Quadratic B-splines: each touches the lines between its points in their middles.

    Fibres taper over their first and last edge.
    """
    count, points = radius.shape
    turn = np.arange(points)
    radius = np.where(turn <= length[:, None], radius, 0.0)
    radius[:, 0] = 0.0
    radius[np.arange(count), length] = 0.0
    t = (np.arange(pieces) / pieces)[:, None]
    weight = np.stack([0.5 * (1 - t) ** 2, 0.5 + t * (1 - t), 0.5 * t**2])
    courses = sum(weight[n] * at[:, n : points - 2 + n, None] for n in range(3)).reshape(
        count, -1, 3
    )
    flat = weight[..., 0]
    radii = sum(flat[n] * radius[:, n : points - 2 + n, None] for n in range(3)).reshape(count, -1)
    return courses, radii


def _pieces(
    courses: NDArray[np.float64], radius: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends (n, 2, 3) and radii (n, 2) of the straight pieces of fibres."""
    there = np.maximum(radius[:, :-1], radius[:, 1:]) > THINNEST_MM
    fibre, first = np.nonzero(there)
    both = first[:, None] + np.arange(2)
    return courses[fibre[:, None], both], radius[fibre[:, None], both]


def _near(nodes_mm: NDArray[np.float64], tissue: Tissue) -> NDArray[np.bool_]:
    """Which nodes lie within or close to tissue."""
    gap, _ = tissue.nearest.query(nodes_mm, distance_upper_bound=NEAR_MM)
    near: NDArray[np.bool_] = np.isfinite(gap)
    return near


def _places(wanted: NDArray[np.float64], tissue: Tissue) -> NDArray[np.float64]:
    """Places whose coordinates in the foam are given: Newton's method with the slopes at the
    nearest point of the grid."""
    number = tissue.nearest.query(wanted)[1]
    inverse, at = tissue.inverse_slope[number], tissue.inside[number].astype(float)
    for _ in range(TURNS):
        here = np.stack(
            [
                ndimage.map_coordinates(part, at.T, order=1, mode="nearest")
                for part in tissue.coordinates_mm
            ],
            axis=-1,
        )
        at += np.einsum("nij,nj->ni", inverse, wanted - here).clip(-1.0, 1.0)
    return tissue.frame.position_mm(at)


def _within(
    ends_mm: NDArray[np.float64], radius_mm: NDArray[np.float64], tissue: Tissue
) -> Threads:
    """The pieces in front of the muscle and within the skin."""
    frame = tissue.frame
    middle_mm = 0.5 * (ends_mm[:, 0] + ends_mm[:, 1])
    index = np.rint(frame.index(middle_mm)).astype(int)
    inside = ((index >= 0) & (index < np.array(frame.shape))).all(axis=1)
    i, j, k = np.clip(index, 0, np.array(frame.shape) - 1).T
    kept = inside & (tissue.skin_depth_mm[i, j, k] > 0.0) & (tissue.muscle_depth_mm[i, j, k] < 0.0)
    ends_mm, radius_mm = ends_mm[kept], np.minimum(radius_mm[kept], THICKEST_MM)
    order = np.lexsort(np.floor(middle_mm[kept] / TILE_MM).T[::-1])
    return Threads(ends_mm[order], radius_mm[order])
