"""Fibrous strands: the edges of the foam of fat lobules, drawn as thin round pieces.

Where three lobules meet, their walls share a strand, as films of a foam meet in a Plateau border;
where four meet, strands join in a node, at which each of them is widest. As edges of one foam they
are a connected net, which ends in the skin, at the muscle and in gland.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, cKDTree

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._net_kernels import ABSENT, TAG, WEIGHT, Net, wall_strengths


@dataclass(frozen=True)
class Borders:
    """Strands of one foam.

    Parameters
    ----------
    radius_mm : float
        Radius of a strand in its middle where its walls have the mean thickness, mm.
    pieces : int
        Straight pieces of a strand.
    """

    radius_mm: float
    pieces: int


BORDERS = (Borders(0.17, 5), Borders(0.10, 3))
"""Of the coarse and the fine foam. Chosen by eye."""

RADIUS_SPREAD, RADII_MM = 0.25, (0.03, 0.9)
"""Spread of the logarithm of radii of strands and nodes, and bounds, mm. Chosen by eye."""

NODE, FLARE = 2.0, 0.42
"""Median radius of a node against that of its widest strand, and the share of its length over which
a strand widens towards each. Chosen by eye."""

NEAR_MM = 4.0
"""Nodes farther from all tissue than this, in coordinates of the foam, are left out."""

TURNS = 6
"""Steps of the search for the place that has given coordinates of the foam."""


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
    A strand is as thick as the second of its three walls; where only one of them is present there
    is none.
    """
    ends, radii = [], []
    for net, kind in zip(nets, BORDERS, strict=True):
        nodes, strands, strength = foam_edges(_around(net, tissue))
        near = _near(nodes, tissue)
        kept = near[strands].all(axis=1) & (strength > 0.0)
        strands, strength = strands[kept], strength[kept]
        own = np.exp(RADIUS_SPREAD * rng.standard_normal(len(strands)))
        middle = np.sqrt(amount) * kind.radius_mm * strength * own
        node = np.zeros(len(nodes))
        for end in (0, 1):
            np.maximum.at(node, strands[:, end], middle)
        node *= NODE * np.exp(RADIUS_SPREAD * rng.standard_normal(len(nodes)))
        profile = np.clip(_profiles(node[strands], middle, kind.pieces), *RADII_MM)
        courses = _courses(nodes[strands], kind.pieces, tissue)
        courses = _through_nodes(courses, profile)
        ends.append(np.stack([courses[:, :-1], courses[:, 1:]], axis=2).reshape(-1, 2, 3))
        radii.append(np.stack([profile[:, :-1], profile[:, 1:]], axis=2).reshape(-1, 2))
    return _within(np.concatenate(ends), np.concatenate(radii), tissue)


