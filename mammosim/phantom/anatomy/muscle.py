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
from mammosim.phantom.anatomy.axilla import along_mm
from mammosim.phantom.anatomy.outline import GRID_MM, Outline, coarse_frame, mesh, near_depth

COVER_MM = 7.0
"""Least skin and fat over the muscle, mm."""

FAT_IN_MUSCLE, FIBRE_NOISE = 0.08, 1.3
"""Share of fat between the muscle's bundles, and the noise above which it lies. Chosen by eye."""


@dataclass(frozen=True)
class Muscle:
    """Thicknesses of the muscle in front of the chest-wall plane.

    Parameters
    ----------
    wedge : float
        At the open end, as a fraction of the axillary ridge's height.
    start_mm : float
        Where along the way to the axilla the wedge starts, against the nipple, mm.
    bulge : float
        Power of the front edge: below 1 it is convex, above 1 concave.
    medial_mm, lateral_mm : float
        Slab's thickness at the medial and lateral border of the base, mm.
    """

    wedge: float
    start_mm: float
    bulge: float
    medial_mm: float
    lateral_mm: float


def draw_muscle(rng: np.random.Generator) -> Muscle:
    """A muscle; its wedge grows with the ridge that it runs in."""
    return Muscle(
        wedge=rng.uniform(0.62, 0.82),
        start_mm=rng.uniform(-15.0, 12.0),
        bulge=rng.uniform(0.75, 1.15),
        medial_mm=rng.uniform(4.0, 6.0),
        lateral_mm=rng.uniform(0.5, 1.5),
    )


def muscle_depth(muscle: Muscle, outline: Outline, frame: VoxelFrame) -> NDArray[np.float64]:
    """Depth below the muscle's front face along x, mm, positive inside it."""
    x, lateral, superior = mesh(frame)
    radius, end = outline.shape.radius_mm, outline.axilla.cut_mm
    rise = np.clip((along_mm(lateral, superior) - muscle.start_mm) / (end - muscle.start_mm), 0, 2)
    # Below the nipple there is no wedge; above, it comes in over 4 cm.
    above = np.clip((superior + 15.0) / 40.0, 0.0, 1.0)
    wedge = muscle.wedge * outline.axilla.height_mm * rise**muscle.bulge
    wedge = wedge * above**2 * (3.0 - 2.0 * above)
    share = np.clip(0.5 - 0.5 * lateral / radius, 0.0, 1.0)
    slab = muscle.lateral_mm + (muscle.medial_mm - muscle.lateral_mm) * share
    front: NDArray[np.float64] = np.hypot(wedge, slab)
    return front - x


def fit_volume(outline: Outline, muscle: Muscle, volume_ml: float) -> Outline:
    """Scale an outline until what is in front of the muscle has a volume, mL."""
    for _ in range(5):  # the slab does not scale: each turn leaves a tenth of the last one's error
        frame = coarse_frame(outline)
        depth = near_depth(outline, frame)
        x, lateral, superior = mesh(frame)
        tissue = (depth > 0) & (along_mm(lateral, superior) < outline.axilla.cut_mm)
        muscled = (muscle_depth(muscle, outline, frame) > 0) & (depth > COVER_MM)
        # Points on the chest-wall plane stand for half as much.
        weight = np.where(x == 0, 0.5, 1.0) * (x >= 0) * np.where(muscled, FAT_IN_MUSCLE, 1.0)
        found_ml = float((weight * tissue).sum()) * GRID_MM**3 / 1000.0
        outline = outline.scaled((volume_ml / found_ml) ** (1.0 / 3.0))
    return outline
