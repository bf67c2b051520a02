"""Balls and rods, of which clips and calcifications are made."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball, or a rod with round ends.

    Parameters
    ----------
    offset_mm : ndarray, (3,)
        Centre against the lesion's centre, mm.
    radius_mm : float
    half_length_mm : float
        Half the length of its axis, mm; 0 is a ball.
    direction : ndarray, (3,)
        Unit vector along its axis.
    """

    offset_mm: NDArray[np.float64]
    radius_mm: float
    half_length_mm: float = 0.0
    direction: NDArray[np.float64] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))

    @property
    def volume_mm3(self) -> float:
        """Volume, mm3."""
        across = np.pi * self.radius_mm**2
        return float(across * (4.0 / 3.0 * self.radius_mm + 2.0 * self.half_length_mm))

    def contains(
        self, offsets_mm: NDArray[np.float64], thinnest_mm: float = 0.0
    ) -> NDArray[np.bool_]:
        """Which points (..., 3), in mm from its centre, lie in it, if it is at least so thick."""
        along = np.clip(offsets_mm @ self.direction, -self.half_length_mm, self.half_length_mm)
        rest = offsets_mm - along[..., None] * self.direction
        inside: NDArray[np.bool_] = (rest**2).sum(axis=-1) <= max(self.radius_mm, thinnest_mm) ** 2
        return inside