def foam_edges(
    net: Net,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Edges of a net's cells.

    Cells of a power diagram are neighbours where the lower hull of their points, lifted on a
    paraboloid, has an edge (Aurenhammer 1987, SIAM J Comput 16:78-96).

    Returns
    -------
    nodes_mm : ndarray, (n, 3)
        Where four cells meet, coordinates of the net.
    strands : ndarray of int, (m, 2)
        Nodes that an edge joins.
    strength : ndarray, (m,)
        Thickness of the second of its three walls against the mean; 0 where there is one wall.
    """
    present = np.argwhere(net.seeds[..., WEIGHT] >= ABSENT)
    seed = net.seeds[tuple(present.T)].astype(float)
    place, weight = present + seed[:, :3], seed[:, WEIGHT]
    lifted = (place**2).sum(axis=1) - weight
    hull = ConvexHull(np.column_stack([place, lifted]))
    lower = hull.equations[:, 3] < -1e-12
    number = np.cumsum(lower) - 1
    corners, neighbours = hull.simplices[lower], hull.neighbors[lower]
    first = place[corners[:, 0]]
    slopes = 2.0 * (place[corners[:, 1:]] - first[:, None])
    rise = lifted[corners[:, 1:]] - lifted[corners[:, :1]]
    nodes = np.linalg.solve(slopes, rise[..., None])[..., 0]
    one, opposite = np.nonzero(lower[neighbours])
    other = number[neighbours[one, opposite]]
    once = one < other
    one, opposite, other = one[once], opposite[once], other[once]
    cells = np.sort(corners[one][np.arange(4) != opposite[:, None]].reshape(-1, 3), axis=1)
    tag = seed[:, TAG]
    walls = np.stack(
        [wall_strengths(tag[cells[:, a]], tag[cells[:, b]]) for a, b in ((0, 1), (0, 2), (1, 2))]
    )
    return (
        net.origin_mm + nodes * net.cell_mm,
        np.stack([one, other], axis=1),
        np.sort(walls, axis=0)[1],
    )


def _around(net: Net, tissue: Tissue) -> Net:
    """A net without the cells that lie farther from tissue than two others."""
    index = np.floor((tissue.places_mm - net.origin_mm) / net.cell_mm).astype(int)
    near = np.zeros(net.seeds.shape[:3], bool)
    near[tuple(index.T)] = True
    near = ndimage.binary_dilation(near, np.ones((3, 3, 3), bool), iterations=2)
    seeds = net.seeds.copy()
    seeds[..., WEIGHT][~near] = 2.0 * ABSENT
    return net._replace(seeds=seeds)


def _near(nodes_mm: NDArray[np.float64], tissue: Tissue) -> NDArray[np.bool_]:
    """Which nodes lie within or close to tissue."""
    gap, _ = tissue.nearest.query(nodes_mm, distance_upper_bound=NEAR_MM)
    near: NDArray[np.bool_] = np.isfinite(gap)
    return near


def _courses(ends: NDArray[np.float64], pieces: int, tissue: Tissue) -> NDArray[np.float64]:
    """Places along all strands, (strand, piece + 1, 3) mm: straight in the foam's coordinates."""
    t = np.linspace(0.0, 1.0, pieces + 1)[:, None]
    wanted = (ends[:, :1] * (1.0 - t) + ends[:, 1:] * t).reshape(-1, 3)
    return _places(wanted, tissue).reshape(-1, pieces + 1, 3)


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


def _profiles(
    node_mm: NDArray[np.float64], middle_mm: NDArray[np.float64], pieces: int
) -> NDArray[np.float64]:
    """Radius at each place along strands, (strand, piece + 1) mm: widest at both nodes."""
    t = np.linspace(0.0, 1.0, pieces + 1)
    profile = np.broadcast_to(middle_mm[:, None], (len(middle_mm), t.size)).copy()
    for end, away in ((0, t), (1, 1.0 - t)):
        near = np.clip(1.0 - away / FLARE, 0.0, 1.0) ** 2
        profile += (node_mm[:, end, None] - middle_mm[:, None]).clip(0.0) * near
    return profile


def _through_nodes(
    courses: NDArray[np.float64], profile: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Strands a little longer, so that those that meet in a node leave no gap between them."""
    out = courses.copy()
    for end, next_ in ((0, 1), (-1, -2)):
        way = courses[:, end] - courses[:, next_]
        length = np.linalg.norm(way, axis=1)
        longer = 0.6 * profile[:, end] / np.maximum(length, 1e-9)
        out[:, end] += np.minimum(longer, 1.0)[:, None] * way
    return out


def _within(
    ends_mm: NDArray[np.float64], radius_mm: NDArray[np.float64], tissue: Tissue
) -> Threads:
    """The pieces in front of the muscle and within the skin."""
    frame = tissue.frame
    index = np.rint(frame.index(ends_mm.mean(axis=1))).astype(int)
    i, j, k = np.clip(index, 0, np.array(frame.shape) - 1).T
    kept = (tissue.skin_depth_mm[i, j, k] > 0.0) & (tissue.muscle_depth_mm[i, j, k] < 0.0)
    return Threads(ends_mm[kept], radius_mm[kept])
