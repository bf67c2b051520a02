"""Geometric multigrid for the spring lattice, as a preconditioner of conjugate gradients.

The three components share one operator, the weighted graph Laplacian of the lattice: symmetric,
positive definite, an M-matrix. A V-cycle smooths with Chebyshev polynomials of the Jacobi
iteration, coarsens by two with trilinear interpolation, and forms the coarse operators by the
Galerkin product (Briggs, Henson & McCormick 2000, A Multigrid Tutorial, chapters 5 and 10). The
finest level stores no springs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs import _stencil_kernels as stencils
from mammosim.compression.springs import _vector_kernels as vectors
from mammosim.compression.springs.problem import SpringProblem

COARSEST_NODES = 200
"""A level with no more moving nodes than this is solved directly."""

LATTICE_EIGENVALUE = 1.5
"""Largest of D^-1 A on the lattice. In the bulk it is 1 + 10/26 = 1.38 (cosine symbol of the
26-point Laplacian); 1.40 was measured with mixed tissues, and it is never above 2 (Gershgorin)."""

STENCIL_EIGENVALUE = 2.4
"""Largest of D^-1 A on Galerkin levels: 2.31 to 2.36 was measured on three of them."""

SMOOTHED_PART = 4.0
"""The smoother acts on eigenvalues from the largest down to the largest over this."""

DEPENDENT_SHIFT = 1e-5
"""Added to the coarsest diagonal, relative: far above single-precision rounding, far below need."""

Field = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class LatticeLevel:
    """The finest level: nodes' moduli in place of an operator, or each spring's stiffness.

    Parameters
    ----------
    springs : ndarray of float32, [x, y, z] or [13, x, y, z]
        Modulus of each node, or stiffness of each spring, kPa; 0 in air and in the layer around.
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index with tissue.
    diagonal : ndarray of float32, [x, y, z]
        Sum of the stiffness of each node's springs.
    free : ndarray of float32, [x, y, z]
        1 where a node may move, else 0.
    """

    springs: Field
    span: NDArray[np.int32]
    diagonal: Field
    free: Field
    largest_eigenvalue: ClassVar[float] = LATTICE_EIGENVALUE

    @classmethod
    def of(cls, problem: SpringProblem) -> LatticeLevel:
        """Level of a lattice of which nothing but its fixed nodes is held."""
        springs = problem.modulus if problem.stiffness is None else problem.stiffness
        span, diagonal = problem.span(), np.zeros_like(problem.modulus)
        lattice.lattice_diagonal(springs, span, diagonal)
        return cls(springs, span, diagonal, (problem.tissue & ~problem.fixed).astype(np.float32))

    def residual(self, u: Field, load: Field | None, out: Field) -> None:
        """``out = free * (load - A u)``."""
        lattice.lattice_residual(self.springs, self.span, self.free, u, load, out)

    def smooth(
        self,
        scale: Field,
        u: Field,
        load: Field,
        keep: np.float32,
        gain: np.float32,
        step: Field,
        out: Field,
    ) -> None:
        """One Chebyshev step from `u` to `out`."""
        lattice.lattice_smooth(self.springs, self.span, scale, u, load, keep, gain, step, out)

    def coarsened(self) -> StencilLevel:
        """The Galerkin operator of the next level."""
        stencil = np.zeros((14, *coarse_shape(self.free.shape)), np.float32)
        stencils.galerkin_of_lattice(self.springs, self.diagonal, self.free, stencil)
        return StencilLevel.of(stencil)


@dataclass(frozen=True, eq=False)
class StencilLevel:
    """A coarse level: symmetric 27-point stencils, 14 coefficients stored."""

    stencil: NDArray[np.float32]
    span: NDArray[np.int32]
    diagonal: Field
    free: Field
    largest_eigenvalue: ClassVar[float] = STENCIL_EIGENVALUE

    @classmethod
    def of(cls, stencil: NDArray[np.float32]) -> StencilLevel:
        """Level of a stencil [14, x, y, z]; nodes with an empty row do not move."""
        diagonal = stencil[0]
        span = np.zeros((*diagonal.shape[:2], 2), np.int32)
        span[1:-1, 1:-1] = (1, diagonal.shape[2] - 1)
        return cls(stencil, span, diagonal, (diagonal > 0.0).astype(np.float32))

    def residual(self, u: Field, load: Field | None, out: Field) -> None:
        """``out = load - A u``."""
        stencils.stencil_residual(self.stencil, u, load, out)

    def smooth(
        self,
        scale: Field,
        u: Field,
        load: Field,
        keep: np.float32,
        gain: np.float32,
        step: Field,
        out: Field,
    ) -> None:
        """One Chebyshev step from `u` to `out`."""
        stencils.stencil_smooth(self.stencil, scale, u, load, keep, gain, step, out)

    def coarsened(self) -> StencilLevel:
        """The Galerkin operator of the next level."""
        coarse = np.zeros((14, *coarse_shape(self.diagonal.shape)), np.float32)
        stencils.galerkin_of_stencil(self.stencil, coarse)
        return StencilLevel.of(coarse)


Level = LatticeLevel | StencilLevel


def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the next level, layer around included: coarse node J lies on fine node 2 J - 1."""
    return tuple((n - 2) // 2 + 3 for n in shape)


class Workspace:
    """Arrays that hierarchies of one lattice share, since only one of them works at a time."""

    def __init__(self) -> None:
        self._arrays: dict[tuple[str, tuple[int, ...]], Field] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Field:
        """The array of a name and shape; zero where nothing has written."""
        return self._arrays.setdefault((name, shape), np.zeros(shape, np.float32))


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
        self._scale = [_inverse_where(level.free, level.diagonal) for level in self.levels]
        self._nodes = np.flatnonzero(self.levels[-1].free)
        matrix = _dense(self.levels[-1], self._nodes)
        # Held nodes can leave coarse functions linearly dependent; their difference is then moot.
        matrix[np.diag_indices_from(matrix)] *= 1.0 + DEPENDENT_SHIFT
        self._factor = scipy.linalg.cho_factor(matrix)

    def replace_finest(self, finest: LatticeLevel) -> None:
        """Change which nodes move, leaving the coarse operators as they are."""
        self.levels[0] = self.finest = finest
        self._scale[0] = _inverse_where(finest.free, finest.diagonal)

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
        vectors.scaled_rows(scale, load, first_gain, step)
        spare[...] = step
        level.smooth(scale, spare, load, keep, gain, step, u)
        level.residual(u, load, spare)
        coarse_load = self.workspace.array("load", coarse_shape(shape))
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


def _inverse_where(free: Field, diagonal: Field) -> Field:
    return np.divide(free, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)


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
    correction, direction, image = (
        multigrid.workspace.array(name, force.shape)
        for name in ("correction", "direction", "image")
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
