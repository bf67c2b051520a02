"""The way to the axilla: a ridge of muscle and fat that leaves the phantom through an open end.

On an oblique mammogram breast and pectoral muscle run out of the picture at its upper edge. The
ridge stands for the front fold of the axilla, over the pectoral muscle on its way to the arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.anatomy.shape import Points, Shape, smooth_step

CUT_DEG = 45.0
"""Direction out of the open end, from lateral to superior, degrees: along the picture's long side
in the usual oblique view."""

HELD_FROM, HELD_OVER = 0.25, 0.45
"""Where the skin of other views departs from that of oblique ones on the way to the axilla, and the
distance over which it blends into the breast's own, in radii of the breast."""

RIDGE_FROM, RIDGE_OVER = 0.2, 0.85
"""Where the ridge starts along its direction, and the distance over which it rises, in radii of the
breast: far enough out that it lies below the breast's own surface in views without the axilla. If
it stood out there, compression would fold the hollow before it into a crease across the image."""


BODY_PART, BODY_MM = 0.6, 62.0
"""The ridge, and what else surrounds a breast, is sized by this part of an average breast's radius
and the rest of its own: the body varies less than the breast. Chosen."""

HEIGHT, ROOT = (0.70, 0.90), (0.68, 0.82)
"""Height of the ridge at the open end and, on a straight line to there, at the nipple, against the
breast's depth: lower than the breast there, as a fillet joins both. Chosen so that the picture is
as wide at its upper edge as clinical ones, 0.72 to 0.96 of its greatest width
(docs/explanation/pictures.md), and that the outline has no hollow between axilla and nipple."""

LEAST_MM = 49.0
"""Least height of the ridge at the open end before the breast is scaled to its volume, mm: the
muscle under it varies less than breasts do. Shallow ones have what `HEIGHT` allows. Chosen."""


@dataclass(frozen=True)
class Axilla:
    """A ridge on the chest wall towards the axilla.

    Parameters
    ----------
    height_mm : float
        How far it stands out from the chest wall at its end.
    half_width_mm : float
        Half its width across.
    offset_mm : float
        Its middle line against the nipple, upwards across its direction.
    cut_mm : float
        Where the phantom ends, along its direction from the nipple.
    root_mm : float
        How far it would stand out at the nipple.
    """

    height_mm: float
    half_width_mm: float
    offset_mm: float
    cut_mm: float
    root_mm: float

    def crest_mm(self, along: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the ridge along its direction from the nipple, mm."""
        part = np.clip(along / self.cut_mm, 0.0, 1.5)
        crest: NDArray[np.float64] = self.root_mm + part * (self.height_mm - self.root_mm)
        return crest


def draw_axilla(shape: Shape, rng: np.random.Generator) -> Axilla:
    """A ridge that suits a breast: as high for its depth, and about as wide as the body has it."""
    radius = sized_mm(shape)
    start = 0.5 * shape.base_superior_mm
    height = max(shape.front_mm * rng.uniform(*HEIGHT), LEAST_MM)
    return Axilla(
        height_mm=min(height, HEIGHT[1] * shape.front_mm),
        half_width_mm=radius * rng.uniform(0.72, 0.90),
        offset_mm=start + radius * rng.uniform(-0.05, 0.1),
        cut_mm=radius * rng.uniform(1.50, 1.80) + start,
        root_mm=shape.front_mm * rng.uniform(*ROOT),
    )


def sized_mm(shape: Shape) -> float:
    """Radius by which what surrounds a breast is sized, mm: it varies less than the breast's."""
    return BODY_PART * BODY_MM + (1.0 - BODY_PART) * shape.radius_mm


def along_mm(lateral: NDArray[np.float64], superior: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from the nipple towards the axilla, mm."""
    angle = np.deg2rad(CUT_DEG)
    towards: NDArray[np.float64] = lateral * np.cos(angle) + superior * np.sin(angle)
    return towards


def across_mm(lateral: NDArray[np.float64], superior: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from the nipple at right angles to `along_mm`, upwards, mm."""
    angle = np.deg2rad(CUT_DEG)
    upwards: NDArray[np.float64] = superior * np.cos(angle) - lateral * np.sin(angle)
    return upwards


def ridge_level(axilla: Axilla, shape: Shape, points_mm: Points) -> NDArray[np.float64]:
    """Positive inside the ridge, 0 on its surface; it fades towards the middle of the breast.

    Parameters
    ----------
    axilla : Axilla
    shape : Shape
    points_mm : tuple of three ndarray that broadcast
        x, lateral, superior, mm.
    """
    x, lateral, superior = points_mm
    across = across_mm(lateral, superior) - axilla.offset_mm
    along = along_mm(lateral, superior)
    way = along / shape.radius_mm
    begun = smooth_step((way - RIDGE_FROM) / RIDGE_OVER)
    depth = np.clip(x, 0.0, None)
    inside: NDArray[np.float64] = (
        2.0 * begun - 1.0
        - (np.abs(across) / axilla.half_width_mm) ** 2.2 - (depth / axilla.crest_mm(along)) ** 2.2
    )  # fmt: skip
    return inside
