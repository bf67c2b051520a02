"""The pectoral muscle: a sheet that stands off the chest wall towards the axilla, on a slab.

The oblique view is taken along the sheet's face: between the plates it is the triangle that starts
at the upper chest-wall corner and ends at about the nipple's level, two to three centimetres of
muscle with fat on both sides. The slab, which thickens medially, is the curve of the chest, by
which a reader tells left from right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

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

END_FROM, END_OVER = -0.1, 0.45
"""Place at the nipple where the muscle's wedge ends, and the distance over which it is blended
in, in radii of the breast: an abrupt end drew a level step across the picture's chest wall. Its
front leaves oblique views at about the nipple's level, where it comes near the wall; it ends above
that level in 75.5 % of clinical ones (Spuur et al. 2008)."""

COVER_MM = 7.0
"""Least skin and fat over the muscle, mm."""

OWN_PART, OWN_MM = 0.6, 50.0
"""The muscle is sized by this part of what it measures in the average woman, mm, and the rest of
the ridge's height: it varies less than the breast does. It is no thicker than fits under the ridge,
so that its front stays straight up to the open end. Chosen."""

SHEET_MM, SHEET_RANGE_MM = (38.0, 0.30), (22.0, 56.0)
"""Median thickness of the sheet's front at the open end, mm, spread of its logarithm, and bounds.
The sheet is gathered there, and pressed to about half: one to three centimetres along the beam. On
the chest the muscle is about 1 cm thick (assumed); in the front fold of the axilla its lower part
turns behind its upper one, and the smaller pectoral muscle lies behind both. Chosen so that muscle
is as bright as on clinical images. The area of the pectoral muscles in CT is 24.1 cm2 with a spread
of 6.8 (434 persons, most of them men: Kim et al. 2017); how much of them is drawn between the
plates differs too (assumed)."""

FAT_PART, FAT_RANGE = (0.065, 0.35), (0.03, 0.12)
"""Median share of fat in muscle, spread of its logarithm, and bounds. In muscles of the thigh it is
4.8 to 8.6 % in the young and 9.5 to 14.3 % in the old (Yoshiko et al. 2017). Attenuation of women's
muscles in CT at the height of the breast falls from 42.3 to 35.2 HU between 45 and 75 years, with a
spread of 5 HU at any age (Tonnesen et al. 2023): as much as 4 and 3 % of fat do. Part of this lies
within fibres, where no picture shows it, so that less is drawn between them (assumed)."""

STANDING = 0.6
"""Part of the muscle's stand-off that is left in views without the axilla: oblique ones draw it
forward with the breast, in others the arm is down. Assumed, so that muscle shows in about a quarter
of craniocaudal views, as in 24.5 % of 2688 pairs (Strohbach et al. 2020)."""

AGEING, REST = 0.7, 0.714
"""Part of what differs between women's muscles that makes them thinner and fatter at once, as age
does (area 157 cm2 below 45 years, 119 cm2 from 75 on, spread 17 to 22: Tonnesen et al. 2023), and
of what does not. Their squares add up to one; assumed."""

FAT_OF_WALLS = 0.009
"""Share of fat that the walls between bundles make up, as they are drawn."""

BUNDLE_MM = 8.0
"""Width of the muscle's bundles, mm. Chosen by eye."""

BUNDLE_LENGTHS = (4.0, 14.0)
"""Range of their length against it. On clinical images the muscle's texture is directed by 0.08 to
0.58 (ratio of the difference to the sum of squared slopes along and across; five MLO). Chosen."""

FIBRE_BEND_MM = (1.2, 50.0)
"""Amplitude and wavelength by which bundles are bent, mm: fibres are nearly straight. Chosen."""

CROSS_BENDS_MM, CROSS_BEND_LENGTH_MM = (1.2, 2.8), 16.0
"""Range of the amplitude, and wavelength, mm, by which walls between bundles are bent in a
cross-section: a flat wall that a ray touches over a bundle's width draws a dark line, straight and
sharp as on no mammogram. Along the fibres this noise is as long as bundles are. Chosen by eye."""

INSERTION_MM, STAND_OFF_MM = 130.0, (45.0, 85.0)
"""How far beyond the open end the bundles meet, mm: the muscle's tendon at the upper arm; and how
far off the chest-wall plane. From there they fan out to the chest wall, so that an oblique view
shows them nearly along the muscle's front near it, and more inclined behind it. Assumed."""


