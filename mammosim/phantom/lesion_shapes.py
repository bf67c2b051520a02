"""Outlines of masses, balls and rods, and clips."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

CLIP_RADIUS_MM = 0.25
"""Radius of the wire a biopsy clip is made of, mm."""


@dataclass(frozen=True)
class Margin:
    """How a mass is bounded.

    Parameters
    ----------
    body : float
        Radius of its body, of the mass's.
    lobes : float
        Unevenness of that radius, as a fraction of it.
    spicules : (int, int)
        Fewest and most spicules.
    base, tip : float
        Half the width of a spicule at the centre and at its end, of its length.
    """

    body: float
    lobes: float
    spicules: tuple[int, int] = (0, 0)
    base: float = 0.0
    tip: float = 0.0


MARGINS = {
    "smooth": Margin(0.94, 0.04),
    "lobulated": Margin(0.83, 0.14),
    "spiculated": Margin(0.55, 0.16, (14, 24), 0.17, 0.03),
    "distortion": Margin(0.12, 0.16, (18, 32), 0.05, 0.02),
}
"""By the names of BI-RADS as far as it has them: an architectural distortion has thin straight
lines or spicules that radiate from a point and no definite mass (ACR BI-RADS Atlas, 5th edition,
2013). The numbers are choices by eye; bodies that are uneven stay within the radius."""


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


def inside_mass(
    offsets_mm: NDArray[np.float64],
    radius_mm: float,
    margin: str,
    rng: np.random.Generator,
    thinnest_mm: float = 0.0,
) -> NDArray[np.bool_]:
    """Which points belong to a mass, a ball made uneven that stays within its radius.

    Parameters
    ----------
    offsets_mm : ndarray, (..., 3)
        Points from the mass's centre, mm.
    radius_mm : float
        Greatest radius, mm.
    margin : {"smooth", "lobulated", "spiculated", "distortion"}
    rng : Generator
    thinnest_mm : float
        Least half width of a spicule, mm: thinner than a voxel it would break up.

    Notes
    -----
    The radius in a direction n is 1 + a sum of cosines of n.k with random wave vectors k, scaled
    to at most `radius_mm`. Spicules are cones from the centre through the body.
    """
    kind = MARGINS[margin]
    distance = np.linalg.norm(offsets_mm, axis=-1)
    direction = offsets_mm / np.maximum(distance, 1e-9)[..., None]
    waves = rng.standard_normal((8, 3)) * 2.6
    phases = rng.uniform(0.0, 2.0 * np.pi, 8)
    uneven = np.cos(direction @ waves.T + phases).sum(axis=-1) / 2.0
    body = kind.body * radius_mm * (1.0 + kind.lobes * uneven)
    inside: NDArray[np.bool_] = distance <= np.minimum(body, radius_mm)
    number = int(rng.integers(kind.spicules[0], kind.spicules[1] + 1))
    axes = rng.standard_normal((number, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for axis in axes:
        reach = radius_mm * rng.uniform(0.75, 1.0)
        along = offsets_mm @ axis
        across = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
        width = kind.tip * reach + (kind.base - kind.tip) * (reach - along)
        inside |= (along > 0) & (along < reach) & (across < np.maximum(width, thinnest_mm))
    inside &= distance <= radius_mm
    return inside


def clip_ball(length_mm: float, rng: np.random.Generator) -> Ball:
    """A clip: a rod of titanium wire in a random direction."""
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    radius = min(CLIP_RADIUS_MM, 0.5 * length_mm)
    return Ball(np.zeros(3), radius, 0.5 * length_mm - radius, direction)
