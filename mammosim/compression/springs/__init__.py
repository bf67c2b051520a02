"""The spring model: every voxel a node, tied to its 26 neighbours."""

from mammosim.compression.springs.deviation import remaining_deviation
from mammosim.compression.springs.problem import SpringProblem, SpringState
from mammosim.compression.springs.relaxation import relax
from mammosim.compression.springs.solver import solve

__all__ = [
    "SpringProblem",
    "SpringState",
    "relax",
    "remaining_deviation",
    "solve",
]
