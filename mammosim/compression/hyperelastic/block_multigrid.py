"""Geometric multigrid for block stencils, as a preconditioner of conjugate gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.hyperelastic import _block_kernels as blocks
from mammosim.compression.springs import _stencil_kernels as stencils
from mammosim.compression.springs import _vector_kernels as vectors
from mammosim.compression.springs.multigrid import DEPENDENT_SHIFT, Workspace, coarse_shape

COARSEST = 600
"""A level with no more moving displacements than this is solved directly."""

SMOOTHED_PART = 12.0
"""The smoother acts on eigenvalues from the largest down to the largest over this."""

SMOOTHINGS = 3
"""Chebyshev steps before and after each coarse correction."""

POWER_STEPS = 8
"""Of the power iteration for the largest eigenvalue."""

_WORK = ("correction", "direction", "image", "nothing")

Field = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BlockLevel:
    """One level: its stencil, the rows it covers, and the inverse of its diagonal blocks."""

    stencil: Field
    span: NDArray[np.int32]
    inverse: Field
    free: Field
    """[3, x, y, z], 1 where a displacement moves."""

    @classmethod
    def of(cls, stencil: Field, span: NDArray[np.int32]) -> BlockLevel:
        """Level of a stencil [x, y, 126, z]."""
        nx, ny, _, nz = stencil.shape
        inverse = np.zeros((nx, ny, 6, nz), np.float32)
        blocks.invert_blocks(stencil, span, inverse)
        free = np.stack([inverse[:, :, e] > 0.0 for e in (0, 3, 5)]).astype(np.float32)
        return cls(stencil, span, inverse, free)

    def residual(self, u: Field, load: Field, out: Field) -> None:
        """``out = load - A u``."""
        blocks.block_residual(self.stencil, self.span, u, load, out)

    def largest_eigenvalue(self) -> float:
        """Of D^-1 A, by power iteration from a rough vector; 15 % more than it finds."""
        vector = self.free * np.random.default_rng(0).standard_normal(self.free.shape, np.float32)
        image, scaled, nothing = (np.zeros_like(self.free) for _ in range(3))
        value = 1.0
        for _ in range(POWER_STEPS):
            vector /= np.float32(max(float(np.abs(vector).max()), 1e-30))
            self.residual(vector, nothing, image)
            blocks.block_scaled(self.inverse, self.span, image, np.float32(-1.0), scaled)
            value = float(np.linalg.norm(scaled)) / max(float(np.linalg.norm(vector)), 1e-30)
            vector, scaled = scaled, vector
        return 1.15 * value

    def matrix(self, moving: NDArray[np.intp]) -> NDArray[np.float64]:
        """Matrix among the displacements `moving`, flat indices of [3, x, y, z]."""
        number = np.full(self.free.size, -1, np.int64)
        number[moving] = np.arange(moving.size)
        out = np.zeros((moving.size, moving.size))
        blocks.dense_matrix(self.stencil, number.reshape(self.free.shape), out)
        return out

    def coarsened(self) -> BlockLevel:
        """The Galerkin operator of the next level."""
        shape = coarse_shape(self.free.shape[1:])
        coarse = np.zeros((shape[0], shape[1], 126, shape[2]), np.float32)
        blocks.galerkin_of_blocks(self.stencil, self.span, coarse)
        some = (coarse[:, :, 0] != 0.0) | (coarse[:, :, 4] != 0.0) | (coarse[:, :, 8] != 0.0)
        first, last = some.argmax(axis=2), some.shape[2] - some[:, :, ::-1].argmax(axis=2)
        rows = some.any(axis=2)
        span = np.stack([np.where(rows, first, 0), np.where(rows, last, 0)], axis=2)
        return BlockLevel.of(coarse, span.astype(np.int32))


class BlockMultigrid:
    """A hierarchy of levels; `precondition` is one V-cycle.

    Parameters
    ----------
    finest : BlockLevel
    workspace : Workspace
    eigenvalues : list of float, optional
        Largest of each level, from a hierarchy that is much the same; else they are estimated.
    """

    def __init__(
        self, finest: BlockLevel, workspace: Workspace, eigenvalues: list[float] | None = None
    ) -> None:
        self.workspace = workspace
        self.levels = [finest]
        while np.count_nonzero(self.levels[-1].free) > COARSEST:
            self.levels.append(self.levels[-1].coarsened())
        if not eigenvalues or len(eigenvalues) < len(self.levels):
            eigenvalues = [level.largest_eigenvalue() for level in self.levels]
        self.eigenvalues = eigenvalues
        self._factors = [_chebyshev(value) for value in eigenvalues]
        self._moving = np.flatnonzero(self.levels[-1].free)
        self._factor = _factorised(self.levels[-1].matrix(self._moving))

    def precondition(self, load: Field) -> Field:
        """One symmetric V-cycle from zero, about A^-1 load; the result is work space."""
        return self._cycle(0, load)

    def _cycle(self, number: int, load: Field) -> Field:
        level, shape = self.levels[number], load.shape
        u = self.workspace.array("u", shape)
        if number == len(self.levels) - 1:
            u.fill(0.0)
            u.reshape(-1)[self._moving] = scipy.linalg.cho_solve(
                self._factor, load.reshape(-1)[self._moving]
            )
            return u
        spare, step = (self.workspace.array(name, shape) for name in ("spare", "step"))
        factors = self._factors[number]
        blocks.block_scaled(level.inverse, level.span, load, factors[0][1], step)
        spare[...] = step
        spare, u = self._smooth(level, factors[1:], load, step, spare, u)
        level.residual(spare, load, u)
        coarse_load = self.workspace.array("load", (3, *coarse_shape(shape[1:])))
        for d in range(3):
            stencils.restrict(u[d], coarse_load[d])
        correction = self._cycle(number + 1, coarse_load)
        for d in range(3):
            stencils.add_interpolated(correction[d], level.span, level.free[d], spare[d])
        spare, u = self._smooth(level, factors, load, step, spare, u)
        return spare

    def _smooth(
        self,
        level: BlockLevel,
        factors: Sequence[tuple[np.float32, np.float32]],
        load: Field,
        step: Field,
        source: Field,
        target: Field,
    ) -> tuple[Field, Field]:
        """Chebyshev steps from `source`; where the result is, and the array that is free."""
        for keep, gain in factors:
            blocks.block_smooth(
                level.stencil, level.span, level.inverse, source, load, keep, gain, step, target
            )
            source, target = target, source
        return source, target


def _chebyshev(high: float) -> tuple[tuple[np.float32, np.float32], ...]:
    """(keep, gain) of the Chebyshev steps (Saad 2003, Iterative Methods, algorithm 12.1)."""
    low = high / SMOOTHED_PART
    middle, half = (high + low) / 2.0, (high - low) / 2.0
    sigma, factors = middle / half, [(np.float32(0.0), np.float32(1.0 / middle))]
    rho = 1.0 / sigma
    for _ in range(SMOOTHINGS - 1):
        following = 1.0 / (2.0 * sigma - rho)
        factors.append((np.float32(following * rho), np.float32(2.0 * following / half)))
        rho = following
    return tuple(factors)


def _factorised(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool]:
    """Cholesky factor of a symmetric matrix; negative eigenvalues count as positive ones."""
    try:
        factor: tuple[NDArray[np.float64], bool] = scipy.linalg.cho_factor(
            matrix + DEPENDENT_SHIFT * np.diag(np.diag(matrix))
        )
    except np.linalg.LinAlgError:
        values, basis = scipy.linalg.eigh(matrix)
        values = np.maximum(np.abs(values), 1e-4 * values[-1])
        factor = scipy.linalg.cho_factor((basis * values) @ basis.T)
    return factor


def conjugate_gradients(
    multigrid: BlockMultigrid, force: Field, reduction: float, max_iterations: int
) -> tuple[Field, bool, int]:
    """Displacement that balances a force, by conjugate gradients with a V-cycle before each step.

    Parameters
    ----------
    multigrid : BlockMultigrid
    force : ndarray of float32, [3, x, y, z]
        It is overwritten by what remains.
    reduction : float
        Part of the residual (in the norm of the V-cycle) at which to stop.
    max_iterations : int

    Returns
    -------
    correction : ndarray of float32, [3, x, y, z]
        Work space.
    positive : bool
        Whether the operator and the V-cycle proved positive definite; the correction is that of
        the steps before, or the first direction if there were none.
    iterations : int
    """
    shape = (3 * force.shape[1], *force.shape[2:])
    work = [multigrid.workspace.array(name, force.shape) for name in _WORK]
    for array in work:
        array.fill(0.0)
    correction, direction, image, _ = (array.reshape(shape) for array in work)
    force_rows, previous, first = force.reshape(shape), 0.0, 0.0
    for iteration in range(max_iterations + 1):
        guess = multigrid.precondition(force).reshape(shape)
        product = vectors.dot(force_rows, guess)
        first = product if iteration == 0 else first
        if 0.0 <= product <= reduction**2 * first or iteration == max_iterations:
            return work[0], True, iteration
        ratio = product / previous if iteration else 0.0
        vectors.scale_and_add(np.float32(ratio), guess, direction)
        multigrid.levels[0].residual(work[1], work[3], work[2])  # image = -A direction
        curvature = -vectors.dot(direction, image)
        if product < 0.0 or curvature <= 0.0:
            break
        length = product / curvature
        vectors.add_scaled(np.float32(length), direction, correction)
        vectors.add_scaled(np.float32(length), image, force_rows)
        previous = product
    if iteration == 0:
        vectors.add_scaled(np.float32(1.0), direction, correction)
    return work[0], False, iteration
