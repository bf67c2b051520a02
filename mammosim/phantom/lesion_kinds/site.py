"""The site of a lesion: its voxels, and how they are labelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.breast import BreastPhantom
from mammosim.phantom.lesion_kinds.balls import Ball


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
    name : str
        Of the lesion, for messages.
    centre_mm : ndarray, (3,)
        Breast frame, mm.
    radius_mm : float
        Of the lesion, mm.
    label : int
        Of the lesion's voxels.
    """

    breast: BreastPhantom
    labels: NDArray[np.uint8]
    name: str
    centre_mm: NDArray[np.float64]
    radius_mm: float
    label: int

    def window(
        self, centre_mm: NDArray[np.float64], radius_mm: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Voxels around a ball, as a view, and their positions from its centre, mm."""
        corner, window = window_around(self.breast, centre_mm, radius_mm, self.labels)
        return window, _offsets(self.breast, corner, window.shape, centre_mm)


def paint_ball(site: Site, ball: Ball) -> None:
    """Label the voxels whose centre lies in a ball or rod, or else the nearest one."""
    window, offsets = site.window(
        site.centre_mm + ball.offset_mm, ball.radius_mm + ball.half_length_mm
    )
    # A rod longer than two voxels and thinner than three quarters of one would break up.
    voxel = float(site.breast.voxel_mm.max())
    mask = ball.contains(offsets, 0.75 * voxel if ball.half_length_mm > voxel else 0.0)
    if not mask.any():
        mask = nearest_voxel(offsets)
    window[mask & (window != 0)] = site.label


def nearest_voxel(offsets: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the voxel whose centre is nearest to a point.

    Parameters
    ----------
    offsets : ndarray, (..., 3)
        Position of every voxel's centre from the point, mm.

    Returns
    -------
    ndarray of bool, (...)
        True once: at the first of those that are equally near.

    Examples
    --------
    >>> nearest_voxel(np.array([[2.0, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])).tolist()
    [False, True, False]
    """
    squared = (offsets**2).sum(axis=-1)
    mask = np.zeros(squared.shape, bool)
    mask[np.unravel_index(squared.argmin(), squared.shape)] = True
    return mask
