"""Breast and axilla joined: the grid of everything smooth, depth below the skin, volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim._side_by_side import both
from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._slope_kernels import slopes
from mammosim.phantom.anatomy.axilla import (
    HELD_FROM,
    HELD_OVER,
    Axilla,
    along_mm,
    ridge_level,
)
from mammosim.phantom.anatomy.fold import FILLET_MM as FOLD_MM
from mammosim.phantom.anatomy.fold import Fold, mound_level
from mammosim.phantom.anatomy.shape import Points, Shape, level, smooth_step

GRID_MM = 2.0
"""Spacing of the grid on which everything smooth is made, mm; a skin of radius 50 mm lies within
h^2 / 8r = 0.01 mm of its trilinear interpolation."""

FRONT_MM, SIDE_MM = 28.0, 14.0
"""Margins of that grid, mm: in front the highest nipple (12 mm) and three of the largest voxels
(4 mm), at the sides three voxels, with one point to spare."""

FILLET_MM, FILLET = 40.0, 0.735
"""Width of the hollow between breast and axillary fold over which one goes into the other, mm, and
the most of it in radii of the breast: in a small one it would lift the skin at the nipple."""


UNMOVED_MM = 0.1
"""A surface that would move by less than this stays, mm."""


@dataclass(frozen=True)
class Outline:
    """Breast, axilla and the fold below the breast."""

    shape: Shape
    axilla: Axilla
    fold: Fold

    def scaled(self, factor: float) -> Outline:
        """The same outline with a breast larger by a factor; the fold of the axilla follows."""
        axilla = Axilla(*(factor * length for length in vars(self.axilla).values()))
        fold = Fold(*(factor * length for length in vars(self.fold).values()))
        return replace(self, shape=self.shape.scaled(factor), axilla=axilla, fold=fold)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Depths below surfaces on a grid, to first order near each, mm; positive inside everywhere.

    Parameters
    ----------
    breast_mm, with_axilla_mm, joined_mm : ndarray, [x, lateral, superior]
        Of the breast by itself, joined with the axilla, and with the abdominal wall too.
    """

    breast_mm: NDArray[np.float64]
    with_axilla_mm: NDArray[np.float64]
    joined_mm: NDArray[np.float64]


def surfaces_of(outline: Outline, frame: VoxelFrame) -> Surfaces:
    """Surfaces of an outline on the grid of `GRID_MM`."""
    points = mesh(frame)
    breast = _breast(outline, points, GRID_MM)
    with_axilla = _with_axilla(breast, outline, points, GRID_MM)
    return Surfaces(breast, with_axilla, _with_mound(with_axilla, outline, points, GRID_MM))


def coarse_frame(outline: Outline) -> VoxelFrame:
    """Grid of `GRID_MM` around breast and axilla up to its cut, generator coordinates."""
    shape, axilla = outline.shape, outline.axilla
    ends = axilla.cut_mm + axilla.half_width_mm + abs(axilla.offset_mm)
    reach = max(1.75 * shape.radius_mm + abs(shape.base_superior_mm), 0.75 * ends)
    step = 2.0 * GRID_MM
    sides = np.arange(-np.ceil(reach / step), np.ceil(reach / step) + 1) * step
    x = np.arange(0.0, shape.front_mm + step, step)
    along, across, up = np.ix_(x, sides, sides)
    found = np.argwhere(_joined(outline, (along, across, up), step) > 0)
    found = found[along_mm(sides[found[:, 1]], sides[found[:, 2]]) < axilla.cut_mm + step]
    margin = SIDE_MM + step
    low = sides[found[:, 1:].min(axis=0)] - margin
    high = sides[found[:, 1:].max(axis=0)] + margin
    low = np.array([-2.0 * GRID_MM, *low])
    high = np.array([shape.front_mm + FRONT_MM, *high])
    nx, ny, nz = (int(n) for n in np.ceil((high - low) / GRID_MM) + 1)
    return VoxelFrame(low, np.full(3, GRID_MM), (nx, ny, nz))


def mesh(frame: VoxelFrame) -> Points:
    """Open mesh of the grid's coordinates."""
    along, across, up = np.ix_(*(frame.axis_mm(axis) for axis in range(3)))
    return along, across, up


def skin_depth(surfaces: Surfaces) -> NDArray[np.float64]:
    """Distance below the skin's outer face, mm, negative outside; nipple left out.

    Near the skin it is exact to first order; deeper, it is the distance to the nearest grid point
    outside corrected by that point's own distance. Beyond the cut the body goes on.
    """
    value = surfaces.joined_mm
    near = _of_unit_slope(value)
    far, nearest = ndimage.distance_transform_edt(value > 0, sampling=GRID_MM, return_indices=True)
    far = far + np.clip(near[tuple(nearest)], -2.0 * GRID_MM, 0.0)
    weight = np.clip((near - 3.0) / 5.0, 0.0, 1.0)
    blended: NDArray[np.float64] = np.where(value > 0, (1 - weight) * near + weight * far, near)
    return np.clip(blended, -4.0 * GRID_MM, None)


