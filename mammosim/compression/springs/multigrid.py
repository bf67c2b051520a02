"""Geometric multigrid for the spring lattice, as a preconditioner of conjugate gradients.

The three components share one operator, the weighted graph Laplacian of the lattice: symmetric,
positive definite, an M-matrix. A V-cycle smooths with Chebyshev polynomials of the Jacobi
iteration and coarsens by two with trilinear interpolation (Briggs, Henson & McCormick 2000, A
Multigrid Tutorial, chapter 5).
"""

from __future__ import annotations

from copy import copy

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.springs import _stencil_kernels as stencils
from mammosim.compression.springs import _vector_kernels as vectors
from mammosim.compression.springs.levels import Field, LatticeLevel, Level
from mammosim.compression.springs.levels import coarse_shape as coarse_shape

COARSEST_NODES = 200
"""A level with no more moving nodes than this is solved directly."""

SMOOTHED_PART = 4.0
"""The smoother acts on eigenvalues from the largest down to the largest over this."""

DEPENDENT_SHIFT = 1e-5
"""Added to the coarsest diagonal, relative: far above single-precision rounding, far below need."""


class Workspace:
    """Arrays that hierarchies of one lattice share, since only one of them works at a time."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[str, tuple[int, ...]], Field] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Field:
        """The array of a name and shape; zero where nothing has written."""
        if (name, shape) not in self._arrays:
            self._arrays[name, shape] = np.zeros(shape, np.float32)
        return self._arrays[name, shape]


class Multigrid:
    """A hierarchy of levels; `precondition` is one V-cycle.

    Parameters
    ----------
    finest : LatticeLevel
    workspace : Workspace
    """

    def __init__(self, finest: LatticeLevel, workspace: Workspace) -> None:
        self.workspace, self.finest = workspace, finest
        self.levels: list[Level] = [finest]
        while np.count_nonzero(self.levels[-1].free) > COARSEST_NODES:
            self.levels.append(self.levels[-1].coarsened())
        self._factors = [_chebyshev_factors(level.largest_eigenvalue) for level in self.levels]
        self._scale = [_scale_of(level) for level in self.levels]
        self._nodes = np.flatnonzero(self.levels[-1].free)
        matrix = _dense(self.levels[-1], self._nodes)
        # Held nodes can leave coarse functions linearly dependent; their difference is then moot.
        matrix[np.diag_indices_from(matrix)] *= 1.0 + DEPENDENT_SHIFT
        self._factor = scipy.linalg.cho_factor(matrix)

    def replaced(self, finest: LatticeLevel) -> Multigrid:
        """A hierarchy in which other nodes move, with the coarse operators of this one."""
        other = copy(self)
        other.finest, other.levels = finest, [finest, *self.levels[1:]]
        other._scale = [_scale_of(finest), *self._scale[1:]]
        return other

    def precondition(self, load: Field) -> Field:
        """One symmetric V-cycle from zero, about A^-1 load; the result is work space."""
        return self._cycle(0, load)

    def _cycle(self, number: int, load: Field) -> Field:
        level, scale, shape = self.levels[number], self._scale[number], load.shape
        u = self.workspace.array("u", shape)
        if number == len(self.levels) - 1:
            solution = scipy.linalg.cho_solve(self._factor, load.reshape(-1)[self._nodes])
            u.fill(0.0)
            u.reshape(-1)[self._nodes] = solution
            return u
        spare, step = (self.workspace.array(name, shape) for name in ("spare", "step"))
        (_, first_gain), (keep, gain) = self._factors[number]
        vectors.scaled_twice(scale, load, first_gain, step, spare)
        level.smooth(scale, spare, load, keep, gain, step, u)
        level.residual(u, load, spare)
        coarse_load = self.workspace.array("load", self.levels[number + 1].free.shape)
        stencils.restrict(spare, coarse_load)
        correction = self._cycle(number + 1, coarse_load)
        stencils.add_interpolated(correction, level.span, level.free, u)
        level.smooth(scale, u, load, np.float32(0.0), first_gain, step, spare)
        level.smooth(scale, spare, load, keep, gain, step, u)
        return u


def _chebyshev_factors(high: float) -> tuple[tuple[np.float32, np.float32], ...]:
    """(keep, gain) of two Chebyshev steps (Saad 2003, Iterative Methods, algorithm 12.1)."""
    low = high / SMOOTHED_PART
    middle, half = (high + low) / 2.0, (high - low) / 2.0
    sigma = middle / half
    first = 1.0 / sigma
    second = 1.0 / (2.0 * sigma - first)
    return (
        (np.float32(0.0), np.float32(1.0 / middle)),
        (np.float32(second * first), np.float32(2.0 * second / half)),
    )


def _scale_of(level: Level) -> NDArray[np.float32]:
    """Inverse of the diagonal where a node moves, else 0."""
    scale = np.empty(level.free.shape, np.float32)
    vectors.masked_inverse(level.free, level.diagonal, scale)
    return scale


def _dense(level: Level, nodes: NDArray[np.intp]) -> NDArray[np.float64]:
    """Matrix among `nodes` of a level, a column a unit vector."""
    matrix = np.empty((nodes.size, nodes.size))
    unit, out = np.zeros_like(level.diagonal), np.zeros_like(level.diagonal)
    for column, node in enumerate(nodes):
        unit.reshape(-1)[node] = -1.0
        level.residual(unit, None, out)
        matrix[:, column] = out.reshape(-1)[nodes]
        unit.reshape(-1)[node] = 0.0
    return matrix


def conjugate_gradients(
    multigrid: Multigrid,
    force: Field,
    tolerance: float,
    reduction: float,
    max_iterations: int,
) -> tuple[Field, float]:
    """Displacement that balances a force, by conjugate gradients with a V-cycle before each step.

    Parameters
    ----------
    multigrid : Multigrid
    force : ndarray of float32
        Out-of-balance force of each node; it is overwritten by what remains.
    tolerance : float
        Stop where the largest component of the V-cycle's answer to the remaining force, an
        estimate of the largest error left, is below this, lattice units.
    reduction : float
        Or where that estimate is below this part of its first value.
    max_iterations : int

    Returns
    -------
    correction : ndarray of float32
        Work space; the last answer of the V-cycle is in it too.
    error : float
        Last error estimate, from before that answer was added, lattice units.
    """
    correction, direction, image = (  # between two V-cycles their work space is free
        multigrid.workspace.array(name, force.shape)
        for name in ("correction", "direction", "spare")
    )
    correction.fill(0.0)
    previous, error, goal = 0.0, np.inf, tolerance
    for iteration in range(max_iterations + 1):
        guess = multigrid.precondition(force)
        error = vectors.largest(guess)
        if iteration == 0:
            goal = max(tolerance, reduction * error)
        if error <= goal or iteration == max_iterations:
            vectors.add_scaled(np.float32(1.0), guess, correction)
            break
        product = vectors.dot(force, guess)
        ratio = product / previous if iteration else 0.0
        vectors.scale_and_add(np.float32(ratio), guess, direction)
        multigrid.finest.residual(direction, None, image)  # image = -A direction
        length = -product / vectors.dot(direction, image)
        vectors.add_scaled(np.float32(length), direction, correction)
        vectors.add_scaled(np.float32(length), image, force)
        previous = product
    return correction, float(error)
