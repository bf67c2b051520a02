"""Arteries and veins under the skin: winding trunks from the breast's border that branch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.outline import Outline
from mammosim.phantom.anatomy.tubes import STEP_MM, Piece, turned, value_at
from mammosim.tissues import TISSUES

VESSELS = (("artery", 5, 0.8), ("vein", 6, 1.3))
"""Tissue, number of trunks and their radius (mm): what is large enough to be seen on a
mammogram. Most blood comes from the lateral thoracic artery in the upper outer quadrant and from
branches of the internal thoracic artery at the medial border."""

ORIGINS_DEG = (55.0, 30.0, 170.0, 195.0, 80.0, 150.0)
"""Where trunks enter, from lateral to superior: from the axilla and from the sternum, in turn."""

THINNEST_MM = 0.3
"""Radius at which a vessel ends, mm; a choice: thinner ones do not show."""


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
    label : int
    """

    skin_depth_mm: NDArray[np.float64]
    inward: NDArray[np.float64]
    frame: VoxelFrame
    target_mm: NDArray[np.float64]
    depth_mm: float
    label: int


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
    for tissue, number, radius in VESSELS:
        label = TISSUES[tissue].label
        for turn in range(number):
            angle = np.deg2rad(ORIGINS_DEG[turn % len(ORIGINS_DEG)] + rng.normal(0.0, 14.0))
            course = _course(outline, skin_depth_mm, inward, frame, label, rng)
            start = _entry(outline, skin_depth_mm, muscle_depth_mm, frame, angle)
            wide = radius * rng.uniform(0.65, 1.15)
            pieces += _vessel(course, start, wide, rng)
    return pieces


def _entry(
    outline: Outline,
    skin_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    angle: float,
) -> NDArray[np.float64]:
    """A point at the border of the breast, under the skin and in front of the muscle, mm."""
    out = np.array([0.0, np.cos(angle), np.sin(angle)])
    for reach in np.arange(1.2, 0.3, -0.05):
        for x in (8.0, 14.0, 22.0, 32.0, 44.0):
            point = np.array([x, 0.0, 0.0]) + reach * outline.shape.radius_mm * out
            covered = value_at(skin_depth_mm, frame, point) > 5.0
            if covered and value_at(muscle_depth_mm, frame, point) < -2.0:
                return point
    return np.array([0.5 * outline.shape.depth_mm, 0.0, 0.0])


def _course(
    outline: Outline,
    skin_depth_mm: NDArray[np.float64],
    inward: NDArray[np.float64],
    frame: VoxelFrame,
    label: int,
    rng: np.random.Generator,
) -> Course:
    around = 14.0 * rng.standard_normal(3)
    target = np.array([outline.shape.depth_mm - 14.0, 0.0, 0.0]) + around
    return Course(skin_depth_mm, inward, frame, target, rng.uniform(4.5, 13.0), label)


def _vessel(
    course: Course, start: NDArray[np.float64], radius_mm: float, rng: np.random.Generator
) -> list[Piece]:
    """A trunk and its branches, each thinner than what it leaves (Murray 1926: cubes add up)."""
    pieces: list[Piece] = []
    heading = course.target_mm - start
    open_ends = [(start, heading / np.linalg.norm(heading), radius_mm, 0)]
    while open_ends:
        point, direction, radius, order = open_ends.pop()
        for _ in range(60):
            remaining = float(np.linalg.norm(course.target_mm - point))
            if radius < THINNEST_MM or remaining < 8.0:
                break
            direction = _steered(course, point, direction, order, rng)
            end = point + STEP_MM * direction
            if value_at(course.skin_depth_mm, course.frame, end) < 2.5:
                break
            pieces.append((point, end, radius, 0.98 * radius, course.label))
            point, radius = end, 0.98 * radius
            if order < 2 and rng.random() < 0.09:
                part = rng.uniform(0.25, 0.45)
                side = turned(direction, 0.5, rng)
                open_ends.append((point, side, radius * part ** (1 / 3), order + 1))
                radius *= (1.0 - part) ** (1 / 3)
    return pieces


def _steered(
    course: Course,
    point: NDArray[np.float64],
    direction: NDArray[np.float64],
    order: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """The next direction: on as before, towards the nipple, at a steady depth, and winding."""
    to_target = course.target_mm - point
    to_target /= np.linalg.norm(to_target)
    inward = np.array([value_at(part, course.frame, point) for part in course.inward])
    missing = course.depth_mm - value_at(course.skin_depth_mm, course.frame, point)
    pull = 0.3 if order == 0 else 0.08  # branches spread, trunks reach the areola
    wanted = (1.0 - pull) * direction + pull * to_target
    wanted = wanted + 0.6 * float(np.clip(missing / 6.0, -1.0, 1.0)) * inward
    return turned(wanted / np.linalg.norm(wanted), 0.17, rng)
