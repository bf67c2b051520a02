"""Fibres that fray off strands and run on by themselves through the fat: a web of short ones, and a
few long ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mammosim._side_by_side import both
from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.tissue import Tissue

Courses = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Places along fibres, (fibre, place, 3) mm, and radii there, (fibre, place) mm, 0 beyond ends."""


@dataclass(frozen=True)
class Web:
    """Fibres that fray off strands.

    Parameters
    ----------
    per_ml : float
        Number of fibres per millilitre of breast.
    length_mm : float
        Mean length, mm.
    step_mm : float
        Length of a straight piece, mm.
    radius_mm, spread : float
        Median radius and spread of its logarithm.
    turning_mm : float
        Length over which a fibre turns from its strand's direction into that of the field, mm.
    wander : float
        Change of direction by chance, radians per square root of a millimetre.
    """

    per_ml: float
    length_mm: float
    step_mm: float
    radius_mm: float
    spread: float
    turning_mm: float
    wander: float


WEB = Web(190.0, 20.0, 2.5, 0.0515, 0.80, 9.0, 0.05)
"""Chosen by eye."""

LONG = Web(2.5, 55.0, 2.5, 0.10, 0.5, 22.0, 0.02)
"""Septa that are seen to run through much of a fatty breast: few, long, hardly bent. Chosen by
eye."""

LONGEST_WEB, OWN_DIRECTION = 2.5, 0.8
"""Longest fibre of the web against the mean, and spread of a fibre's own direction against that of
the field. Chosen by eye."""

SWIRL_MM, RADIAL = 20.0, 0.5
"""Wavelength of the field of directions of the web, and the part of the direction to the nipple in
it. Chosen by eye."""


def draw_web(
    web: Web,
    ends_mm: NDArray[np.float64],
    field: NDArray[np.float64],
    amount: float,
    tissue: Tissue,
    rng: np.random.Generator,
) -> Courses:
    """Fibres that start along pieces of strands and turn into the direction of a smooth field.

    Parameters
    ----------
    web : Web
    ends_mm : ndarray, (n, 2, 3)
        Both ends of the pieces of strands, generator coordinates, mm.
    field : ndarray, (x, lateral, superior, 3)
        Unit vectors on the grid of `tissue` (`web_directions`).
    amount : float
        Number of fibres against that of the mean woman.
    tissue : Tissue
    rng : Generator
    """
    count = int(amount * web.per_ml * tissue.volume_ml)
    last = np.array(tissue.frame.shape) - 1
    start = ends_mm[rng.integers(0, len(ends_mm), count)]
    at = start[:, 0].copy()
    way = _unit(start[:, 1] - start[:, 0]) * rng.choice([-1.0, 1.0], count)[:, None]
    length = web.length_mm * np.sort(rng.gamma(3.0, 1.0 / 3.0, count))[::-1]
    steps = int(LONGEST_WEB * web.length_mm / web.step_mm)
    length = np.clip(length, 2.0 * web.step_mm, steps * web.step_mm)
    own = OWN_DIRECTION * rng.standard_normal((count, 3))
    places = np.empty((count, steps + 1, 3))
    for step in range(steps + 1):
        places[:, step] = at
        going = slice(np.count_nonzero(length > step * web.step_mm))  # the longest come first
        index = np.rint(tissue.frame.index(at[going])).astype(np.int64).clip(0, last)
        wanted = field[tuple(index.T)] + own[going]
        wanted *= np.sign(_sums(wanted * way[going]))
        turned = way[going] + web.step_mm / web.turning_mm * (wanted - way[going])
        turned += web.wander * np.sqrt(web.step_mm) * rng.standard_normal(turned.shape)
        way[going] = _unit(turned)
        at[going] += web.step_mm * way[going]
    part = np.arange(steps + 1) * web.step_mm / length[:, None]
    radius = web.radius_mm * np.exp(web.spread * rng.standard_normal((count, 1)))
    # A fibre is whole where it leaves its strand, and tapers over its last two thirds.
    return places, radius * np.clip(1.5 * (1.0 - part), 0.0, 1.0)


def web_directions(tissue: Tissue, rng: np.random.Generator) -> NDArray[np.float64]:
    """Unit vectors on the grid, [x, lateral, superior, 3]: swirls, lines towards the nipple, and
    along the skin."""
    swirl, (inwards, outwards) = both(
        partial(_swirls, tissue.frame, rng), partial(_ways_of_breast, tissue)
    )
    total = swirl + RADIAL * inwards
    near_skin = np.exp(-((tissue.skin_depth_mm.clip(0.0) / 6.0) ** 2))
    total -= near_skin * (total * outwards).sum(axis=0) * outwards
    return np.ascontiguousarray(np.moveaxis(_unit(total, 0), 0, -1))


def _swirls(frame: VoxelFrame, rng: np.random.Generator) -> NDArray[np.float64]:
    """Vectors, (3, x, lateral, superior), that turn without a source; 1 in the mean square."""
    first, second = (_slopes(smooth_noise(rng, frame, SWIRL_MM), frame) for _ in range(2))
    swirl = np.cross(first, second, axis=0)
    swirl /= np.sqrt((swirl**2).sum(axis=0).mean())
    return swirl


def _ways_of_breast(tissue: Tissue) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors, (3, x, lateral, superior), towards the nipple and into the breast."""
    _, across, along = (_slopes(part, tissue.frame) for part in tissue.coordinates_mm)
    return (
        _unit(np.cross(across, along, axis=0), 0),
        _unit(_slopes(tissue.skin_depth_mm, tissue.frame), 0),
    )


def _slopes(part: NDArray[np.float64], frame: VoxelFrame) -> NDArray[np.float64]:
    """Gradient of a field, (3, x, lateral, superior), per millimetre."""
    return np.stack(tuple(np.gradient(part, *frame.spacing_mm)))


def _unit(vectors: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Vectors of length one."""
    unit: NDArray[np.float64] = vectors / np.maximum(np.sqrt(_sums(vectors**2, axis)), 1e-9)
    return unit


def _sums(vectors: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Sums of three components along an axis that is kept: NumPy's own take ten times as long."""
    first, second, third = np.moveaxis(vectors, axis, 0)
    return np.expand_dims(first + second + third, axis)
