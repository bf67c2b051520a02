"""The V-cycle: smoothing and coarse correction on nested levels.

A cycle smooths with Chebyshev polynomials of the (block) Jacobi iteration and coarsens by two with
trilinear interpolation and Galerkin products (Briggs, Henson & McCormick 2000, A Multigrid
Tutorial, chapters 5 and 10). What an operator is, only its level knows.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from mammosim.compression.multigrid.workspace import Field, Workspace

Steps = tuple[tuple[np.float32, np.float32], ...]


@dataclass(frozen=True)
class Cycle:
    """How a V-cycle works on one kind of level.

    Parameters
    ----------
    smoothed_part : float
        The smoother acts on eigenvalues from the largest down to the largest over this.
    smoothings : int
        Chebyshev steps before and after each coarse correction.
    coarsest : int
        A level with no more unknowns that move than this is solved directly.
    """

    smoothed_part: float
    smoothings: int
    coarsest: int


class Level(Protocol):
    """One level: an operator A on fields of one shape, and the diagonal D that smooths it."""

    cycle: ClassVar[Cycle]

    @property
    def free(self) -> Any:
        """1 where an unknown moves, else 0."""
        ...

    def residual(self, u: Field, load: Any, out: Field) -> None:
        """``out = load - A u``."""
        ...

    def image(self, direction: Field, workspace: Workspace) -> Field:
        """``-A direction``, in work space."""
        ...

    def first_step(self, load: Field, gain: np.float32, step: Field, out: Field) -> None:
        """``step = out = gain D^-1 load``: a Chebyshev step from zero."""
        ...

    def smooth(
        self, u: Field, load: Field, keep: np.float32, gain: np.float32, step: Field, out: Field
    ) -> None:
        """``step = keep step + gain D^-1 (load - A u)``; ``out = u + step``."""
        ...

    def restrict(self, fine: Field, out: Field) -> None:
        """Residual of this level to the load of the next."""
        ...

    def add_interpolated(self, coarse: Field, out: Field) -> None:
        """Add a correction of the next level to a field of this one."""
        ...

    def largest_eigenvalue(self) -> float:
        """Of D^-1 A."""
        ...

    def coarsened(self) -> Level:
        """The Galerkin operator of the next level."""
        ...

    def factorised(self, moving: NDArray[np.intp]) -> Any:
        """Cholesky factor of the matrix among the unknowns `moving` (flat indices)."""
        ...


class Multigrid:
    """A hierarchy of levels; `precondition` is one V-cycle.

    Parameters
    ----------
    finest : Level
    workspace : Workspace
    eigenvalues : list of float, optional
        Largest of each level, from a hierarchy that is much the same; else each level is asked.
    """

    def __init__(
        self, finest: Level, workspace: Workspace, eigenvalues: list[float] | None = None
    ) -> None:
        self.workspace = workspace
        self.levels = [finest]
        while np.count_nonzero(self.levels[-1].free) > finest.cycle.coarsest:
            self.levels.append(self.levels[-1].coarsened())
        if not eigenvalues or len(eigenvalues) < len(self.levels):
            eigenvalues = [level.largest_eigenvalue() for level in self.levels]
        self.eigenvalues = eigenvalues
        self._steps = [chebyshev_steps(value, finest.cycle) for value in eigenvalues]
        moving = np.flatnonzero(self.levels[-1].free)
        self._direct = moving, self.levels[-1].factorised(moving)

    @property
    def finest(self) -> Any:
        """The level whose operator is preconditioned."""
        return self.levels[0]

    def replaced(self, finest: Level) -> Multigrid:
        """A hierarchy with another finest level and the coarse operators of this one."""
        other = copy(self)
        other.levels = [finest, *self.levels[1:]]
        return other

    def precondition(self, load: Field) -> Field:
        """One symmetric V-cycle from zero, about A^-1 load; the result is work space."""
        return v_cycle(self.levels, self._steps, self._direct, load, self.workspace)


def v_cycle(
    levels: list[Level],
    steps: list[Steps],
    direct: tuple[NDArray[np.intp], Any],
    load: Field,
    workspace: Workspace,
) -> Field:
    """One symmetric V-cycle from zero: about A^-1 load.

    Parameters
    ----------
    levels : list of Level
        From the finest that this cycle works on to the coarsest.
    steps : list of tuple
        (keep, gain) of the Chebyshev steps on each level.
    direct : tuple
        Unknowns of the coarsest level that move, and the Cholesky factor of its matrix.
    load : ndarray of float32
        Load of the finest level, [x, y, z] or [component, x, y, z]; it is not changed.
    workspace : Workspace

    Returns
    -------
    ndarray of float32, the shape of `load`
        Work space.
    """
    level, u = levels[0], workspace.array("u", load.shape)
    if len(levels) == 1:
        moving, factor = direct
        solution = scipy.linalg.cho_solve(factor, load.reshape(-1)[moving])
        u.fill(0.0)
        u.reshape(-1)[moving] = solution
        return u
    spare, step = (workspace.array(name, load.shape) for name in ("spare", "step"))
    level.first_step(load, steps[0][0][1], step, spare)
    u, spare = _smoothed(level, steps[0][1:], load, step, spare, u)
    level.residual(u, load, spare)
    coarse_load = workspace.array("load", levels[1].free.shape)
    level.restrict(spare, coarse_load)
    correction = v_cycle(levels[1:], steps[1:], direct, coarse_load, workspace)
    level.add_interpolated(correction, u)
    return _smoothed(level, steps[0], load, step, u, spare)[0]


def _smoothed(
    level: Level, steps: Steps, load: Field, step: Field, source: Field, target: Field
) -> tuple[Field, Field]:
    """Chebyshev steps from `source`; where the result is, and the array that is free."""
    for keep, gain in steps:
        level.smooth(source, load, keep, gain, step, target)
        source, target = target, source
    return source, target


def chebyshev_steps(largest: float, cycle: Cycle) -> Steps:
    """(keep, gain) of the Chebyshev steps (Saad 2003, Iterative Methods, algorithm 12.1).

    Parameters
    ----------
    largest : float
        Eigenvalue of D^-1 A.
    cycle : Cycle
    """
    low = largest / cycle.smoothed_part
    middle, half = (largest + low) / 2.0, (largest - low) / 2.0
    sigma, steps = middle / half, [(np.float32(0.0), np.float32(1.0 / middle))]
    rho = 1.0 / sigma
    for _ in range(cycle.smoothings - 1):
        following = 1.0 / (2.0 * sigma - rho)
        steps.append((np.float32(following * rho), np.float32(2.0 * following / half)))
        rho = following
    return tuple(steps)
