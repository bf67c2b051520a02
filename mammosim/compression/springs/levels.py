"""Levels of the multigrid hierarchy: the lattice itself, and the stencils of the coarser ones.

The lattice stores no operator; coarser levels hold the Galerkin product (Briggs, Henson & McCormick
2000, A Multigrid Tutorial, chapter 10).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs import _stencil_kernels as stencils
from mammosim.compression.springs.problem import SpringProblem, columns_span

LATTICE_EIGENVALUE = 1.5
"""Largest of D^-1 A on the lattice. In the bulk it is 1 + 10/26 = 1.38 (cosine symbol of the
26-point Laplacian); 1.40 was measured with mixed tissues, and it is never above 2 (Gershgorin)."""

STENCIL_EIGENVALUE = 2.4
"""Largest of D^-1 A on Galerkin levels: 2.31 to 2.36 was measured on three of them."""

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
        stencil = np.zeros((14, *_next_shape(self.span)), np.float32)
        stencils.galerkin_of_lattice(self.springs, self.diagonal, self.free, self.span, stencil)
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
        moving = diagonal > 0.0
        return cls(stencil, columns_span(moving), diagonal, moving.astype(np.float32))

    def residual(self, u: Field, load: Field | None, out: Field) -> None:
        """``out = load - A u``."""
        stencils.stencil_residual(self.stencil, self.span, u, load, out)

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
        stencils.stencil_smooth(self.stencil, self.span, scale, u, load, keep, gain, step, out)

    def coarsened(self) -> StencilLevel:
        """The Galerkin operator of the next level."""
        coarse = np.zeros((14, *_next_shape(self.span)), np.float32)
        stencils.galerkin_of_stencil(self.stencil, self.span, coarse)
        return StencilLevel.of(coarse)


Level = LatticeLevel | StencilLevel


def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the next level, layer around included: coarse node J lies on fine node 2 J - 1."""
    return tuple((n - 2) // 2 + 3 for n in shape)


def whole_rows(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape with room for whole vectors along z between the layers around."""
    vectors = -(-(shape[2] - 2) // lattice.VECTOR)
    return (*shape[:2], vectors * lattice.VECTOR + 2)


def _next_shape(span: NDArray[np.int32]) -> tuple[int, ...]:
    """Shape of the next level, with whole rows, of which no more than `span` is used along z."""
    return whole_rows(coarse_shape((*span.shape[:2], int(span[..., 1].max()) + 1)))
