"""Ducts that branch from the nipple with lobular units at their ends, and vessels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.fields import LOBES
from mammosim.phantom.anatomy.shape import Shape
from mammosim.tissues import TISSUES

DUCT_MM = (0.9, 0.25)
"""Radius of a duct near the nipple and at its end, mm: main ducts are about 2 mm wide
(Ramsay et al. 2005, J Anat 206:525-534); the narrow end is a choice."""

UNIT_MM = (0.5, 1.0)
"""Radius of a terminal ductal lobular unit, mm: units are 1 to 2 mm across."""

STEP_MM = 4.0
"""Length of one straight piece of a duct or vessel, mm."""

VESSELS = (("artery", 4, 0.7), ("vein", 6, 1.1))
"""Tissue, number and radius (mm) of vessels large enough to be seen on a mammogram."""


@dataclass(frozen=True, eq=False)
class Tubes:
    """Straight round pieces.

    Parameters
    ----------
    ends_mm : ndarray, (n, 2, 3)
        Both ends, generator coordinates, mm.
    radius_mm : ndarray, (n, 2)
    label : ndarray of uint8, (n,)
    """

    ends_mm: NDArray[np.float64]
    radius_mm: NDArray[np.float64]
    label: NDArray[np.uint8]


Piece = tuple[NDArray[np.float64], NDArray[np.float64], float, float, int]


def grow_tubes(
    shape: Shape,
    skin_depth_mm: NDArray[np.float64],
    gland: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    nipple_height_mm: float,
    rng: np.random.Generator,
) -> Tubes:
    """Vessels first, then ducts and lobular units over them.

    Parameters
    ----------
    shape : Shape
    skin_depth_mm, gland, muscle_depth_mm : ndarray, [x, lateral, superior]
        Coarse fields: distance below the skin, potential of gland, depth below the muscle's face.
    frame : VoxelFrame
    nipple_height_mm : float
    rng : Generator
    """
    pieces: list[Piece] = []
    for tissue, number, radius in VESSELS:
        for _ in range(number):
            pieces += _vessel(shape, skin_depth_mm, frame, radius, TISSUES[tissue].label, rng)
    for lobe in range(LOBES):
        pieces += _duct_tree(shape, gland, muscle_depth_mm, frame, nipple_height_mm, lobe, rng)
    return Tubes(
        np.array([[piece[0], piece[1]] for piece in pieces]),
        np.array([[piece[2], piece[3]] for piece in pieces]),
        np.array([piece[4] for piece in pieces], np.uint8),
    )


def _value(field: NDArray[np.float64], frame: VoxelFrame, point: NDArray[np.float64]) -> float:
    return float(
        ndimage.map_coordinates(field, frame.index(point)[:, None], order=1, mode="nearest")[0]
    )


def _turned(
    direction: NDArray[np.float64], amount: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    turned = direction + amount * rng.standard_normal(3)
    unit: NDArray[np.float64] = turned / np.linalg.norm(turned)
    return unit


def _duct_tree(
    shape: Shape,
    gland: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    nipple_height_mm: float,
    lobe: int,
    rng: np.random.Generator,
) -> list[Piece]:
    """One lobe's ducts: a main duct through the nipple that divides until it leaves the gland."""
    duct, unit = TISSUES["duct"].label, TISSUES["tdlu"].label
    angle = np.pi * (3.0 - np.sqrt(5.0)) * lobe + rng.uniform(-0.2, 0.2)
    spread = np.sqrt((lobe + 0.5) / LOBES)
    outward = np.array([0.0, np.cos(angle), np.sin(angle)])
    tip = np.array([shape.depth_mm + nipple_height_mm - 0.5, 0.0, 0.0]) + 2.0 * spread * outward
    start = np.array([shape.depth_mm - 4.0, 0.0, 0.0]) + 3.0 * spread * outward
    heading = np.array([-1.0, 0.0, 0.0]) + 1.3 * spread * outward
    pieces: list[Piece] = [(tip, start, 0.5, DUCT_MM[0], duct)]
    open_ends = [(start, heading / np.linalg.norm(heading), 0)]
    while open_ends:
        point, direction, order = open_ends.pop()
        ended = order >= 22 or len(pieces) > 160
        # Beyond the lobe's gland a branch ends; the first centimetres lead there through fat.
        if (
            ended
            or (order > 4 and _value(gland, frame, point) < 0.1)
            or (_value(muscle_depth_mm, frame, point) > -4.0)
        ):
            radius = rng.uniform(*UNIT_MM)
            for _ in range(3):
                middle = point + rng.standard_normal(3) * 0.8
                pieces.append((middle, middle, radius, radius, unit))
            continue
        branches = 2 if order > 1 and rng.random() < 0.22 else 1
        for _ in range(branches):
            turned = _turned(direction, 0.16 if branches == 1 else 0.42, rng)
            end = point + STEP_MM * rng.uniform(0.7, 1.2) * turned
            wide = DUCT_MM[1] + (DUCT_MM[0] - DUCT_MM[1]) * np.exp(-order / 5.0)
            thin = DUCT_MM[1] + (DUCT_MM[0] - DUCT_MM[1]) * np.exp(-(order + 1) / 5.0)
            pieces.append((point, end, wide, thin, duct))
            open_ends.append((end, turned, order + 1))
    return pieces


def _vessel(
    shape: Shape,
    skin_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    radius_mm: float,
    label: int,
    rng: np.random.Generator,
) -> list[Piece]:
    """A winding tube from the base towards the areola, at a steady depth below the skin."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    wanted_depth = rng.uniform(5.0, 16.0)
    outward = np.array([0.0, np.cos(angle), np.sin(angle)])
    point = np.array([8.0, 0.0, 0.0]) + 0.8 * shape.radius_mm * outward
    target = np.array([shape.depth_mm - 12.0, 0.0, 0.0]) + 8.0 * rng.standard_normal(3)
    gradient: list[NDArray[np.float64]] = list(np.gradient(skin_depth_mm, *frame.spacing_mm))
    direction = np.array([1.0, 0.0, 0.0])
    radius = radius_mm * rng.uniform(0.7, 1.2)
    pieces: list[Piece] = []
    for _ in range(60):
        inward = np.array([_value(part, frame, point) for part in gradient])
        correction = np.clip((wanted_depth - _value(skin_depth_mm, frame, point)) / 6.0, -1.0, 1.0)
        to_target = target - point
        remaining = float(np.linalg.norm(to_target))
        if remaining < 10.0 or radius < 0.35:
            break
        direction = 0.6 * direction + 0.4 * to_target / remaining + 0.8 * correction * inward
        direction = _turned(direction / np.linalg.norm(direction), 0.16, rng)
        end = point + STEP_MM * direction
        pieces.append((point, end, radius, radius * 0.98, label))
        point, radius = end, radius * 0.98
    return pieces
