"""Arteries and veins under the skin: long trunks from the breast's border that taper and branch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.axilla import CUT_DEG
from mammosim.phantom.anatomy.outline import Outline
from mammosim.phantom.anatomy.tubes import STEP_MM, Piece, turned, value_at
from mammosim.tissues import TISSUES

TRUNKS = (4, 8)
"""Fewest and most trunks that are large enough to be seen on a mammogram. Chosen."""

ORIGINS_DEG = ((58.0, 22.0, 0.68), (175.0, 25.0, 0.32))
"""Where trunks enter, from lateral to superior: middle, spread and share. Most blood comes from the
lateral thoracic vessels in the upper outer quadrant and from branches of the internal thoracic
ones at the medial border."""

BEFORE_END_MM, FAR_FROM_END = 3.0, 0.9
"""Trunks that come from within 25 degrees of the axilla's direction, whose cosine is the second,
start this far before the open end, mm. Chosen."""

RADIUS_MM = {"vein": (0.5, 1.15), "artery": (0.4, 0.8)}
"""Range of a trunk's radius where it enters, mm: veins of mammograms are 1 to 3 mm wide. Chosen."""

PAIRED_SHARE, APART_MM = 0.55, (2.2, 5.0)
"""Share of veins with an artery beside them, and distance of the two, mm. Chosen."""

THINNEST_MM = 0.28
"""Radius at which a vessel ends, mm; a choice: thinner ones do not show."""

ENDING_STEPS = 10.0
"""Steps over which a vessel that comes too near to the skin narrows to `THINNEST_MM` from a trunk's
radius: it has no blunt end."""

LENGTH_MM = (90.0, 170.0)
"""Way along which a trunk tapers to `THINNEST_MM`, mm. Chosen."""

STRAIGHTNESS, WINDING = 0.86, 0.030
"""How much of its curvature a vessel keeps over a step, and what is added to it, radians a step:
vessels wind smoothly."""


