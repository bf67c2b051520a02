"""Levels of three unknowns a node: symmetric 27-point stencils of 3 x 3 blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.multigrid import _block_kernels as blocks
from mammosim.compression.multigrid import transfers
from mammosim.compression.multigrid._bundle_kernels import (
    BUNDLE,
    Bundles,
    block_residual,
    block_smooth,
    fill_bundles,
)
from mammosim.compression.multigrid.cycle import Cycle
from mammosim.compression.multigrid.grids import coarse_shape, row_spans
from mammosim.compression.multigrid.scalar_level import DEPENDENT_SHIFT
from mammosim.compression.multigrid.workspace import Field, Workspace

POWER_STEPS = 8
"""Of the power iteration for the largest eigenvalue."""


@dataclass(frozen=True, eq=False)
class BlockLevel:
    """A level of a displacement's three components; see `Level` for what its methods do.

    Parameters
    ----------
    stencil : ndarray of float32, [x, y, 126, z]
        Blocks of the operator.
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index that is used.
    inverse : ndarray of float32, [x, y, 6, z]
        Inverse of each node's own block.
    free : ndarray of float32, [3, x, y, z]
        1 where a displacement moves, else 0.
    bundles : Bundles
        The stencil as products with it read it.
    workspace : Workspace
        Holds the stencils of the levels.
    """

    stencil: NDArray[np.float32]
    span: NDArray[np.int32]
    inverse: NDArray[np.float32]
    free: NDArray[np.float32]
    bundles: Bundles
    workspace: Workspace
    # The coarsest matrix is factorised at each Newton step: 3 ms for 500 unknowns, 0.3 ms for 150.
    cycle: ClassVar[Cycle] = Cycle(smoothed_part=8.0, smoothings=2, coarsest=200)

    @classmethod
    def of(
        cls, stencil: NDArray[np.float32], span: NDArray[np.int32], workspace: Workspace
    ) -> BlockLevel:
        """Level of a stencil [x, y, 126, z]."""
        nx, ny, _, nz = stencil.shape
        inverse = np.zeros((nx, ny, 6, nz), np.float32)
        blocks.invert_blocks(stencil, span, inverse)
        free = np.stack([inverse[:, :, e] > 0.0 for e in (0, 3, 5)]).astype(np.float32)
        bundles = bundles_of(stencil, span, workspace)
        return cls(stencil, span, inverse, free, bundles, workspace)

    def residual(self, u: Field, load: Field, out: Field) -> None:
        """``out = load - A u``."""
        block_residual(self.bundles, u, load, out)

    def image(self, direction: Field, workspace: Workspace) -> Field:
        """``-A direction``."""
        out, nothing = (workspace.array(name, direction.shape) for name in ("image", "nothing"))
        out.fill(0.0)
        self.residual(direction, nothing, out)
        return out

    def first_step(self, load: Field, gain: np.float32, step: Field, out: Field) -> None:
        """``step = out = gain D^-1 load``."""
        blocks.block_scaled(self.inverse, self.span, load, gain, step)
        out[...] = step

    def smooth(
        self, u: Field, load: Field, keep: np.float32, gain: np.float32, step: Field, out: Field
    ) -> None:
        """One Chebyshev step from `u` to `out`."""
        block_smooth(self.bundles, self.inverse, u, load, keep, gain, step, out)

    def restrict(self, fine: Field, out: Field) -> None:
        """Residual of this level to the load of the next."""
        transfers.restrict(fine, out)

    def add_interpolated(self, coarse: Field, out: Field) -> None:
        """Add a correction of the next level to a field of this one."""
        transfers.add_interpolated(coarse, self.span, self.free, out)

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
        coarse = self.workspace.array("stencil", (shape[0], shape[1], 126, shape[2]))
        coarse.fill(0.0)
        blocks.galerkin_of_blocks(self.stencil, self.span, coarse)
        some = (coarse[:, :, 0] != 0.0) | (coarse[:, :, 4] != 0.0) | (coarse[:, :, 8] != 0.0)
        return BlockLevel.of(coarse, row_spans(some), self.workspace)

    def factorised(self, moving: NDArray[np.intp]) -> Any:
        """Cholesky factor of the matrix among the displacements `moving`."""
        return _factorised(self.matrix(moving))


def bundles_of(
    stencil: NDArray[np.float32], span: NDArray[np.int32], workspace: Workspace
) -> Bundles:
    """A stencil [x, y, 126, z] as products with it read it.

    Parameters
    ----------
    stencil : ndarray of float32, [x, y, 126, z]
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index that is used.
    workspace : Workspace
        Holds the copy.
    """
    count = -(-(span[..., 1] - span[..., 0]).astype(np.int64) // BUNDLE)
    start = (np.cumsum(count) - count.ravel()).reshape(count.shape)
    copy = workspace.array(f"bundles of {stencil.shape}", (int(count.sum()), 126 * BUNDLE))
    fill_bundles(stencil, span, start, copy)
    return Bundles(span, start, copy)


def clear(stencil: NDArray[np.float32], span: NDArray[np.int32]) -> None:
    """Empty the part of a stencil that is used.

    Parameters
    ----------
    stencil : ndarray of float32, [x, y, 126, z]
        It is changed.
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index that is used.
    """
    blocks.clear(span, stencil)


def hold(
    stencil: NDArray[np.float32],
    span: NDArray[np.int32],
    free: NDArray[np.float32],
    held: NDArray[np.bool_],
) -> None:
    """Empty the rows and columns of held displacements.

    Parameters
    ----------
    stencil : ndarray of float32, [x, y, 126, z]
        It is changed.
    span : ndarray of int32, [x, y, 2]
        First and one past the last z index that is used.
    free : ndarray of float32, [3, x, y, z]
        1 where a displacement moves, else 0.
    held : ndarray of bool, [x, y]
        Rows with displacements that are held.
    """
    blocks.hold(stencil, span, free, held)


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