@dataclass(frozen=True)
class Muscle:
    """Size and composition of the muscle in front of the chest-wall plane.

    Parameters
    ----------
    wedge : float
        How far it stands off the wall at the open end, against the mean of the axillary ridge's
        height and `OWN_MM`, or what fits under the ridge: positioning draws it off the chest wall.
    start_mm : float
        Where along the way to the axilla it starts to stand off, against the nipple, mm.
    bulge : float
        Power of the front edge, above 1: plates push its middle forward most, so that in an oblique
        view it is straight or gently convex.
    sheet_mm : float
        Thickness of the sheet at the open end behind its rounded front, mm.
    low : float
        Thickness of the sheet where it starts, against that at the open end.
    nose_mm : float
        Length of its rounded front, mm.
    widening : float
        Growth of its thickness from the front to the wall, mm per mm.
    aside_mm : float
        The sheet's place across the way to the axilla, against the ridge's middle, mm.
    fat : float
        Share of fat between and within its bundles.
    medial_mm, lateral_mm : float
        Slab's thickness at the medial and lateral border of the base, mm.
    bundle_length : float
        Length of its bundles against `BUNDLE_MM`.
    cross_bend_mm : float
        Amplitude by which walls between bundles are bent in a cross-section, mm.
    stand_off_mm : float
        Distance off the chest-wall plane of the place where bundles meet, mm.
    waves : tuple of (amplitude, along, across, phase)
        Unevenness of the front: mm, radians a mm along and across the way to the axilla, radians.
    """

    wedge: float
    start_mm: float
    bulge: float
    sheet_mm: float
    low: float
    nose_mm: float
    widening: float
    aside_mm: float
    fat: float
    medial_mm: float
    lateral_mm: float
    bundle_length: float
    cross_bend_mm: float
    stand_off_mm: float
    waves: tuple[tuple[float, float, float, float], ...]

    @property
    def streaks(self) -> float:
        """Standard deviations of noise above which muscle is fat, so that its share is met."""
        return float(-ndtri(self.fat - FAT_OF_WALLS))


def draw_muscle(rng: np.random.Generator) -> Muscle:
    """A muscle whose triangle is 30 to 58 mm wide where an oblique picture ends, and 104 to 160 mm
    long, as on clinical images."""
    waves = tuple(
        (
            float(rng.uniform(0.2, 0.6)),
            float(rng.normal(0.0, 2.0 * np.pi / 60.0)),
            float(rng.normal(0.0, 2.0 * np.pi / 45.0)),
            float(rng.uniform(0.0, 2.0 * np.pi)),
        )
        for _ in range(4)
    )
    own = rng.spawn(1)[0]
    age, thickness, fat = own.standard_normal(3)
    thickness, fat = REST * thickness - AGEING * age, REST * fat + AGEING * age
    return Muscle(
        wedge=rng.uniform(0.88, 0.98),
        start_mm=rng.uniform(-100.0, -70.0),
        bulge=rng.uniform(1.2, 1.5),
        medial_mm=rng.uniform(3.0, 4.5),
        lateral_mm=rng.uniform(0.3, 0.9),
        low=rng.uniform(0.45, 0.8),
        sheet_mm=float(np.clip(SHEET_MM[0] * np.exp(SHEET_MM[1] * thickness), *SHEET_RANGE_MM)),
        nose_mm=own.uniform(2.5, 5.0),
        widening=own.uniform(0.2, 0.7),
        aside_mm=4.0 * float(own.standard_normal()),
        bundle_length=float(np.exp(own.uniform(*np.log(BUNDLE_LENGTHS)))),
        cross_bend_mm=own.uniform(*CROSS_BENDS_MM),
        stand_off_mm=own.uniform(*STAND_OFF_MM),
        fat=float(np.clip(FAT_PART[0] * np.exp(FAT_PART[1] * fat), *FAT_RANGE)),
        waves=waves,
    )


