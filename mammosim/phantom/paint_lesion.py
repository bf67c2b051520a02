"""A lesion's voxels, and its record from them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.errors import InputError
from mammosim.phantom.breast import BreastPhantom, Lesion
from mammosim.phantom.calcifications import cluster_balls
from mammosim.phantom.lesion_shapes import Ball, clip_ball, inside_mass
from mammosim.phantom.settings import LesionSettings
from mammosim.tissues import TISSUES

THINNEST_PART = 0.6
"""Least half width of a spicule, of a voxel: half a voxel's diagonal in a face and a little more
keeps a straight line of voxels together."""

WALL_MM, WALL_SHARE, WALL_STRETCH_MM = 0.08, 0.4, 2.5
"""Thickness of an artery's calcified wall, the share of the wall that is calcified, and about how
long its stretches are, mm. Chosen by eye, so that parallel broken tracks are seen (ACR BI-RADS
Atlas, 5th edition, 2013, "Vascular")."""


def window_around(
    breast: BreastPhantom, centre: NDArray[np.float64], radius_mm: float,
    labels: NDArray[np.uint8] | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:  # fmt: skip
    """Voxels around a ball and a voxel more, as a view, and the index of its first one."""
    at, reach = breast.frame.index(centre), radius_mm / breast.voxel_mm + 1.0
    low = np.clip(np.floor(at - reach), 0, breast.labels.shape).astype(int)
    high = np.clip(np.ceil(at + reach) + 1, 0, breast.labels.shape).astype(int)
    source = breast.labels if labels is None else labels
    return low, source[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]


def _offsets(
    breast: BreastPhantom, corner: NDArray[np.int64], shape: tuple[int, ...],
    centre: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """(nx, ny, nz, 3) positions of a window's voxels from a centre, mm."""
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1) + corner
    return breast.frame.position_mm(index) - centre


def distance_mm(
    breast: BreastPhantom, corner: NDArray[np.int64], shape: tuple[int, ...],
    centre: NDArray[np.float64],
) -> NDArray[np.float64]:  # fmt: skip
    """(nx, ny, nz) distances of a window's voxels from a centre, mm."""
    distance: NDArray[np.float64] = np.linalg.norm(_offsets(breast, corner, shape, centre), axis=-1)
    return distance


def paint_lesion(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    entry: LesionSettings,
    centre: NDArray[np.float64],
    label: int,
    rng: np.random.Generator,
) -> Lesion:
    """Label a lesion's voxels, in place, and describe it.

    Parameters
    ----------
    breast : BreastPhantom
        Before any lesion.
    labels : ndarray of uint8, [x, y, z]
        Changed.
    entry : LesionSettings
    centre : ndarray, (3,)
        Breast frame, mm.
    label : int
        Of its voxels.
    rng : Generator

    Raises
    ------
    InputError
        If calcifications of an artery find none.
    """
    radius = 0.5 * entry.size_mm
    if entry.kind == "mass":
        _paint_mass(breast, labels, entry, centre, label, rng)
        return _described(breast, labels, entry, centre, label, None)
    if entry.morphology == "vascular":
        true_mm3 = _paint_wall(breast, labels, entry, centre, label, rng)
        return _described(breast, labels, entry, centre, label, true_mm3)
    balls = [clip_ball(entry.size_mm, rng)]
    if entry.kind == "calcification":
        way = breast.nipple_mm - centre
        towards = way / max(float(np.linalg.norm(way)), 1e-9)
        balls = cluster_balls(
            radius, entry.count, entry.calcification_mm, rng, entry.morphology, towards
        )
    for ball in balls:
        _paint_ball(breast, labels, ball, centre, label)
    return _described(
        breast, labels, entry, centre, label, sum(ball.volume_mm3 for ball in balls)
    )  # fmt: skip


