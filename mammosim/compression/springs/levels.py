"""The finest level of the springs' multigrid: the lattice itself, which stores no operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid import Field, ScalarLevel
from mammosim.compression.multigrid import _stencil_kernels as stencils
from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs.problem import SpringProblem

LATTICE_EIGENVALUE = 1.5
"""Largest of D^-1 A on the lattice. In the bulk it is 1 + 10/26 = 1.38 (cosine symbol of the
26-point Laplacian); 1.40 was measured with mixed tissues, and it is never above 2 (Gershgorin)."""


@dataclass(frozen=True, eq=False)
class LatticeOperator:
    """The weighted graph Laplacian of a lattice: nodes' moduli, or each spring's stiffness.

    Each component of the displacement has the same; it is an M-matrix.

    Parameters
    ----------
    springs : ndarray of float32, [x, y, z] or [13, x, y, z]
        Modulus of each node, or stiffness of each spring, kPa; 0 in air and in the layer around.
    """

    springs: Field
    largest_eigenvalue: ClassVar[float] = LATTICE_EIGENVALUE

    def residual(self, level: ScalarLevel, u: Field, load: Field | None, out: Field) -> None:
        """``out = free * (load - A u)``."""
        lattice.lattice_residual(self.springs, level.span, level.free, u, load, out)

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
        lattice.lattice_smooth(
            self.springs, level.span, level.scale, u, load, keep, gain, step, out
        )

    def galerkin(self, level: ScalarLevel, out: NDArray[np.float32]) -> None:
        """Stencil of the next level."""
        stencils.galerkin_of_lattice(self.springs, level.diagonal, level.free, level.span, out)


def lattice_level(springs: Field, span: NDArray[np.int32], free: Field) -> ScalarLevel:
    """Level of a lattice.

    Parameters
    ----------
    springs : ndarray of float32, [x, y, z] or [13, x, y, z]
        As `LatticeOperator` takes them.
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index with tissue.
    free : ndarray of float32, [x, y, z]
        1 where a node may move, else 0.
    """
    diagonal = np.zeros(free.shape, np.float32)
    lattice.lattice_diagonal(springs, span, diagonal)
    return ScalarLevel(LatticeOperator(springs), span, diagonal, free)


def level_of(problem: SpringProblem) -> ScalarLevel:
    """Level of a lattice of which nothing but its fixed nodes is held."""
    free = (problem.tissue & ~problem.fixed).astype(np.float32)
    return lattice_level(problem.springs, problem.span(), free)
