"""Geometric multigrid for lattices, as a preconditioner of conjugate gradients, of every model."""

from mammosim.compression.multigrid.block_level import BlockLevel, clear, hold
from mammosim.compression.multigrid.conjugate_gradients import (
    ErrorBelow,
    ResidualBelow,
    Solved,
    conjugate_gradients,
)
from mammosim.compression.multigrid.cycle import Cycle, Level, Multigrid, v_cycle
from mammosim.compression.multigrid.grids import coarse_shape, row_spans, whole_rows
from mammosim.compression.multigrid.scalar_level import Operator, ScalarLevel, stencil_level
from mammosim.compression.multigrid.transfers import add_interpolated, restrict
from mammosim.compression.multigrid.truncated_gradients import (
    MIN_RITZ,
    Truncated,
    truncated_gradients,
)
from mammosim.compression.multigrid.workspace import Field, Workspace

__all__ = [
    "MIN_RITZ",
    "BlockLevel",
    "Cycle",
    "ErrorBelow",
    "Field",
    "Level",
    "Multigrid",
    "Operator",
    "ResidualBelow",
    "ScalarLevel",
    "Solved",
    "Truncated",
    "Workspace",
    "add_interpolated",
    "clear",
    "coarse_shape",
    "conjugate_gradients",
    "hold",
    "restrict",
    "row_spans",
    "stencil_level",
    "truncated_gradients",
    "v_cycle",
    "whole_rows",
]