def _paint_mass(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    entry: LesionSettings,
    centre: NDArray[np.float64],
    label: int,
    rng: np.random.Generator,
) -> None:
    radius = 0.5 * entry.size_mm
    corner, window = window_around(breast, centre, radius, labels)
    offsets = _offsets(breast, corner, window.shape, centre)
    thinnest = THINNEST_PART * float(breast.voxel_mm.max())
    mask = inside_mass(offsets, radius, entry.margin, rng, thinnest)
    window[mask if mask.any() else _nearest(offsets)] = label


def _paint_wall(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    entry: LesionSettings,
    centre: NDArray[np.float64],
    label: int,
    rng: np.random.Generator,
) -> float:
    """Label stretches of the wall of arteries within a ball; returns their volume, mm3.

    A voxel of the artery is of the wall if a neighbour by a face is not artery. Stretches are
    where slow noise along the vessel is above its median of `WALL_SHARE`.
    """
    radius = 0.5 * entry.size_mm
    corner, window = window_around(breast, centre, radius, labels)
    offsets = _offsets(breast, corner, window.shape, centre)
    artery = window == TISSUES["artery"].label
    wall = artery & ~ndimage.binary_erosion(artery, border_value=1)
    wall &= (offsets**2).sum(axis=-1) <= radius**2
    if not wall.any():
        raise InputError(
            f"lesion '{entry.name}': no artery within {radius:g} mm of "
            f"{np.round(centre, 1).tolist()} mm, expected one for morphology 'vascular'; leave "
            "position_mm out, or give a breast with labelled arteries"
        )
    waves, phases = rng.standard_normal((6, 3)) / WALL_STRETCH_MM, rng.uniform(0.0, 6.28, 6)
    noise = np.cos(offsets[wall] @ waves.T + phases).sum(axis=-1)
    chosen = np.zeros(wall.shape, bool)
    chosen[wall] = noise >= np.quantile(noise, 1.0 - WALL_SHARE)
    window[chosen] = label
    thickness = entry.calcification_mm or WALL_MM
    filled = min(1.0, thickness / float(breast.voxel_mm.mean()))
    return filled * np.count_nonzero(chosen) * float(np.prod(breast.voxel_mm))


def _paint_ball(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    ball: Ball,
    centre: NDArray[np.float64],
    label: int,
) -> None:
    """Label the voxels whose centre lies in a ball or rod, or else the nearest one."""
    at = centre + ball.offset_mm
    corner, window = window_around(breast, at, ball.radius_mm + ball.half_length_mm, labels)
    offsets = _offsets(breast, corner, window.shape, at)
    # A rod thinner than three quarters of a voxel would break up into pieces.
    thinnest = 0.75 * float(breast.voxel_mm.max()) if ball.half_length_mm > 0 else 0.0
    mask = ball.contains(offsets, thinnest)
    if not mask.any():
        mask = _nearest(offsets)
    window[mask & (window != 0)] = label


def _nearest(offsets: NDArray[np.float64]) -> NDArray[np.bool_]:
    squared = (offsets**2).sum(axis=-1)
    mask = np.zeros(squared.shape, bool)
    mask[np.unravel_index(squared.argmin(), squared.shape)] = True
    return mask


def _described(
    breast: BreastPhantom,
    labels: NDArray[np.uint8],
    entry: LesionSettings,
    centre: NDArray[np.float64],
    label: int,
    true_mm3: float | None,
) -> Lesion:
    """The lesion's record, from the voxels it got."""
    corner, window = window_around(breast, centre, 0.5 * entry.size_mm + 2.0, labels)
    index = np.argwhere(window == label)
    painted_mm3 = len(index) * float(np.prod(breast.voxel_mm))
    position = breast.frame.position_mm(corner + index.mean(axis=0))
    volume = painted_mm3 if true_mm3 is None else true_mm3
    fill = 1.0 if true_mm3 is None else min(1.0, true_mm3 / painted_mm3)
    return Lesion(
        entry.name, entry.kind, label, entry.kind, position, min(volume, painted_mm3), fill
    )