Path = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Places along a vessel, (n, 3) mm, and its radius at each, mm."""


@dataclass(frozen=True, eq=False)
class Course:
    """What all pieces of a vessel share.

    Parameters
    ----------
    skin_depth_mm : ndarray, [x, lateral, superior]
    inward : ndarray, [3, x, lateral, superior]
        Gradient of the depth.
    frame : VoxelFrame
    target_mm : ndarray, (3,)
        Where it goes, behind the areola.
    depth_mm : float
        How deep below the skin it runs.
    """

    skin_depth_mm: NDArray[np.float64]
    inward: NDArray[np.float64]
    frame: VoxelFrame
    target_mm: NDArray[np.float64]
    depth_mm: float


def grow_vessels(
    outline: Outline,
    skin_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> list[Piece]:
    """Vessels from the border of the base towards the nipple.

    Parameters
    ----------
    outline : Outline
    skin_depth_mm, muscle_depth_mm : ndarray, [x, lateral, superior]
        Coarse fields: distance below the skin, depth below the muscle's face.
    frame : VoxelFrame
    rng : Generator
    """
    inward = np.array(np.gradient(skin_depth_mm, *frame.spacing_mm))
    pieces: list[Piece] = []
    for _ in range(int(rng.integers(TRUNKS[0], TRUNKS[1] + 1))):
        middle, spread, _ = ORIGINS_DEG[0 if rng.random() < ORIGINS_DEG[0][2] else 1]
        angle = np.deg2rad(rng.normal(middle, spread))
        tissue = "vein" if rng.random() < 0.7 else "artery"
        course = _course(outline, skin_depth_mm, inward, frame, rng)
        start = _entry(outline, skin_depth_mm, muscle_depth_mm, frame, angle)
        paths = _grow(course, start, rng.uniform(*RADIUS_MM[tissue]), rng)
        pieces += _pieces(paths, TISSUES[tissue].label)
        if tissue == "vein" and rng.random() < PAIRED_SHARE:
            beside = _beside(paths[0], course, rng.uniform(*RADIUS_MM["artery"]), rng)
            pieces += _pieces([beside], TISSUES["artery"].label)
    return pieces


def _entry(
    outline: Outline,
    skin_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    angle: float,
) -> NDArray[np.float64]:
    """A point at the border of the breast, under the skin and in front of the muscle, mm.

    Towards the axilla it lies near the open end: an oblique view shows the vessel from its edge on.
    """
    out = np.array([0.0, np.cos(angle), np.sin(angle)])
    radius, end = outline.shape.radius_mm, outline.axilla.cut_mm - BEFORE_END_MM
    slant = max(float(np.cos(angle - np.deg2rad(CUT_DEG))), FAR_FROM_END)
    farthest = 1.2 if slant == FAR_FROM_END else max(end / (slant * radius), 1.2)
    for reach in np.arange(farthest, 0.3, -0.05):
        for x in np.arange(8.0, 0.9 * outline.shape.depth_mm, 4.0):
            point = np.array([x, 0.0, 0.0]) + reach * radius * out
            covered = value_at(skin_depth_mm, frame, point) > 5.0
            if covered and value_at(muscle_depth_mm, frame, point) < -2.0:
                return point
    return np.array([0.5 * outline.shape.depth_mm, 0.0, 0.0])


def _course(
    outline: Outline,
    skin_depth_mm: NDArray[np.float64],
    inward: NDArray[np.float64],
    frame: VoxelFrame,
    rng: np.random.Generator,
) -> Course:
    aside = rng.normal(0.0, 0.25 * outline.shape.radius_mm, 2)
    ahead = outline.shape.depth_mm * rng.uniform(0.55, 0.9)
    target = np.array([ahead, aside[0], aside[1] - 0.1 * outline.shape.radius_mm])
    return Course(skin_depth_mm, inward, frame, target, rng.uniform(4.0, 12.0))


def _grow(
    course: Course, start: NDArray[np.float64], radius_mm: float, rng: np.random.Generator
) -> list[Path]:
    """A trunk and its branches, each thinner than what it leaves (Murray 1926: cubes add up)."""
    paths: list[Path] = []
    heading = course.target_mm - start
    waiting = [(start, heading / np.linalg.norm(heading), radius_mm, 0)]
    while waiting:
        point, direction, radius, order = waiting.pop()
        taper = (radius - THINNEST_MM) * STEP_MM / rng.uniform(*LENGTH_MM) * (1.0 + 0.5 * order)
        places, radii, curve = [point], [radius], np.zeros(3)
        while radius > THINNEST_MM and taper > 0.0:
            curve = STRAIGHTNESS * curve + WINDING * rng.standard_normal(3)
            direction = _steered(course, point, direction, curve, order)
            point = point + STEP_MM * direction
            if value_at(course.skin_depth_mm, course.frame, point) < 2.6:
                break
            if order < 2 and rng.random() < 0.035:
                part = rng.uniform(0.2, 0.45)
                side = turned(direction, 0.45, rng)
                waiting.append((point, side, radius * part ** (1 / 3), order + 1))
                radius *= (1.0 - part) ** (1 / 3)
            radius -= taper
            places.append(point)
            radii.append(max(radius, THINNEST_MM))
        ending = np.arange(len(radii))[::-1] / ENDING_STEPS
        thick = np.minimum(radii, THINNEST_MM + radius_mm * ending)
        if order == 0:
            behind = _from_muscle(start, heading / np.linalg.norm(heading))
            places, thick = [*behind, *places], np.append(np.full(len(behind), thick[0]), thick)
        paths.append((np.array(places), thick))
    return paths


def _from_muscle(
    start: NDArray[np.float64], direction: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """The way of a trunk from the chest wall to where it enters fat, a bow of places."""
    wall = np.array([-2.0, start[1], start[2]])
    corner = start - 0.5 * (start[0] + 2.0) * direction
    along = np.linspace(0.0, 1.0, max(int((start[0] + 2.0) / STEP_MM), 1) + 1)[:-1]
    return [(1 - t) ** 2 * wall + 2 * t * (1 - t) * corner + t * t * start for t in along]


def _steered(
    course: Course,
    point: NDArray[np.float64],
    direction: NDArray[np.float64],
    curve: NDArray[np.float64],
    order: int,
) -> NDArray[np.float64]:
    """The next direction: on as before, towards the target, at a steady depth, and winding."""
    to_target = course.target_mm - point
    to_target /= max(float(np.linalg.norm(to_target)), 1.0)
    inward = np.array([value_at(part, course.frame, point) for part in course.inward])
    missing = course.depth_mm - value_at(course.skin_depth_mm, course.frame, point)
    pull = 0.05 if order == 0 else 0.015  # branches spread, trunks go to the target
    wanted = direction + pull * to_target + curve
    # Under the skin a vessel follows it: what of its way leads in or out is damped.
    wanted = wanted - 0.25 * (wanted @ inward) * inward
    wanted = wanted + 0.12 * float(np.clip(missing / 6.0, -1.0, 1.0)) * inward
    unit: NDArray[np.float64] = wanted / np.linalg.norm(wanted)
    return unit


def _beside(path: Path, course: Course, radius_mm: float, rng: np.random.Generator) -> Path:
    """A path that runs beside another at a distance that changes slowly, under the same skin."""
    places, radii = path
    if len(places) < 3:
        return places, np.minimum(radii, radius_mm)
    along = np.gradient(places, axis=0)
    inward = np.array(
        [[value_at(part, course.frame, place) for part in course.inward] for place in places]
    )
    side = np.cross(along, inward)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-6)
    turn = np.linspace(0.0, 1.0, len(places))[:, None]
    apart = rng.uniform(*APART_MM) * (1.0 + 0.45 * np.sin(rng.uniform(4.0, 9.0) * turn + 1.0))
    sign = 1.0 if rng.random() < 0.5 else -1.0
    thinner = np.maximum(radii * min(radius_mm / float(radii[0]), 0.8), THINNEST_MM)
    return places + sign * apart * side, thinner


def _pieces(paths: list[Path], label: int) -> list[Piece]:
    return [
        (places[n], places[n + 1], float(radii[n]), float(radii[n + 1]), label)
        for places, radii in paths
        for n in range(len(places) - 1)
    ]
