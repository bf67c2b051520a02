"""Conjugate gradients for an operator that may be indefinite, within a trust region."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from mammosim.compression.multigrid import vectors
from mammosim.compression.multigrid.cycle import Multigrid
from mammosim.compression.multigrid.workspace import Field

FIRST_RADIUS = 10.0
"""Radius of the first trust region, in lengths of the first direction (norm of the V-cycle)."""

MIN_RITZ = 1e-4
"""Smallest Ritz value that counts: single precision knows none below."""


class Truncated(NamedTuple):
    """What truncated conjugate gradients found.

    Parameters
    ----------
    correction : ndarray of float32
        Step; work space.
    decrease : float
        By which the quadratic model falls.
    size : float
        Of the step, in the norm of the V-cycle.
    bounded : bool
        Whether the step ends at the trust region's boundary.
    ritz : float
        Smallest eigenvalue of the preconditioned operator that was seen; negative where curvature
        was.
    left : float
        Estimated part of the step by which it misses the linear problem's solution.
    definite : bool
        Whether the V-cycle proved positive definite; if not, the step is of no use.
    iterations : int
    """

    correction: Field
    decrease: float
    size: float
    bounded: bool
    ritz: float
    left: float
    definite: bool
    iterations: int


class _Recurrence:
    """Lengths in the V-cycle's norm, and the Lanczos matrix, of conjugate gradients.

    `square` is that of the correction, `across` its product with the direction, `along` the
    direction's square (Conn, Gould & Toint 2000, Trust-Region Methods, section 7.5.1).
    """

    def __init__(self) -> None:
        self.square = self.across = self.along = 0.0
        self._diagonal: list[float] = []
        self._beside: list[float] = []
        self._length = 1.0

    def turn(self, product: float, ratio: float) -> None:
        """A new direction: what the V-cycle gave, and `ratio` times the one before."""
        self.across = ratio * (self.across + self._length * self.along) if ratio else 0.0
        self.along = product + ratio**2 * self.along

    def square_after(self, length: float) -> float:
        """Square of the correction after a step along the direction."""
        return self.square + 2.0 * length * self.across + length**2 * self.along

    def reach(self, radius: float) -> float:
        """Length of the step along the direction that ends at a radius."""
        inside = max(radius**2 - self.square, 0.0)
        return (-self.across + np.sqrt(self.across**2 + self.along * inside)) / self.along

    def step(self, length: float, ratio: float) -> None:
        """Take a step along the direction."""
        if self._diagonal:
            self._beside.append(np.sqrt(ratio) / self._length)
        self._diagonal.append(1.0 / length + ratio / self._length)
        self.square = self.square_after(length)
        self._length = length

    def smallest_ritz(self) -> float:
        """Smallest eigenvalue of the Lanczos matrix; 1 where there was no step."""
        if not self._diagonal:
            return 1.0
        return float(scipy.linalg.eigvalsh_tridiagonal(self._diagonal, self._beside)[0])


def truncated_gradients(
    multigrid: Multigrid, force: Field, radius: float, reduction: float, max_iterations: int
) -> Truncated:
    """Step that lowers a quadratic model within a trust region.

    Parameters
    ----------
    multigrid : Multigrid
    force : ndarray of float32, [component, x, y, z]
        Less the model's gradient; it is overwritten by what remains.
    radius : float
        Of the trust region, in the norm of the V-cycle; infinite: from the first direction.
    reduction : float
        Part of the residual, in the norm of the V-cycle, at which one more iteration is the last:
        the V-cycle that shows how small the residual is also gives a direction.
    max_iterations : int

    Notes
    -----
    Steihaug 1983, SIAM J Numer Anal 20:626-637, and Toint 1981: conjugate gradients up to the
    boundary; a direction of negative curvature is followed there. What the last iteration leaves is
    not known, but its error is smaller (in the operator's norm) than what it found, which `left`
    counts.
    """
    workspace = multigrid.workspace
    correction, direction = (
        workspace.array(name, force.shape) for name in ("correction", "direction")
    )
    correction.fill(0.0)
    lengths = _Recurrence()
    decrease = previous = first = product = 0.0
    for iteration in range(max_iterations + 1):
        answer = multigrid.precondition(force)
        product = vectors.dot(force, answer)
        if product < 0.0:
            return Truncated(correction, 0.0, 0.0, False, 0.0, 1.0, False, iteration)
        if iteration == 0:
            first = product
            if radius == np.inf:
                radius = FIRST_RADIUS * float(np.sqrt(product))
        last = product <= reduction**2 * first
        if iteration == max_iterations or product == 0.0:
            break
        ratio = product / previous if iteration else 0.0
        lengths.turn(product, ratio)
        vectors.scale_and_add(np.float32(ratio), answer, direction)
        image = multigrid.finest.image(direction, workspace)
        curvature = -vectors.dot(direction, image)
        length = product / curvature if curvature > 0.0 else np.inf
        if curvature <= 0.0 or lengths.square_after(length) >= radius**2:
            length = lengths.reach(radius)
            vectors.add_scaled(np.float32(length), direction, correction)
            decrease += length * product - 0.5 * length**2 * curvature
            ritz = min(lengths.smallest_ritz(), curvature / lengths.along)
            return Truncated(correction, decrease, radius, True, ritz, 1.0, True, iteration + 1)
        lengths.step(length, ratio)
        vectors.add_scaled(np.float32(length), direction, correction)
        vectors.add_scaled(np.float32(length), image, force)
        decrease += 0.5 * length * product
        previous = product
        if last:
            iteration += 1
            break
    ritz, size = lengths.smallest_ritz(), float(np.sqrt(lengths.square))
    left = float(np.sqrt(product)) / (max(ritz, MIN_RITZ) * max(size, 1e-300))
    return Truncated(correction, decrease, size, False, ritz, left, True, iteration)
