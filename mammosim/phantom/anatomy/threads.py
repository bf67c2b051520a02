"""Fibrous strands: bundles of fibres along the edges of the foam of fat lobules.

Where three lobules meet, their walls share a strand, as films of a foam meet in a Plateau border;
where four meet, strands join in a node. A strand is a bundle of fibres. Each fibre runs along
several edges, turns little at nodes, and cuts their corners: fibres lie side by side in the middle
of an edge and part in a smooth curve before the node. Finer fibres fray off and run on by
themselves through the fat.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._net_kernels import Net
from mammosim.phantom.anatomy.foam import foam_edges, net_around
from mammosim.phantom.anatomy.noise import smooth_noise


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


BUNDLES = (Bundles(3.0, 0.055, 0.9, 6.0, 0.6, 3), Bundles(1.0, 0.05, 0.85, 7.0, 0.5, 2))
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


@dataclass(frozen=True)
class Web:
    """Fibres that fray off strands.

    Parameters
    ----------
    per_ml : float
        Number of fibres per millilitre of breast.
    length_mm : float
        Mean length, mm.
    step_mm : float
        Length of a straight piece, mm.
    radius_mm, spread : float
        Median radius and spread of its logarithm.
    turning_mm : float
        Length over which a fibre turns from its strand's direction into that of the field, mm.
    wander : float
        Change of direction by chance, radians per square root of a millimetre.
    """

    per_ml: float
    length_mm: float
    step_mm: float
    radius_mm: float
    spread: float
    turning_mm: float
    wander: float


WEB = Web(180.0, 20.0, 2.5, 0.05, 0.85, 9.0, 0.05)
"""Chosen by eye."""

LONGEST_WEB, OWN_DIRECTION = 2.5, 0.8
"""Longest fibre of the web against the mean, and spread of a fibre's own direction against that of
the field. Chosen by eye."""

SWIRL_MM, RADIAL = 20.0, 0.5
"""Wavelength of the field of directions of the web, and the part of the direction to the nipple in
it. Chosen by eye."""

TILE_MM = (3.2, 2.0, 4.0)
"""Pieces are painted box by box of this size, so that the voxels they change are in the cache."""


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
    coordinates_mm : list of three ndarray
        Coordinates in which lobules are a power diagram.
    frame : VoxelFrame
    """

    skin_depth_mm: NDArray[np.float64]
    muscle_depth_mm: NDArray[np.float64]
    coordinates_mm: list[NDArray[np.float64]]
    frame: VoxelFrame

    @cached_property
    def inside(self) -> NDArray[np.int64]:
        """Indices (n, 3) of points of the grid in tissue, with what is close to it."""
        return np.argwhere((self.skin_depth_mm > -1.0) & (self.muscle_depth_mm < 2.0))

    @cached_property
    def places_mm(self) -> NDArray[np.float64]:
        """Their coordinates in the foam, (n, 3)."""
        return np.stack([part[tuple(self.inside.T)] for part in self.coordinates_mm], axis=-1)

    @cached_property
    def nearest(self) -> cKDTree:
        """Finds the nearest of them by its coordinates in the foam."""
        return cKDTree(self.places_mm)

    @cached_property
    def inverse_slope(self) -> NDArray[np.float64]:
        """Steps of the index for the coordinates, at each of them, (n, 3, 3)."""
        slopes = [np.stack(tuple(np.gradient(part)), axis=-1) for part in self.coordinates_mm]
        return np.linalg.inv(np.stack(slopes, axis=-2)[tuple(self.inside.T)])

    @property
    def volume_ml(self) -> float:
        """Volume within the skin and in front of the muscle."""
        held = (self.skin_depth_mm > 0.0) & (self.muscle_depth_mm < 0.0)
        return float(np.count_nonzero(held) * np.prod(self.frame.spacing_mm) / 1000.0)


