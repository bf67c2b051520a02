"""Straight round pieces, of which ducts and vessels are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame

STEP_MM = 2.5
"""Length of one straight piece of a duct or vessel, mm."""

Piece = tuple[NDArray[np.float64], NDArray[np.float64], float, float, int]
"""Both ends, the radius at each, mm, and the label."""


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


def gather_tubes(pieces: Sequence[Piece]) -> Tubes:
    """Pieces in the order in which they are painted: later ones over earlier ones."""
    return Tubes(
        np.array([[piece[0], piece[1]] for piece in pieces]),
        np.array([[piece[2], piece[3]] for piece in pieces]),
        np.array([piece[4] for piece in pieces], np.uint8),
    )


def value_at(field: NDArray[np.float64], frame: VoxelFrame, point: NDArray[np.float64]) -> float:
    """Value of a coarse field at a point, trilinear."""
    index = frame.index(point)[:, None]
    return float(ndimage.map_coordinates(field, index, order=1, mode="nearest")[0])


def turned(
    direction: NDArray[np.float64], amount: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """A direction turned at random by about so many radians, as a unit vector."""
    other = direction + amount * rng.standard_normal(3)
    unit: NDArray[np.float64] = other / np.linalg.norm(other)
    return unit
