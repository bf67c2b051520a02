"""A lesion's voxels, and its record from them."""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Site:
    """Where a lesion is put.

    Parameters
    ----------
    breast : BreastPhantom
        Before any lesion.
    labels : ndarray of uint8, [x, y, z]
        Changed by painting.
    entry : LesionSettings
    centre_mm : ndarray, (3,)
        Breast frame, mm.
    label : int
        Of the lesion's voxels.
    """

    breast: BreastPhantom
    labels: NDArray[np.uint8]
    entry: LesionSettings
    centre_mm: NDArray[np.float64]
    label: int

    @property
    def radius_mm(self) -> float:
        """Of the lesion, mm."""
        return 0.5 * self.entry.size_mm

    def window(
        self, centre_mm: NDArray[np.float64], radius_mm: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Voxels around a ball, as a view, and their positions from its centre, mm."""
        corner, window = window_around(self.breast, centre_mm, radius_mm, self.labels)
        return window, _offsets(self.breast, corner, window.shape, centre_mm)


def paint_lesion(site: Site, rng: np.random.Generator) -> Lesion:
    """Label a lesion's voxels, in place, and describe it.

    Raises
    ------
    InputError
        If calcifications of an artery find none.
    """
    entry = site.entry
    if entry.kind == "mass":
        _paint_mass(site, rng)
        return _described(site, None)
    if entry.morphology == "vascular":
        return _described(site, _paint_wall(site, rng))
    balls = [clip_ball(entry.size_mm, rng)]
    if entry.kind == "calcification":
        way = site.breast.nipple_mm - site.centre_mm
        towards = way / max(float(np.linalg.norm(way)), 1e-9)
        balls = cluster_balls(
            site.radius_mm, entry.count, entry.calcification_mm, rng, entry.morphology, towards
        )
    for ball in balls:
        _paint_ball(site, ball)
    return _described(site, sum(ball.volume_mm3 for ball in balls))


def _paint_mass(site: Site, rng: np.random.Generator) -> None:
    window, offsets = site.window(site.centre_mm, site.radius_mm)
    thinnest = THINNEST_PART * float(site.breast.voxel_mm.max())
    mask = inside_mass(offsets, site.radius_mm, site.entry.margin, rng, thinnest)
    window[mask if mask.any() else _nearest(offsets)] = site.label


def _paint_wall(site: Site, rng: np.random.Generator) -> float:
    """Label stretches of the wall of arteries within a ball; returns their volume, mm3.

    A voxel of the artery is of the wall if a neighbour by a face is not artery. Of the wall the
    share `WALL_SHARE` is taken where slow noise is highest.
    """
    window, offsets = site.window(site.centre_mm, site.radius_mm)
    artery = window == TISSUES["artery"].label
    wall = artery & ~ndimage.binary_erosion(artery, border_value=1)
    wall &= (offsets**2).sum(axis=-1) <= site.radius_mm**2
    if not wall.any():
        raise InputError(
            f"lesion '{site.entry.name}': no artery within {site.radius_mm:g} mm of "
            f"{np.round(site.centre_mm, 1).tolist()} mm, expected one for morphology 'vascular'; "
            "leave position_mm out, or give a breast with labelled arteries"
        )
    waves, phases = rng.standard_normal((6, 3)) / WALL_STRETCH_MM, rng.uniform(0.0, 2 * np.pi, 6)
    noise = np.cos(offsets[wall] @ waves.T + phases).sum(axis=-1)
    chosen = np.zeros(wall.shape, bool)
    chosen[wall] = noise >= np.quantile(noise, 1.0 - WALL_SHARE)
    window[chosen] = site.label
    thickness = site.entry.calcification_mm or WALL_MM
    filled = min(1.0, thickness / float(site.breast.voxel_mm.mean()))
    return filled * np.count_nonzero(chosen) * float(np.prod(site.breast.voxel_mm))


def _paint_ball(site: Site, ball: Ball) -> None:
    """Label the voxels whose centre lies in a ball or rod, or else the nearest one."""
    window, offsets = site.window(
        site.centre_mm + ball.offset_mm, ball.radius_mm + ball.half_length_mm
    )
    # A rod longer than two voxels and thinner than three quarters of one would break up.
    voxel = float(site.breast.voxel_mm.max())
    mask = ball.contains(offsets, 0.75 * voxel if ball.half_length_mm > voxel else 0.0)
    if not mask.any():
        mask = _nearest(offsets)
    window[mask & (window != 0)] = site.label


def _nearest(offsets: NDArray[np.float64]) -> NDArray[np.bool_]:
    squared = (offsets**2).sum(axis=-1)
    mask = np.zeros(squared.shape, bool)
    mask[np.unravel_index(squared.argmin(), squared.shape)] = True
    return mask


def _described(site: Site, true_mm3: float | None) -> Lesion:
    """The lesion's record, from the voxels it got."""
    breast, entry = site.breast, site.entry
    corner, window = window_around(breast, site.centre_mm, site.radius_mm + 2.0, site.labels)
    index = np.argwhere(window == site.label)
    painted_mm3 = len(index) * float(np.prod(breast.voxel_mm))
    position = breast.frame.position_mm(corner + index.mean(axis=0))
    volume = painted_mm3 if true_mm3 is None else true_mm3
    fill = 1.0 if true_mm3 is None else min(1.0, true_mm3 / painted_mm3)
    return Lesion(
        entry.name, entry.kind, site.label, entry.kind, position, min(volume, painted_mm3), fill
    )