Courses = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Places along fibres, (fibre, place, 3) mm, and radii there, (fibre, place) mm, 0 beyond ends."""


def draw_threads(
    tissue: Tissue, nets: tuple[Net, Net], amount: float, rng: np.random.Generator
) -> Threads:
    """Strands of a breast.

    Parameters
    ----------
    tissue : Tissue
    nets : tuple of Net
        Coarse and fine foam.
    amount : float
        Area of their cross-sections against that of the mean woman.
    rng : Generator

    Notes
    -----
    An edge holds fibres in proportion to the thickness of the second of its three walls; where only
    one of them is present there is none.
    """
    bundles = [
        _bundles(net, kind, amount, tissue, rng) for net, kind in zip(nets, BUNDLES, strict=True)
    ]
    pieces = [_pieces(*courses) for courses in bundles]
    pieces.append(_pieces(*_web(np.concatenate([ends for ends, _ in pieces]), amount, tissue, rng)))
    ends, radii = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return _within(ends, radii, tissue)


def _bundles(
    net: Net, kind: Bundles, amount: float, tissue: Tissue, rng: np.random.Generator
) -> Courses:
    """Fibres along the edges of a foam."""
    nodes, edges, strength = foam_edges(net_around(net, tissue.places_mm))
    kept = _near(nodes, tissue)[edges].all(axis=1) & (strength > 0.0)
    edges, strength = edges[kept], strength[kept]
    used, edges = np.unique(edges, return_inverse=True)
    edges = edges.reshape(-1, 2)
    nodes = _places(nodes[used], tissue)
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


def _web(
    ends_mm: NDArray[np.float64], amount: float, tissue: Tissue, rng: np.random.Generator
) -> Courses:
    """Fibres that start along pieces of strands and turn into the direction of a smooth field."""
    count = int(amount * WEB.per_ml * tissue.volume_ml)
    field, last = _directions(tissue, rng), np.array(tissue.frame.shape) - 1
    start = ends_mm[rng.integers(0, len(ends_mm), count)]
    at = start[:, 0].copy()
    way = _unit(start[:, 1] - start[:, 0]) * rng.choice([-1.0, 1.0], count)[:, None]
    length = WEB.length_mm * np.sort(rng.gamma(3.0, 1.0 / 3.0, count))[::-1]
    steps = int(LONGEST_WEB * WEB.length_mm / WEB.step_mm)
    length = np.clip(length, 2.0 * WEB.step_mm, steps * WEB.step_mm)
    own = OWN_DIRECTION * rng.standard_normal((count, 3))
    places = np.empty((count, steps + 1, 3))
    for step in range(steps + 1):
        places[:, step] = at
        going = slice(np.count_nonzero(length > step * WEB.step_mm))  # the longest come first
        index = np.rint(tissue.frame.index(at[going])).astype(np.int64).clip(0, last)
        wanted = field[tuple(index.T)] + own[going]
        wanted *= np.sign(_sums(wanted * way[going]))
        turned = way[going] + WEB.step_mm / WEB.turning_mm * (wanted - way[going])
        turned += WEB.wander * np.sqrt(WEB.step_mm) * rng.standard_normal(turned.shape)
        way[going] = _unit(turned)
        at[going] += WEB.step_mm * way[going]
    part = np.arange(steps + 1) * WEB.step_mm / length[:, None]
    radius = WEB.radius_mm * np.exp(WEB.spread * rng.standard_normal((count, 1)))
    # A fibre is whole where it leaves its strand, and tapers over its last two thirds.
    return places, radius * np.clip(1.5 * (1.0 - part), 0.0, 1.0)


def _directions(tissue: Tissue, rng: np.random.Generator) -> NDArray[np.float64]:
    """Unit vectors on the grid, [x, lateral, superior, 3]: swirls, lines towards the nipple, and
    along the skin."""

    def slopes(part: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack(tuple(np.gradient(part, *tissue.frame.spacing_mm)))

    first, second = (slopes(smooth_noise(rng, tissue.frame, SWIRL_MM)) for _ in range(2))
    swirl = np.cross(first, second, axis=0)
    swirl /= np.sqrt((swirl**2).sum(axis=0).mean())
    _, across, along = (slopes(part) for part in tissue.coordinates_mm)
    total = swirl + RADIAL * _unit(np.cross(across, along, axis=0), 0)
    outwards = _unit(slopes(tissue.skin_depth_mm), 0)
    near_skin = np.exp(-((tissue.skin_depth_mm.clip(0.0) / 6.0) ** 2))
    total -= near_skin * (total * outwards).sum(axis=0) * outwards
    return np.ascontiguousarray(np.moveaxis(_unit(total, 0), 0, -1))


def _unit(vectors: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Vectors of length one."""
    unit: NDArray[np.float64] = vectors / np.maximum(np.sqrt(_sums(vectors**2, axis)), 1e-9)
    return unit


def _sums(vectors: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Sums of three components along an axis that is kept: NumPy's own take ten times as long."""
    first, second, third = np.moveaxis(vectors, axis, 0)
    return np.expand_dims(first + second + third, axis)


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
