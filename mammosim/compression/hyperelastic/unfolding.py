"""A start without folded elements: the displacement around a fold is smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic._element_kernels import element_volumes
from mammosim.compression.hyperelastic.body import Body, nodes_of

MAX_SWEEPS = 40
"""Smoothing sweeps at most; 2 to 7 are usual."""

NEIGHBOURS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""Steps from a node to those that share an edge with it."""


def smoothed_folds(body: Body, u: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Displacement in which no element has a J below a limit, as far as smoothing achieves that.

    Parameters
    ----------
    body : Body
    u : ndarray, [3, x, y, z]
        Displacement, lattice units, such as one interpolated from a coarser body.
    least : float
        Smallest J of an element that is left as it is.

    Notes
    -----
    In each sweep the nodes of the elements below the limit take the mean displacement of the nodes
    beside them. The gradient of the displacement there becomes that of the surroundings, which are
    not folded. The elements that are folded in an interpolated start are few (up to 0.3 % were
    seen) and isolated, so a body softened as a whole would take many more steps to unfold them.
    """
    u = u.copy()
    for _ in range(MAX_SWEEPS):
        places = np.argwhere(nodes_of(_below(body, u, least)) & body.nodes)
        if len(places) == 0:
            break
        total, count = np.zeros((3, len(places))), np.zeros(len(places))
        for step in NEIGHBOURS:
            beside = tuple((places + step).T)
            total += np.where(body.nodes[beside], u[(slice(None), *beside)], 0.0)
            count += body.nodes[beside]
        here = (slice(None), *places.T)
        u[here] = body.free[here] * total / count
    return u


def _below(body: Body, u: NDArray[np.float64], least: float) -> NDArray[np.bool_]:
    """Elements with a J below a limit at any of nine points."""
    volume, smallest = np.empty(body.shear.shape), np.full(body.shear.shape, np.inf)
    element_volumes(u, body.element_span, volume, smallest)
    return np.asarray(body.active & (smallest < least))