def held_depth(outline: Outline, surfaces: Surfaces, frame: VoxelFrame) -> NDArray[np.float64]:
    """Depth below the skin near it in views without the axilla, mm.

    There the breast ends in its own surface, which oblique views lose in that of the axilla. Where
    neither differs it is large, so that nothing is done there.
    """
    _, lateral, superior = mesh(frame)
    near, breast = surfaces.joined_mm, surfaces.breast_mm
    way = along_mm(lateral, superior) / outline.shape.radius_mm
    upper = smooth_step((way - HELD_FROM) / HELD_OVER)
    # Below, skin is moved only where the abdominal wall is left out.
    lower = np.where(near - breast > UNMOVED_MM, smooth_step(-way / HELD_OVER), 0.0)
    part, joined = upper + lower, _of_unit_slope(near)
    held: NDArray[np.float64] = np.where(part > 0.0, joined + part * (breast - joined), 40.0)
    return held


def depth_of_breast(surfaces: Surfaces, skin_depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth below the skin, mm, or below the surface that the breast has without abdominal wall."""
    breast = surfaces.with_axilla_mm
    below = surfaces.joined_mm - breast > UNMOVED_MM
    depth: NDArray[np.float64] = np.where(below, np.minimum(skin_depth_mm, breast), skin_depth_mm)
    return depth


def breast_depth(outline: Outline, frame: VoxelFrame) -> NDArray[np.float64]:
    """Depth near the skin of a breast without abdominal wall, mm; positive inside everywhere."""
    return _breast_and_axilla(outline, mesh(frame), GRID_MM)


def _joined(outline: Outline, points_mm: Points, step_mm: float) -> NDArray[np.float64]:
    """Smooth union of breast, ridge and abdominal wall: depth to first order near the skin, mm."""
    breast = _breast_and_axilla(outline, points_mm, step_mm)
    return _with_mound(breast, outline, points_mm, step_mm)


def _with_mound(
    breast: NDArray[np.float64], outline: Outline, points_mm: Points, step_mm: float
) -> NDArray[np.float64]:
    mound = _to_first_order(mound_level(outline.fold, points_mm), step_mm)
    return _with_hollow(breast, mound, FOLD_MM)


def _breast_and_axilla(outline: Outline, points_mm: Points, step_mm: float) -> NDArray[np.float64]:
    """Smooth union of breast and ridge: depth to first order near the skin, mm."""
    return _with_axilla(_breast(outline, points_mm, step_mm), outline, points_mm, step_mm)


def _breast(outline: Outline, points_mm: Points, step_mm: float) -> NDArray[np.float64]:
    return _to_first_order(_in_halves(partial(level, outline.shape), points_mm), step_mm)


def _with_axilla(
    breast: NDArray[np.float64], outline: Outline, points_mm: Points, step_mm: float
) -> NDArray[np.float64]:
    ridge = _to_first_order(ridge_level(outline.axilla, outline.shape, points_mm), step_mm)
    return _with_hollow(breast, ridge, min(FILLET_MM, FILLET * outline.shape.radius_mm))


def _with_hollow(
    one: NDArray[np.float64], other: NDArray[np.float64], width_mm: float
) -> NDArray[np.float64]:
    """Union of two depths with a hollow of a width between their surfaces, mm."""
    overlap = np.clip(width_mm - np.abs(one - other), 0.0, None)
    union: NDArray[np.float64] = np.maximum(one, other) + overlap**2 / (4.0 * width_mm)
    return union


def _in_halves(
    value: Callable[[Points], NDArray[np.float64]], points_mm: Points
) -> NDArray[np.float64]:
    """Values at the points of a mesh, those behind and in front at the same time."""
    x, lateral, superior = points_mm
    halves = (x[: len(x) // 2], x[len(x) // 2 :])
    behind, ahead = (partial(value, (half, lateral, superior)) for half in halves)
    return np.concatenate(both(behind, ahead))


def _to_first_order(value: NDArray[np.float64], step_mm: float) -> NDArray[np.float64]:
    """Distance from a level's zero, mm: level / |gradient|, bounded where it means nothing."""
    distance: NDArray[np.float64] = value / np.maximum(steepness(value, step_mm), 1e-6)
    return np.clip(distance, -40.0, 40.0)


def _of_unit_slope(depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """A depth near the skin divided by its slope, which is not one where two bodies join."""
    divided: NDArray[np.float64] = depth_mm / np.maximum(steepness(depth_mm), 0.3)
    return divided


def steepness(value: NDArray[np.float64], step_mm: float = GRID_MM) -> NDArray[np.float64]:
    """Change of a field per millimetre in the direction in which it changes most."""
    slope = np.empty(value.shape)
    slopes(np.ascontiguousarray(value), step_mm, slope)
    return slope
