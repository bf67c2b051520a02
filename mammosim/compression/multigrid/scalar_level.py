"""Levels of one unknown a node: a lattice of springs, or symmetric 27-point stencils."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.multigrid import _stencil_kernels as stencils
from mammosim.compression.multigrid import _transfer_kernels as transfers
from mammosim.compression.multigrid import _vector_kernels as vectors
from mammosim.compression.multigrid.cycle import Cycle
from mammosim.compression.multigrid.grids import coarse_shape, row_spans, whole_rows
from mammosim.compression.multigrid.workspace import Field, Workspace

STENCIL_EIGENVALUE = 2.4
"""Largest of D^-1 A on Galerkin levels: 2.31 to 2.36 was measured on three of them."""

DEPENDENT_SHIFT = 1e-5
"""Added to the coarsest diagonal, relative: far above single-precision rounding, far below need.
Held nodes can leave coarse functions linearly dependent; their difference is then moot."""


class Operator(Protocol):
    """A symmetric positive definite operator A, the same for each component of a displacement."""

    largest_eigenvalue: ClassVar[float]

    def residual(self, level: ScalarLevel, u: Field, load: Field | None, out: Field) -> None:
        """``out = load - A u`` where nodes move; no load if None."""
        ...

    def smooth(
        self,
        level: ScalarLevel,
        u: Field,
        load: Field,
        keep: np.float32,
        gain: np.float32,
        step: Field,
        out: Field,
    ) -> None:
        """``step = keep step + gain D^-1 (load - A u)``; ``out = u + step``."""
        ...

    def galerkin(self, level: ScalarLevel, out: NDArray[np.float32]) -> None:
        """Stencil [14, x, y, z] of the next level, ``P^T A P``."""
        ...


@dataclass(frozen=True, eq=False)
class ScalarLevel:
    """A level of one unknown a node; see `Level` for what its methods do.

    Parameters
    ----------
    operator : Operator
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index that is used.
    diagonal : ndarray of float32, [x, y, z]
        Of the operator.
    free : ndarray of float32, [x, y, z]
        1 where a node may move, else 0.
    """

    operator: Operator
    span: NDArray[np.int32]
    diagonal: Field
    free: Field
    cycle: ClassVar[Cycle] = Cycle(smoothed_part=4.0, smoothings=2, coarsest=200)

    @cached_property
    def scale(self) -> NDArray[np.float32]:
        """Inverse of the diagonal where a node moves, else 0."""
        scale = np.empty(self.free.shape, np.float32)
        vectors.masked_inverse(self.free, self.diagonal, scale)
        return scale

    def residual(self, u: Field, load: Field | None, out: Field) -> None:
        """``out = free * (load - A u)``; no load if None."""
        self.operator.residual(self, u, load, out)

    def image(self, direction: Field, workspace: Workspace) -> Field:
        """``-A direction``; between two V-cycles their work space is free."""
        out = workspace.array("spare", direction.shape)
        self.residual(direction, None, out)
        return out

    def first_step(self, load: Field, gain: np.float32, step: Field, out: Field) -> None:
        """``step = out = gain D^-1 load``."""
        vectors.scaled_twice(self.scale, load, gain, step, out)

    def smooth(
        self, u: Field, load: Field, keep: np.float32, gain: np.float32, step: Field, out: Field
    ) -> None:
        """One Chebyshev step from `u` to `out`."""
        self.operator.smooth(self, u, load, keep, gain, step, out)

    def restrict(self, fine: Field, out: Field) -> None:
        """Residual of this level to the load of the next."""
        transfers.restrict(fine, out)

    def add_interpolated(self, coarse: Field, out: Field) -> None:
        """Add a correction of the next level to a field of this one."""
        transfers.add_interpolated(coarse, self.span, self.free, out)

    def largest_eigenvalue(self) -> float:
        """Of D^-1 A."""
        return self.operator.largest_eigenvalue

    def coarsened(self) -> ScalarLevel:
        """The Galerkin operator of the next level, with whole rows along z."""
        used = (*self.span.shape[:2], int(self.span[..., 1].max()) + 1)
        stencil = np.zeros((14, *whole_rows(coarse_shape(used))), np.float32)
        self.operator.galerkin(self, stencil)
        return stencil_level(stencil)

    def factorised(self, moving: NDArray[np.intp]) -> Any:
        """Cholesky factor of the matrix among the nodes `moving`."""
        matrix = _dense(self, moving)
        matrix[np.diag_indices_from(matrix)] *= 1.0 + DEPENDENT_SHIFT
        return scipy.linalg.cho_factor(matrix)


@dataclass(frozen=True, eq=False)
class StencilOperator:
    """A stored operator: of 27 coefficients a node 14, [14, x, y, z]."""

    stencil: NDArray[np.float32]
    largest_eigenvalue: ClassVar[float] = STENCIL_EIGENVALUE

    def residual(self, level: ScalarLevel, u: Field, load: Field | None, out: Field) -> None:
        """``out = load - A u``."""
        stencils.stencil_residual(self.stencil, level.span, u, load, out)

    def smooth(
        self,
        level: ScalarLevel,
        u: Field,
        load: Field,
        keep: np.float32,
        gain: np.float32,
        step: Field,
        out: Field,
    ) -> None:
        """One Chebyshev step from `u` to `out`."""
        stencils.stencil_smooth(
            self.stencil, level.span, level.scale, u, load, keep, gain, step, out
        )

    def galerkin(self, level: ScalarLevel, out: NDArray[np.float32]) -> None:
        """Stencil of the next level."""
        stencils.galerkin_of_stencil(self.stencil, level.span, out)


def stencil_level(stencil: NDArray[np.float32]) -> ScalarLevel:
    """Level of a stencil [14, x, y, z]; nodes with an empty row do not move."""
    diagonal = stencil[0]
    moving = diagonal > 0.0
    return ScalarLevel(
        StencilOperator(stencil), row_spans(moving), diagonal, moving.astype(np.float32)
    )


def _dense(level: ScalarLevel, nodes: NDArray[np.intp]) -> NDArray[np.float64]:
    """Matrix among `nodes` of a level, a column a unit vector."""
    matrix = np.empty((nodes.size, nodes.size))
    unit, out = np.zeros_like(level.diagonal), np.zeros_like(level.diagonal)
    for column, node in enumerate(nodes):
        unit.reshape(-1)[node] = -1.0
        level.residual(unit, None, out)
        matrix[:, column] = out.reshape(-1)[nodes]
        unit.reshape(-1)[node] = 0.0
    return matrix
