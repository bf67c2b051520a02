"""Conjugate gradients with a V-cycle before each step, for any kind of level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from mammosim.compression.multigrid import vectors
from mammosim.compression.multigrid.cycle import Multigrid
from mammosim.compression.multigrid.workspace import Field


@dataclass(frozen=True)
class ErrorBelow:
    """Stop where the estimated error is small; the V-cycle's last answer is added, too.

    The estimate is the largest component of the V-cycle's answer to the remaining force. The
    operator is known to be positive definite. The V-cycle need not be, where springs stiffen and
    the smoother's largest eigenvalue is exceeded: iterations then go on, and lead there in more.

    Parameters
    ----------
    tolerance : float
        Lattice units.
    reduction : float
        Or where the estimate is below this part of its first value.
    """

    tolerance: float
    reduction: float
    adds_last_answer: ClassVar[bool] = True
    ends_if_indefinite: ClassVar[bool] = False
    measures_product: ClassVar[bool] = False

    def measure(self, force: Field, answer: Field) -> float:
        """Largest component of the V-cycle's answer."""
        return vectors.largest(answer)

    def goal(self, first: float) -> float:
        """What the measure must come down to, from its first value."""
        return max(self.tolerance, self.reduction * first)


@dataclass(frozen=True)
class ResidualBelow:
    """Stop where the residual, in the norm of the V-cycle, has fallen to a part of its first value.

    Parameters
    ----------
    reduction : float
    """

    reduction: float
    adds_last_answer: ClassVar[bool] = False
    ends_if_indefinite: ClassVar[bool] = True
    measures_product: ClassVar[bool] = True

    def measure(self, force: Field, answer: Field) -> float:
        """Square of the residual's norm, its product with the V-cycle's answer."""
        return vectors.dot(force, answer)

    def goal(self, first: float) -> float:
        """What the measure must come down to, from its first value."""
        return self.reduction**2 * first


class Solved(NamedTuple):
    """What conjugate gradients found.

    Parameters
    ----------
    correction : ndarray of float32
        Displacement that balances the force; work space.
    measure : float
        Last measure of what was left: see `ErrorBelow` and `ResidualBelow`.
    positive : bool
        Whether the operator and the V-cycle proved positive definite; if not, the correction is
        that of the steps before, or the first direction if there were none.
    iterations : int
    """

    correction: Field
    measure: float
    positive: bool
    iterations: int


def conjugate_gradients(
    multigrid: Multigrid, force: Field, stop: ErrorBelow | ResidualBelow, max_iterations: int
) -> Solved:
    """Displacement that balances a force.

    Parameters
    ----------
    multigrid : Multigrid
    force : ndarray of float32, [x, y, z] or [component, x, y, z]
        Out-of-balance force of each node; it is overwritten by what remains.
    stop : ErrorBelow or ResidualBelow
    max_iterations : int

    Returns
    -------
    Solved
    """
    workspace = multigrid.workspace
    correction, direction = (
        workspace.array(name, force.shape) for name in ("correction", "direction")
    )
    correction.fill(0.0)
    previous = goal = 0.0
    for iteration in range(max_iterations + 1):
        answer = multigrid.precondition(force)
        measure = stop.measure(force, answer)
        goal = stop.goal(measure) if iteration == 0 else goal
        if 0.0 <= measure <= goal or iteration == max_iterations:
            if stop.adds_last_answer:
                vectors.add_scaled(np.float32(1.0), answer, correction)
            return Solved(correction, measure, True, iteration)
        product = measure if stop.measures_product else vectors.dot(force, answer)
        ratio = product / previous if iteration else 0.0
        vectors.scale_and_add(np.float32(ratio), answer, direction)
        image = multigrid.finest.image(direction, workspace)
        curvature = -vectors.dot(direction, image)
        if stop.ends_if_indefinite and (product < 0.0 or curvature <= 0.0):
            break
        length = product / curvature
        vectors.add_scaled(np.float32(length), direction, correction)
        vectors.add_scaled(np.float32(length), image, force)
        previous = product
    if iteration == 0:
        vectors.add_scaled(np.float32(1.0), direction, correction)
    return Solved(correction, measure, False, iteration)
