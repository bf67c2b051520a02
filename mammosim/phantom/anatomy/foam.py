"""Edges of a foam: where three cells of a net meet, joined in nodes where four meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull

from mammosim.phantom.anatomy._net_kernels import ABSENT, TAG, WEIGHT, Net, wall_strengths


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


def net_around(net: Net, places_mm: NDArray[np.float64]) -> Net:
    """A net without the cells that lie farther from places, (n, 3) in its coordinates, than two
    others."""
    index = np.floor((places_mm - net.origin_mm) / net.cell_mm).astype(int)
    near = np.zeros(net.seeds.shape[:3], bool)
    near[tuple(index.T)] = True
    near = ndimage.binary_dilation(near, np.ones((3, 3, 3), bool), iterations=2)
    seeds = net.seeds.copy()
    seeds[..., WEIGHT][~near] = 2.0 * ABSENT
    return net._replace(seeds=seeds)
