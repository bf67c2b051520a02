"""Outlines of masses, members of a cluster of calcifications, and clips."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

CALCIFICATIONS = (5, 30)
"""Number in a cluster: five within 1 cm make one (ACR BI-RADS Atlas, 5th edition, 2013,
"Grouped"); the upper end is a choice."""

CALCIFICATION_MM = (0.1, 0.8)
"""Diameters, a choice within the range of microcalcifications: from 1 mm on they are coarse ones,
and VICTRE uses 0.17 to 0.2 mm (Badano et al. 2018, JAMA Netw Open 1(7):e185474)."""

CALCIFICATION_MEDIAN_MM, CALCIFICATION_SPREAD = 0.25, 0.5
"""Median diameter, mm, and spread of its logarithm: a choice by which most are small."""

CLIP_RADIUS_MM = 0.25
"""Radius of the wire a biopsy clip is made of, mm."""

LOBES = {"smooth": 0.04, "lobulated": 0.14, "spiculated": 0.16}
"""Unevenness of a mass's radius, as a fraction of it."""

SPICULES = (14, 24)
"""Number of spicules of a spiculated mass."""


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
    offsets_mm: NDArray[np.float64], radius_mm: float, margin: str, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Which points belong to a mass, a ball made uneven that stays within its radius.

    Parameters
    ----------
    offsets_mm : ndarray, (..., 3)
        Points from the mass's centre, mm.
    radius_mm : float
        Greatest radius, mm.
    margin : {"smooth", "lobulated", "spiculated"}
    rng : Generator

    Notes
    -----
    The radius in a direction n is 1 + a sum of cosines of n.k with random wave vectors k, scaled
    to at most `radius_mm`. Spicules are cones from the body, which then has 55 % of the radius,
    out to it.
    """
    distance = np.linalg.norm(offsets_mm, axis=-1)
    direction = offsets_mm / np.maximum(distance, 1e-9)[..., None]
    waves = rng.standard_normal((8, 3)) * 2.6
    phases = rng.uniform(0.0, 2.0 * np.pi, 8)
    uneven = np.cos(direction @ waves.T + phases).sum(axis=-1) / 2.0
    size = LOBES[margin]
    body = radius_mm * (0.55 if margin == "spiculated" else 1.0 / (1.0 + 1.5 * size))
    inside: NDArray[np.bool_] = distance <= np.minimum(body * (1.0 + size * uneven), radius_mm)
    if margin == "spiculated":
        axes = rng.standard_normal((int(rng.integers(*SPICULES)), 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        for axis in axes:
            reach = radius_mm * rng.uniform(0.75, 1.0)
            along = offsets_mm @ axis
            across = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
            inside |= (
                (along > 0) & (along < reach) & (across < 0.14 * (reach - along) + 0.03 * reach)
            )
        inside &= distance <= radius_mm
    return inside


def cluster_balls(
    radius_mm: float, count: int | None, diameter_mm: float | None, rng: np.random.Generator
) -> list[Ball]:
    """Calcifications scattered in a ball, denser towards its centre.

    Parameters
    ----------
    radius_mm : float
        Radius of the cluster, mm.
    count : int or None
        How many; None draws it.
    diameter_mm : float or None
        Diameter of each, mm; None draws it for each.
    rng : Generator
    """
    number = (
        count if count is not None else int(rng.integers(CALCIFICATIONS[0], CALCIFICATIONS[1] + 1))
    )
    balls = []
    for _ in range(number):
        drawn = CALCIFICATION_MEDIAN_MM * np.exp(CALCIFICATION_SPREAD * rng.standard_normal())
        diameter = float(np.clip(drawn, *CALCIFICATION_MM)) if diameter_mm is None else diameter_mm
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        room = max(radius_mm - 0.5 * diameter, 0.0)
        balls.append(Ball(room * rng.random() ** 0.5 * direction, 0.5 * diameter))
    return balls


def clip_ball(length_mm: float, rng: np.random.Generator) -> Ball:
    """A clip: a rod of titanium wire in a random direction."""
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    radius = min(CLIP_RADIUS_MM, 0.5 * length_mm)
    return Ball(np.zeros(3), radius, 0.5 * length_mm - radius, direction)
