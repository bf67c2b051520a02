"""The equilibrium problem of the spring lattice, in lattice units, and the state of its nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid import row_spans
from mammosim.compression.plates._straight_kernels import StraightGap

Forces = tuple[NDArray[np.float32] | None, NDArray[np.float32] | None, NDArray[np.float32] | None]

EDGE_RADIUS = 3.0
"""Of the plates' edge, lattice units: that of FDA's VICTRE paddle, 3 mm, at a spacing of 1 mm."""

CHEST_WALL_INDEX = 1
"""x index of the first tissue layer: arrays have one layer of air around."""


@dataclass(frozen=True, eq=False)
class SpringProblem:
    """What the springs must balance.

    Places are in lattice units, indices of the padded arrays being the places at rest.

    Parameters
    ----------
    modulus : ndarray of float32, [x, y, z]
        Modulus of each node, kPa; 0 in air, of which there is one layer all around.
    fixed : ndarray of bool, [x, y, z]
        Nodes that are held: the chest-wall layer, and muscle where it is fixed.
    lower, upper : float
        z of the faces of breast support and paddle.
    edge : float
        x of the plates' edge: nodes beyond it at rest stay between the plates, and those behind it
        are stopped by their ends where they are higher than the faces.
    force : tuple of three (ndarray of float32 or None), [x, y, z]
        Force on each node along x, y and z from outside, kPa x lattice units: a force of F mN on a
        node of a lattice of spacing h mm is 9 F / h^2, in the scale of the springs (a spring of
        modulus E stretched by Delta mm carries (E / 9) h Delta mN). None: no such force.
    stiffness : ndarray of float32, [13, x, y, z], optional
        Stiffness of each spring, kPa, in place of the smaller modulus of its two nodes: from a
        node to those of its 26 neighbours that lie ahead in the order ``9 (dx+1) + 3 (dy+1) +
        (dz+1)``; 0 where either is air. `modulus` then only says what is tissue.
    edge_radius : float
        Radius of the rounding between the plates' faces and their ends, lattice units.
    stiffening : ndarray of float32, [x, y, z], optional
        Enl of springs that stiffen as they are strained: a spring strained by e has the smaller
        ``modulus exp(stiffening e)`` of its two nodes. None: linear springs.
    chest : float
        x of the chest wall, which no node crosses.
    """

    modulus: NDArray[np.float32]
    fixed: NDArray[np.bool_]
    lower: float
    upper: float
    edge: float
    force: Forces = (None, None, None)
    stiffness: NDArray[np.float32] | None = None
    edge_radius: float = EDGE_RADIUS
    stiffening: NDArray[np.float32] | None = None
    chest: float = CHEST_WALL_INDEX

    @property
    def tissue(self) -> NDArray[np.bool_]:
        """Nodes that are tissue."""
        return self.modulus > 0.0

    @property
    def springs(self) -> NDArray[np.float32]:
        """Stiffness of each spring or, where that is not given, modulus of each node."""
        return self.modulus if self.stiffness is None else self.stiffness

    @property
    def plates(self) -> StraightGap:
        """The plates as kernels take them."""
        return StraightGap(
            float(self.lower), float(self.upper), float(self.edge), float(self.edge_radius)
        )

    def span(self) -> NDArray[np.int32]:
        """First and one past the last z index with tissue in each column, [x, y, 2]."""
        return row_spans(self.tissue)

    def released(self) -> SpringProblem:
        """The same lattice with the plates taken away."""
        return replace(self, lower=-np.inf, upper=np.inf, edge=np.inf)


@dataclass(frozen=True, eq=False)
class SpringState:
    """Where the nodes are, how they came there, and what is left to do.

    Parameters
    ----------
    displacement : tuple of three ndarray of float64, [x, y, z]
        Displacement along x, y, z, lattice units.
    converged : bool
    error : float
        Estimate of the largest (multigrid) or mean (relaxation) distance from equilibrium,
        lattice units.
    history : ndarray, structured
        One row an iteration.
    interrupted : bool
    """

    displacement: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
    converged: bool
    error: float
    history: NDArray[np.void]
    interrupted: bool = False

    def stopped(self) -> SpringState:
        """The same state, at which the user stopped a search."""
        return replace(self, converged=False, interrupted=True)
