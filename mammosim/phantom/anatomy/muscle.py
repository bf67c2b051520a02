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
from mammosim.phantom.anatomy.axilla import across_mm, along_mm
from mammosim.phantom.anatomy.noise import noise_over, smooth_noise
from mammosim.phantom.anatomy.outline import (
    GRID_MM,
    Outline,
    breast_depth,
    coarse_frame,
    mesh,
)
from mammosim.phantom.anatomy.shape import smooth_step

LOW_MM, LOW_FROM, LOW_OVER = 10.0, 0.22, 1.05
"""The muscle's wedge is no thicker than the first, mm, up to the second above the nipple; over the
third this limit is lost, both in radii of the breast. Chosen so that it shows in oblique views down
to the nipple, and little between the plates of craniocaudal ones."""

COVER_MM = 7.0
"""Least skin and fat over the muscle, mm."""

OWN_PART, OWN_MM = 0.5, 50.0
"""The muscle is sized by this part of what it measures in the average woman, mm, and the rest of
the ridge's height: it varies less than the breast does. It is no thicker than fits under the ridge,
so that its front stays straight up to the open end. Chosen."""

FAT_IN_MUSCLE = 0.049
"""Share of fat between and within the muscle's bundles, as their walls and streaks make it."""

BUNDLE_MM, BUNDLE_LENGTH = 8.0, 7.0
"""Width of the muscle's bundles, mm, and their length against it. Chosen by eye."""

FIBRE_BEND_MM = (1.2, 50.0)
"""Amplitude and wavelength by which bundles are bent, mm: fibres are nearly straight. Chosen."""

CROSS_BEND_MM = (1.8, 16.0)
"""Amplitude and wavelength, mm, by which walls between bundles are bent in a cross-section: a
flat wall that a ray touches over a bundle's width draws a dark line, straight and sharp as on no
mammogram. Along the fibres this noise is as long as bundles are. Chosen by eye."""

LAYERS_MM, THIN_MM = 50.0, 32.0
"""Coordinate of the muscle's front across its layers, mm, so that they thin towards the nipple as
the muscle does; and the thickness, mm, below which they end at the front instead. Chosen so that
bundles are about as thick as wide where the muscle is thickest."""

INSERTION_MM = 130.0
"""How far beyond the open end the bundles meet: the muscle's tendon at the upper arm, mm."""


@dataclass(frozen=True)
class Muscle:
    """Thicknesses of the muscle in front of the chest-wall plane.

    Parameters
    ----------
    wedge : float
        At the open end, against the mean of the axillary ridge's height and `OWN_MM`, or what fits
        under the ridge: how far positioning draws the muscle off the chest wall.
    start_mm : float
        Where along the way to the axilla the wedge starts, against the nipple, mm.
    bulge : float
        Power of the front edge: below 1 it is convex, above 1 concave.
    medial_mm, lateral_mm : float
        Slab's thickness at the medial and lateral border of the base, mm.
    bow : float
        Part of the wedge's thickness that is lost at the sides of the axilla.
    waves : tuple of (amplitude, along, across, phase)
        Unevenness of the front: mm, radians a mm along and across the way to the axilla, radians.
    """

    wedge: float
    start_mm: float
    bulge: float
    medial_mm: float
    lateral_mm: float
    bow: float
    waves: tuple[tuple[float, float, float, float], ...]


def draw_muscle(rng: np.random.Generator) -> Muscle:
    """A muscle whose wedge is 30 to 58 mm wide where an oblique picture ends, and ends at about the
    nipple's level, as on clinical images."""
    waves = tuple(
        (
            float(rng.uniform(0.3, 0.8)),
            float(rng.normal(0.0, 2.0 * np.pi / 60.0)),
            float(rng.normal(0.0, 2.0 * np.pi / 45.0)),
            float(rng.uniform(0.0, 2.0 * np.pi)),
        )
        for _ in range(4)
    )
    return Muscle(
        wedge=rng.uniform(0.88, 0.98),
        start_mm=rng.uniform(-85.0, -55.0),
        bulge=rng.uniform(1.0, 1.3),
        medial_mm=rng.uniform(3.0, 4.5),
        lateral_mm=rng.uniform(0.3, 0.9),
        bow=rng.uniform(0.15, 0.35),
        waves=waves,
    )


