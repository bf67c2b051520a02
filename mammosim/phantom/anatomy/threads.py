"""Fibrous threads: long, thin, gently curved lines through fat that divide and taper to nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.tubes import STEP_MM

PER_ML = 6.0
"""Threads per mL of breast. Chosen by eye."""

SUSPENSORY_SHARE = 0.4
"""Share of stems, the threads that are not branches, that suspend the gland from the skin (Cooper's
ligaments); the others run with lobes and ducts, towards the nipple."""

SKIN_START_MM = (1.5, 6.0)
"""Depth below the skin's face at which suspensory threads start, mm."""

RADIUS_MM, RADIUS_SPREAD, RADII_MM = 0.185, 0.65, (0.05, 0.55)
"""Median radius, spread of its logarithm, and bounds, mm. Chosen by eye."""

BRANCH_SHARE, BRANCH_RADIUS, BRANCH_ASIDE = 0.45, 0.75, 0.45
"""Share of threads that branch off another, their radius relative to that of the other there, and
how far they turn aside. Chosen by eye."""

STEPS = (5, 24)
"""Fewest and most straight pieces of `STEP_MM` of a thread."""

ASIDE, WINDING = 0.45, 0.06
"""How far a thread's course leaves its leading direction, and how much it turns in each step,
radians. Chosen: threads are under tension and bend slowly."""

ROOT_SHARE, TAPER = 0.12, 0.8
"""Part of its length over which a thread reaches its radius, and power with which that falls over
the rest: both ends taper, branches only one."""


@dataclass(frozen=True, eq=False)
class Threads:
    """Straight round pieces of ligament, finer than most voxels.

    Parameters
    ----------
    ends_mm : ndarray, (n, 2, 3)
        Both ends, generator coordinates, mm.
    radius_mm : ndarray, (n, 2)
    """

    ends_mm: NDArray[np.float64]
    radius_mm: NDArray[np.float64]


def draw_threads(
    skin_depth_mm: NDArray[np.float64],
    muscle_depth_mm: NDArray[np.float64],
    frame: VoxelFrame,
    foot_mm: float,
    amount: float,
    rng: np.random.Generator,
) -> Threads:
    """Threads of a breast.

    Parameters
    ----------
    skin_depth_mm, muscle_depth_mm : ndarray, [x, lateral, superior]
        Coarse fields: distance below the skin, depth below the muscle's face.
    frame : VoxelFrame
    foot_mm : float
        x of the nipple's foot.
    amount : float
        Number against that of the mean woman.
    rng : Generator
    """
    room = (skin_depth_mm > SKIN_START_MM[0]) & (muscle_depth_mm < 0.0)
    room[: max(int(-frame.origin_mm[0] / frame.spacing_mm[0]), 0)] = False
    volume_ml = np.count_nonzero(room) * float(frame.spacing_mm.prod()) / 1000.0
    number = int(PER_ML * amount * volume_ml)
    branches = int(BRANCH_SHARE * number)
    stems = number - branches
    suspensory = int(SUSPENSORY_SHARE * stems)
    shallow = room & (skin_depth_mm < SKIN_START_MM[1])
    start = np.concatenate(
        [_places(shallow, frame, suspensory, rng), _places(room, frame, stems - suspensory, rng)]
    )
    inward = np.gradient(skin_depth_mm, *frame.spacing_mm)
    index = frame.index(start).T
    leading = np.stack(
        [ndimage.map_coordinates(part, index, order=1, mode="nearest") for part in inward], axis=-1
    )
    towards = np.array([foot_mm, 0.0, 0.0]) - start
    leading[suspensory:] = _unit(towards[suspensory:])
    # Suspensory threads slant: inwards, and away from the nipple to the gland behind.
    leading[:suspensory] = _unit(_unit(leading[:suspensory]) - 0.7 * _unit(towards[:suspensory]))
    places = _courses(start, leading, ASIDE, rng)
    steps = rng.integers(STEPS[0], STEPS[1] + 1, number)
    radius = np.clip(RADIUS_MM * np.exp(RADIUS_SPREAD * rng.standard_normal(stems)), *RADII_MM)
    along = np.arange(STEPS[1] + 1) / steps[:, None]
    taper = np.clip(1.0 - along, 0.0, 1.0) ** TAPER
    thick = radius[:, None] * np.clip(along[:stems] / ROOT_SHARE, 0.0, 1.0) * taper[:stems]
    if branches:
        stem = rng.integers(0, stems, branches)
        fork = rng.integers(1, steps[stem])
        ahead = places[stem, fork + 1] - places[stem, fork]
        twigs = _courses(places[stem, fork], _unit(ahead), BRANCH_ASIDE, rng)
        places = np.concatenate([places, twigs])
        own = BRANCH_RADIUS * thick[stem, fork]
        thick = np.concatenate([thick, own[:, None] * taper[stems:]])
    return _within(places, steps, thick, room, frame)


def _places(
    room: NDArray[np.bool_], frame: VoxelFrame, number: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Random points in a region, (n, 3) mm."""
    cells = np.argwhere(room)
    chosen = cells[rng.integers(0, len(cells), number)]
    return frame.position_mm(chosen + rng.uniform(-0.5, 0.5, chosen.shape))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: NDArray[np.float64] = vectors / np.maximum(length, 1e-9)
    return unit


def _courses(
    start: NDArray[np.float64],
    leading: NDArray[np.float64],
    aside: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Places along all threads, (thread, step, 3) mm: straight but for a slow random turn."""
    direction = _unit(leading + aside * rng.standard_normal(start.shape))
    turn = WINDING * rng.standard_normal(start.shape)
    places = [start]
    for _ in range(STEPS[1]):
        turn = 0.9 * turn + 0.5 * WINDING * rng.standard_normal(start.shape)
        direction = _unit(direction + turn)
        places.append(places[-1] + STEP_MM * direction)
    return np.stack(places, axis=1)


def _within(
    places: NDArray[np.float64],
    steps: NDArray[np.int64],
    thick_mm: NDArray[np.float64],
    room: NDArray[np.bool_],
    frame: VoxelFrame,
) -> Threads:
    """Pieces up to where a thread ends or leaves the room."""
    index = np.rint(frame.index(places.reshape(-1, 3))).astype(int).reshape(places.shape)
    index = np.clip(index, 0, np.array(frame.shape) - 1)
    inside = np.logical_and.accumulate(room[index[..., 0], index[..., 1], index[..., 2]], axis=1)
    number = np.arange(places.shape[1] - 1)
    kept = (number < steps[:, None]) & inside[:, :-1] & inside[:, 1:]
    ends = np.stack([places[:, :-1], places[:, 1:]], axis=2)[kept]
    return Threads(ends, np.stack([thick_mm[:, :-1], thick_mm[:, 1:]], axis=2)[kept])
