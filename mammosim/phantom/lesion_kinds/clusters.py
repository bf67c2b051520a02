"""Members of a cluster of calcifications: how many, how large, of which form and how they lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.lesion_kinds.balls import Ball

COUNTS = (5, 30)
"""Fewest and most in a cluster: five within 1 cm make one (ACR BI-RADS Atlas, 5th edition, 2013,
"Grouped"); the upper end is a choice."""

SMALLEST_MM, LARGEST_MM = 0.1, 0.8
"""Bounds of all diameters drawn, mm: from 1 mm on calcifications are coarse ones, and VICTRE uses
0.17 to 0.2 mm (Badano et al. 2018, JAMA Netw Open 1(7):e185474)."""

AXES = (1.0, 0.75, 0.5)
"""Half-axes of a cluster, of its radius: a ball flattened as a segment of the breast is. Chosen."""


@dataclass(frozen=True)
class Sizes:
    """Log-normal diameters of balls of the same volume, mm, and how elongated they are.

    Parameters
    ----------
    median_mm, spread : float
        Median, and spread of the logarithm.
    largest_mm : float
    aspect : (float, float)
        Least and greatest ratio of length to width.
    """

    median_mm: float
    spread: float
    largest_mm: float
    aspect: tuple[float, float]


SIZES = {
    "punctate": Sizes(0.25, 0.35, 0.5, (1.0, 1.2)),
    "pleomorphic": Sizes(0.28, 0.50, LARGEST_MM, (1.0, 2.8)),
    "linear": Sizes(0.28, 0.35, 0.6, (2.5, 6.0)),
}
"""Punctate ones are round and below 0.5 mm, fine pleomorphic ones irregular and mostly below it,
fine linear ones thin, below 0.5 mm in width (ACR BI-RADS Atlas, 5th edition, 2013). Medians,
spreads and ratios are choices by which most are small."""


def cluster_balls(
    radius_mm: float,
    count: int | None,
    diameter_mm: float | None,
    rng: np.random.Generator,
    morphology: str = "pleomorphic",
    towards: NDArray[np.float64] | None = None,
) -> list[Ball]:
    """Members of a cluster, within a ball.

    Parameters
    ----------
    radius_mm : float
        Radius of the cluster, mm.
    count : int or None
        How many; None draws it.
    diameter_mm : float or None
        Diameter of a ball of each one's volume, mm; None draws it for each.
    rng : Generator
    morphology : {"punctate", "pleomorphic", "linear"}
    towards : ndarray, (3,), optional
        Unit vector towards the nipple, along which linear ones lie; left out, any direction.
    """
    number = int(rng.integers(COUNTS[0], COUNTS[1] + 1)) if count is None else count
    sizes = SIZES[morphology]
    place = _along_ducts if morphology == "linear" else _scattered
    balls = []
    for middle, axis in place(number, rng, towards):
        drawn = sizes.median_mm * np.exp(sizes.spread * rng.standard_normal())
        bounded = float(np.clip(drawn, SMALLEST_MM, sizes.largest_mm))
        diameter = bounded if diameter_mm is None else diameter_mm
        rod = _rod(diameter, rng.uniform(*sizes.aspect), axis)
        reach = max(radius_mm - rod.radius_mm - rod.half_length_mm, 0.0)
        balls.append(Ball(reach * middle, rod.radius_mm, rod.half_length_mm, axis))
    return balls


Place = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Where a member lies in the unit ball, and its direction."""


def _rod(diameter_mm: float, aspect: float, axis: NDArray[np.float64]) -> Ball:
    """A rod with round ends of a ball's volume; `aspect` is its length over its width."""
    # pi r^2 (4/3 r + 2 h) with h = (aspect - 1) r is pi / 6 d^3.
    radius = diameter_mm * (6.0 * (4.0 / 3.0 + 2.0 * (aspect - 1.0))) ** (-1.0 / 3.0)
    return Ball(np.zeros(3), radius, (aspect - 1.0) * radius, axis)


def unit_vector(rng: np.random.Generator) -> NDArray[np.float64]:
    """A direction, all equally likely."""
    direction = rng.standard_normal(3)
    unit: NDArray[np.float64] = direction / np.linalg.norm(direction)
    return unit


def _scattered(
    number: int, rng: np.random.Generator, towards: NDArray[np.float64] | None
) -> list[Place]:
    """Anywhere in a flattened ball, denser towards its centre, turned anyhow."""
    frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    places = []
    for _ in range(number):
        inside = rng.random() ** 0.5 * unit_vector(rng) * AXES
        places.append((frame @ inside, unit_vector(rng)))
    return places


def _along_ducts(
    number: int, rng: np.random.Generator, towards: NDArray[np.float64] | None
) -> list[Place]:
    """In a row that points to the nipple and forks once, each member along it."""
    main = unit_vector(rng) if towards is None else towards
    side = main + 0.6 * unit_vector(rng)
    side /= np.linalg.norm(side)
    bend = 0.15 * unit_vector(rng)
    places = []
    for step in rng.uniform(-1.0, 1.0, number):
        on_branch = step < 0.0 and rng.random() < 0.5
        axis = side if on_branch else main
        middle = step * axis + (1.0 - step * step) * bend + 0.06 * rng.standard_normal(3)
        length = float(np.linalg.norm(middle))
        aside = axis + 0.25 * unit_vector(rng)
        places.append((middle / max(length, 1.0), aside / np.linalg.norm(aside)))
    return places