def muscle_depth(muscle: Muscle, outline: Outline, frame: VoxelFrame) -> NDArray[np.float64]:
    """Depth below the muscle's front face along x, mm, positive inside it."""
    x, lateral, superior = mesh(frame)
    radius, end = outline.shape.radius_mm, outline.axilla.cut_mm
    rise = np.clip((along_mm(lateral, superior) - muscle.start_mm) / (end - muscle.start_mm), 0, 2)
    # Below the nipple there is no wedge, and little above it stays behind the plates of a
    # craniocaudal view.
    up = superior / radius
    above = smooth_step((up - LOW_FROM) / LOW_OVER)
    height = outline.axilla.height_mm
    most = LOW_MM * smooth_step(up / LOW_FROM) + (height - COVER_MM) * above
    across = across_mm(lateral, superior) - outline.axilla.offset_mm
    aside = np.clip(across / outline.axilla.half_width_mm, -1.5, 1.5)
    own = OWN_PART * OWN_MM + (1.0 - OWN_PART) * height
    wedge = muscle.wedge * min(own, height - COVER_MM) * rise**muscle.bulge
    wedge = wedge * (1.0 - muscle.bow * aside**2)
    for amplitude, along, sideways, phase in muscle.waves:
        turn = along * along_mm(lateral, superior) + sideways * across + phase
        wedge = wedge + amplitude * np.clip(3.0 * rise, 0.0, 1.0) * np.cos(turn)
    wedge = np.clip(wedge, 0.0, None)
    wedge = wedge * most / (wedge**8 + most**8 + 1e-9) ** 0.125  # a smooth minimum
    share = np.clip(0.5 - 0.5 * lateral / radius, 0.0, 1.0)
    slab = muscle.lateral_mm + (muscle.medial_mm - muscle.lateral_mm) * share
    front: NDArray[np.float64] = np.hypot(wedge, slab)
    return front - x


def fit_volume(outline: Outline, muscle: Muscle, volume_ml: float) -> Outline:
    """Scale an outline until what is in front of the muscle has a volume, mL.

    The abdominal wall below the fold is no part of it.
    """
    for _ in range(5):  # the slab does not scale: each turn leaves a tenth of the last one's error
        frame = coarse_frame(outline)
        depth = breast_depth(outline, frame)
        x, lateral, superior = mesh(frame)
        tissue = (depth > 0) & (along_mm(lateral, superior) < outline.axilla.cut_mm)
        muscled = (muscle_depth(muscle, outline, frame) > 0) & (depth > COVER_MM)
        # Points on the chest-wall plane stand for half as much.
        weight = np.where(x == 0, 0.5, 1.0) * (x >= 0) * np.where(muscled, FAT_IN_MUSCLE, 1.0)
        found_ml = float((weight * tissue).sum()) * GRID_MM**3 / 1000.0
        outline = outline.scaled((volume_ml / found_ml) ** (1.0 / 3.0))
    return outline


def fibre_coordinates(
    outline: Outline, muscled: NDArray[np.float64], frame: VoxelFrame, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Coordinates along and across the muscle's bundles, mm.

    They fan out from the arm, and lie in layers that follow the muscle's front, so that an oblique
    view shows them along its edge. `muscled` is the depth below the front, mm.
    """
    x, lateral, superior = mesh(frame)
    ahead = outline.axilla.cut_mm + INSERTION_MM - along_mm(lateral, superior)
    across = across_mm(lateral, superior)
    distance = np.hypot(np.maximum(ahead, 1.0), across)
    fan = INSERTION_MM * np.arctan2(across, np.maximum(ahead, 1.0))
    layer = LAYERS_MM * x / np.maximum(muscled + x, THIN_MM)
    straight = list(np.broadcast_arrays(distance / BUNDLE_LENGTH, fan, layer))
    bent = [
        part + FIBRE_BEND_MM[0] * smooth_noise(rng, frame, FIBRE_BEND_MM[1]) for part in straight
    ]
    own = rng.spawn(1)[0]  # what is drawn next keeps its stream
    for part in bent[1:]:
        part += CROSS_BEND_MM[0] * noise_over(own, straight, CROSS_BEND_MM[1])
    return bent
