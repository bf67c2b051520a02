"""The pectoral muscle: a wedge towards the axilla on a slab that thickens medially.

Between the plates of an oblique view the wedge is the bright triangle that starts at the upper
chest-wall corner and ends at about the nipple's level; the slab is the curve of the chest, by
which a reader tells left from right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.shape import GRID_MM, Shape, coarse_frame, level, mesh, near_depth

FIBRE_DEG = 54.0
"""Direction in which the wedge thickens, degrees from lateral to superior: the fibres of the
pectoralis major run between sternum and humerus and its front edge is seen end on in an oblique
view, whose angle is set along them (45 degrees usually)."""

COVER_MM = 7.0
"""Least skin and fat over the muscle, mm."""


@dataclass(frozen=True)
class Muscle:
    """Thicknesses of the muscle in front of the chest-wall plane.

    Parameters
    ----------
    wedge : float
        At the axillary end, as a fraction of the breast's radius.
    start_mm : float
        Where along the fibre direction the wedge starts, against the nipple, mm.
    bulge : float
        Power of the front edge: below 1 it is convex.
    medial_mm, lateral_mm : float
        Slab's thickness at the medial and lateral border of the base, mm.
    """

    wedge: float
    start_mm: float
    bulge: float
    medial_mm: float
    lateral_mm: float


def draw_muscle(rng: np.random.Generator) -> Muscle:
    """A muscle; its wedge grows with the breast."""
    return Muscle(
        wedge=rng.uniform(0.35, 0.47),
        start_mm=rng.uniform(-8.0, 6.0),
        bulge=rng.uniform(0.85, 1.05),
        medial_mm=rng.uniform(4.0, 6.0),
        lateral_mm=rng.uniform(0.5, 1.5),
    )


def muscle_depth(muscle: Muscle, shape: Shape, frame: VoxelFrame) -> NDArray[np.float64]:
    """Depth below the muscle's front face along x, mm, positive inside it."""
    x, lateral, superior = mesh(frame)
    angle = np.deg2rad(FIBRE_DEG)
    along = lateral * np.cos(angle) + superior * np.sin(angle)
    end = shape.radius_mm * (1.0 + shape.tail)
    rise = np.clip((along - muscle.start_mm) / (end - muscle.start_mm), 0.0, 1.2)
    above = np.clip((superior + 10.0) / 40.0, 0.0, 1.0)
    wedge = muscle.wedge * shape.radius_mm * rise**muscle.bulge * above**2 * (3.0 - 2.0 * above)
    share = np.clip(0.5 - 0.5 * lateral / shape.radius_mm, 0.0, 1.0)
    slab = muscle.lateral_mm + (muscle.medial_mm - muscle.lateral_mm) * share
    front = np.hypot(wedge, slab)
    return front - x


def fit_volume(shape: Shape, muscle: Muscle, volume_ml: float) -> Shape:
    """Scale a shape until what is in front of the muscle has a volume, mL."""
    for _ in range(4):  # the slab does not scale: each turn leaves a tenth of the last one's error
        frame = coarse_frame(shape)
        value, x = level(shape, mesh(frame)), mesh(frame)[0]
        muscled = (muscle_depth(muscle, shape, frame) > 0) & (near_depth(value) > COVER_MM)
        # Points on the chest-wall plane stand for half as much.
        weight = np.where(x == 0, 0.5, 1.0) * (x >= 0)
        found_ml = float((weight * ((value > 0) & ~muscled)).sum()) * GRID_MM**3 / 1000.0
        shape = shape.scaled((volume_ml / found_ml) ** (1.0 / 3.0))
    return shape
