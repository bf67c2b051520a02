"""The inframammary fold: below the breast the skin turns into that of the abdominal wall.

On an oblique mammogram the lower end of the breast meets a bit of the abdominal wall at the
chest-wall edge, in a hollow that is open when the breast is lifted, as it should be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.anatomy.axilla import CUT_DEG, across_mm, along_mm, sized_mm
from mammosim.phantom.anatomy.shape import Points, Shape, level

FILLET_MM = 14.0
"""Width of the hollow over which breast and abdominal wall go into each other, mm: wide enough to
stay open between plates. Chosen."""

HEIGHT, HALF_LENGTH, HALF_WIDTH = (0.28, 0.38), (0.34, 0.58), (0.34, 0.42)
"""Size of the mound against the breast's radius. Chosen so that an oblique image that begins 15 mm
in front of the chest wall shows some millimetres of it, and so narrow that it thins off to its
border between the plates as the breast does."""

MEETS, APART = 0.6, 0.95
"""The breast meets the mound at this part of its height, and the mound's middle lies this part of
its half length farther down. Chosen by eye."""

LOWER = 1.1
"""From its middle on the mound ends more slowly than it begins, by this factor: the abdominal wall
goes on below. Chosen by eye."""


@dataclass(frozen=True)
class Fold:
    """A mound of the abdominal wall below the breast, opposite the axilla.

    Parameters
    ----------
    height_mm : float
        How far it stands out from the chest wall.
    half_width_mm, half_length_mm : float
        Half its width across the way to the axilla, and its length along it on the breast's side
        of its middle; on the other side it is `LOWER` times as long.
    place_mm : float
        Its middle along the way to the axilla from the nipple: negative.
    """

    height_mm: float
    half_width_mm: float
    half_length_mm: float
    place_mm: float


def draw_fold(shape: Shape, rng: np.random.Generator) -> Fold:
    """A mound that meets a breast where it is some centimetres deep."""
    size = sized_mm(shape)
    height, half_length = size * rng.uniform(*HEIGHT), size * rng.uniform(*HALF_LENGTH)
    return Fold(
        height_mm=height,
        half_width_mm=size * rng.uniform(*HALF_WIDTH),
        half_length_mm=half_length,
        place_mm=-(_reach_mm(shape, MEETS * height) + APART * half_length),
    )


def _reach_mm(shape: Shape, x_mm: float) -> float:
    """How far the breast reaches away from the axilla at a distance from the chest wall, mm."""
    angle = np.deg2rad(CUT_DEG)
    way = np.arange(0.0, 2.5 * shape.radius_mm, 0.5)
    points = (np.full_like(way, x_mm), -way * np.cos(angle), -way * np.sin(angle))
    return float(way[level(shape, points) > 0.0].max())


def mound_level(fold: Fold, points_mm: Points) -> NDArray[np.float64]:
    """Positive inside the mound, 0 on its surface.

    Parameters
    ----------
    fold : Fold
    points_mm : tuple of three ndarray that broadcast
        x, lateral, superior, mm.
    """
    x, lateral, superior = points_mm
    across = np.abs(across_mm(lateral, superior)) / fold.half_width_mm
    way = (along_mm(lateral, superior) - fold.place_mm) / fold.half_length_mm
    along = np.maximum(way, -way / LOWER)
    inside: NDArray[np.float64] = (
        1.0 - across**2 - along**2 - (np.clip(x, 0.0, None) / fold.height_mm) ** 2
    )
    return inside
