"""Fibrous threads: long, thin, nearly straight lines through fat, to the skin and to the nipple."""

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
"""Share of threads that suspend the gland from the skin (Cooper's ligaments); the others run with
lobes and ducts, towards the nipple."""

SKIN_START_MM = (1.5, 6.0)
"""Depth below the skin's face at which suspensory threads start, mm."""

RADIUS_MM, RADIUS_SPREAD, RADII_MM = 0.16, 0.65, (0.05, 0.55)
"""Median radius, spread of its logarithm, and bounds, mm. Chosen by eye."""

STEPS = (3, 18)
"""Fewest and most straight pieces of `STEP_MM` of a thread."""

ASIDE, WINDING = 0.45, 0.045
"""How far a thread's course leaves its leading direction, and how much it turns in each step,
radians. Chosen: threads are under tension and nearly straight."""


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
    suspensory = int(SUSPENSORY_SHARE * number)
    shallow = room & (skin_depth_mm < SKIN_START_MM[1])
    start = np.concatenate(
        [
            _places(shallow, frame, suspensory, rng),
            _places(room, frame, number - suspensory, rng),
        ]
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
    places = _courses(start, leading, rng)
    steps = rng.integers(STEPS[0], STEPS[1] + 1, number)
    radius = np.clip(RADIUS_MM * np.exp(RADIUS_SPREAD * rng.standard_normal(number)), *RADII_MM)
    return _within(places, steps, radius, room, frame)


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
    start: NDArray[np.float64], leading: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Places along all threads, (thread, step, 3) mm: straight but for a slow random turn."""
    direction = _unit(leading + ASIDE * rng.standard_normal(start.shape))
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
    radius_mm: NDArray[np.float64],
    room: NDArray[np.bool_],
    frame: VoxelFrame,
) -> Threads:
    """Pieces up to where a thread ends or leaves the room; it thins towards both its ends."""
    index = np.rint(frame.index(places.reshape(-1, 3))).astype(int).reshape(places.shape)
    index = np.clip(index, 0, np.array(frame.shape) - 1)
    inside = np.logical_and.accumulate(room[index[..., 0], index[..., 1], index[..., 2]], axis=1)
    number = np.arange(places.shape[1] - 1)
    kept = (number < steps[:, None]) & inside[:, :-1] & inside[:, 1:]
    along = np.arange(places.shape[1]) / steps[:, None]
    thick = radius_mm[:, None] * np.clip(4.0 * along * (1.0 - along), 0.1, 1.0) ** 0.75
    ends = np.stack([places[:, :-1], places[:, 1:]], axis=2)[kept]
    return Threads(ends, np.stack([thick[:, :-1], thick[:, 1:]], axis=2)[kept])