def muscle_depths(
    muscle: Muscle, outline: Outline, frame: VoxelFrame
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth behind the muscle's front and depth below its surface, mm, positive inside.

    The front is the one that an oblique view shows; behind it, at any distance across from the
    sheet, there is muscle or the fat beside it. Its depth is along x.
    """
    x, lateral, superior = mesh(frame)
    wedge, rise, slab = _profile(muscle, outline, frame)
    front: NDArray[np.float64] = np.hypot(wedge, slab)
    across = np.abs(across_mm(lateral, superior) - outline.axilla.offset_mm - muscle.aside_mm)
    behind = wedge - x
    half = 0.5 * muscle.sheet_mm * (muscle.low + (1.0 - muscle.low) * rise.clip(0.0, 1.0))
    part = np.clip(behind / muscle.nose_mm, 0.0, 1.0)
    within = half * np.sqrt(part * (2.0 - part)) + 0.5 * muscle.widening * behind.clip(0.0)
    depth: NDArray[np.float64] = np.maximum(np.minimum(behind, within - across), slab - x)
    return front - x, depth


def _profile(
    muscle: Muscle, outline: Outline, frame: VoxelFrame
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """How far the sheet's front stands off the wall, mm, the part of the way from where it starts
    to the open end, and the slab's thickness, mm."""
    _, lateral, superior = mesh(frame)
    radius, end = outline.shape.radius_mm, outline.axilla.cut_mm
    rise = np.clip((along_mm(lateral, superior) - muscle.start_mm) / (end - muscle.start_mm), 0, 2)
    height = outline.axilla.height_mm
    across = across_mm(lateral, superior) - outline.axilla.offset_mm
    own = OWN_PART * OWN_MM + (1.0 - OWN_PART) * height
    wedge = muscle.wedge * min(own, height - COVER_MM) * rise**muscle.bulge
    for amplitude, along, sideways, phase in muscle.waves:
        turn = along * along_mm(lateral, superior) + sideways * across + phase
        wedge = wedge + amplitude * np.clip(3.0 * rise, 0.0, 1.0) * np.cos(turn)
    wedge = np.clip(wedge, 0.0, None) * smooth_step((superior / radius - END_FROM) / END_OVER)
    share = np.clip(0.5 - 0.5 * lateral / radius, 0.0, 1.0)
    slab = muscle.lateral_mm + (muscle.medial_mm - muscle.lateral_mm) * share
    return wedge, rise, slab


def fit_volume(outline: Outline, muscle: Muscle, volume_ml: float) -> Outline:
    """Scale an outline until what is in front of the muscle has a volume, mL.

    The abdominal wall below the fold is no part of it.
    """
    for _ in range(5):  # the slab does not scale: each turn leaves a tenth of the last one's error
        frame = coarse_frame(outline)
        depth = breast_depth(outline, frame)
        x, lateral, superior = mesh(frame)
        tissue = (depth > 0) & (along_mm(lateral, superior) < outline.axilla.cut_mm)
        muscled = (muscle_depths(muscle, outline, frame)[1] > 0) & (depth > COVER_MM)
        # Points on the chest-wall plane stand for half as much.
        weight = np.where(x == 0, 0.5, 1.0) * (x >= 0) * np.where(muscled, muscle.fat, 1.0)
        found_ml = float((weight * tissue).sum()) * GRID_MM**3 / 1000.0
        outline = outline.scaled((volume_ml / found_ml) ** (1.0 / 3.0))
    return outline


def fibre_coordinates(
    muscle: Muscle, outline: Outline, frame: VoxelFrame, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Coordinates along and across the muscle's bundles, mm, which fan out from the arm."""
    x, lateral, superior = mesh(frame)
    ahead = np.maximum(outline.axilla.cut_mm + INSERTION_MM - along_mm(lateral, superior), 1.0)
    across, below = across_mm(lateral, superior), muscle.stand_off_mm - x
    distance = np.sqrt(ahead**2 + across**2 + below**2)
    fan = INSERTION_MM * np.arctan2(across, ahead)
    layer = INSERTION_MM * np.arctan2(below, ahead)
    straight = list(np.broadcast_arrays(distance / muscle.bundle_length, fan, layer))
    bent = [
        part + FIBRE_BEND_MM[0] * smooth_noise(rng, frame, FIBRE_BEND_MM[1]) for part in straight
    ]
    own = rng.spawn(1)[0]  # what is drawn next keeps its stream
    for part in bent[1:]:
        part += muscle.cross_bend_mm * noise_over(own, straight, CROSS_BEND_LENGTH_MM)
    return bent
