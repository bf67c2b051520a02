"""The breast's outer shape: a half-ellipsoid made uneven, with a tail towards the axilla.

Coordinates of the generator are [x anterior, lateral, superior] in mm with the nipple's foot on
the x axis; a left breast has lateral = +y and a right one lateral = -y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.geometry import VoxelFrame

GRID_MM = 2.0
"""Spacing of the grid on which everything smooth is made, mm; a skin of radius 50 mm lies within
h^2 / 8r = 0.01 mm of its trilinear interpolation."""

FRONT_MM, SIDE_MM = 28.0, 14.0
"""Margins of that grid, mm: in front the highest nipple (12 mm) and three of the largest voxels
(4 mm), at the sides three voxels, with one point to spare."""


@dataclass(frozen=True)
class Shape:
    """Outer shape, all lengths in mm.

    Parameters
    ----------
    depth_mm : float
        Chest wall to the nipple's foot.
    radius_mm : float
        Mean radius of the base.
    base_lateral_mm, base_superior_mm : float
        Centre of the base against the nipple: it lies medial and above, as the nipple points
        outward and hangs.
    tail : float
        Growth of the base towards the axilla, as a fraction of the radius.
    slope : float
        0 for a round upper profile, 1 for a straight one.
    ripple : tuple of float
        Cosine and sine parts of the base's second and third harmonics, fractions of the radius.
    """

    depth_mm: float
    radius_mm: float
    base_lateral_mm: float
    base_superior_mm: float
    tail: float
    slope: float
    ripple: tuple[float, float, float, float]

    def scaled(self, factor: float) -> Shape:
        """The same shape, larger by a factor."""
        return Shape(
            self.depth_mm * factor, self.radius_mm * factor, self.base_lateral_mm * factor,
            self.base_superior_mm * factor, self.tail, self.slope, self.ripple,
        )  # fmt: skip


def draw_shape(rng: np.random.Generator) -> Shape:
    """A shape of about 600 mL; `fit_volume` makes it the size wanted."""
    radius = 62.0 * rng.uniform(0.95, 1.05)
    ripple = 0.02 * rng.standard_normal(4).clip(-2.0, 2.0)
    return Shape(
        depth_mm=radius * rng.uniform(1.08, 1.34),
        radius_mm=radius,
        base_lateral_mm=radius * rng.uniform(-0.10, 0.0),
        base_superior_mm=radius * rng.uniform(0.06, 0.20),
        tail=rng.uniform(0.20, 0.31),
        slope=rng.uniform(0.4, 1.0),
        ripple=(float(ripple[0]), float(ripple[1]), float(ripple[2]), float(ripple[3])),
    )


def level(shape: Shape, points_mm: tuple[NDArray, NDArray, NDArray]) -> NDArray[np.float64]:
    """Positive inside, 0 on the skin, negative outside; smooth everywhere.

    Parameters
    ----------
    shape : Shape
    points_mm : tuple of three ndarray that broadcast
        x, lateral, superior, mm.

    Notes
    -----
    The section at depth fraction t = x / depth is r = R(angle) (1 - t^p)^(1/q): p = q = 2 is an
    ellipsoid, smaller p and q make the profile straighter. The section's centre goes from the
    base's to the nipple's as t grows. Depth is taken as 0 behind the chest wall.
    """
    x, lateral, superior = points_mm
    t = np.clip(x / shape.depth_mm, 0.0, None)
    shift = np.clip(1.0 - t**1.6, 0.0, None)
    across = lateral - shape.base_lateral_mm * shift
    up = superior - shape.base_superior_mm * shift
    angle = np.arctan2(up, across)
    c2, s2, c3, s3 = shape.ripple
    towards_axilla = np.exp(3.2 * (np.cos(angle - np.deg2rad(52.0)) - 1.0))
    reach = shape.radius_mm * (
        1.0 + shape.tail * towards_axilla * np.clip(1.0 - t, 0.0, 1.0) ** 0.5
        + c2 * np.cos(2 * angle) + s2 * np.sin(2 * angle)
        + c3 * np.cos(3 * angle) + s3 * np.sin(3 * angle)
    )  # fmt: skip
    upper = 0.5 * (1.0 + np.tanh(1.5 * np.sin(angle)))
    p = 2.15 - 0.65 * shape.slope * upper
    q = 2.1 - 0.35 * shape.slope * upper
    return 1.0 - (np.hypot(across, up) / reach) ** q - t**p


def coarse_frame(shape: Shape) -> VoxelFrame:
    """Grid of `GRID_MM` around the whole breast, generator coordinates."""
    reach = shape.radius_mm * (1.08 + shape.tail) + SIDE_MM
    low = np.array([-2.0 * GRID_MM, -reach, -reach])
    high = np.array([shape.depth_mm + FRONT_MM, reach, reach + 0.2 * shape.radius_mm])
    nx, ny, nz = (int(n) for n in np.ceil((high - low) / GRID_MM) + 1)
    return VoxelFrame(low, np.full(3, GRID_MM), (nx, ny, nz))


def mesh(frame: VoxelFrame) -> tuple[NDArray, NDArray, NDArray]:
    """Open mesh of the grid's coordinates."""
    x, y, z = (
        frame.origin_mm[axis] + frame.spacing_mm[axis] * np.arange(frame.shape[axis])
        for axis in range(3)
    )
    return np.ix_(x, y, z)


def skin_depth(shape: Shape, frame: VoxelFrame) -> NDArray[np.float64]:
    """Distance below the skin's outer face, mm, negative outside; nipple left out.

    Near the skin it is level / |gradient|, which is exact to first order; deeper, the distance
    to the nearest grid point outside corrected by that point's own distance.
    """
    value = level(shape, mesh(frame))
    near = near_depth(value)
    far, nearest = ndimage.distance_transform_edt(value > 0, sampling=GRID_MM, return_indices=True)
    far = far + np.clip(near[tuple(nearest)], -2.0 * GRID_MM, 0.0)
    weight = np.clip((near - 3.0) / 5.0, 0.0, 1.0)
    blended: NDArray[np.float64] = np.where(value > 0, (1 - weight) * near + weight * far, near)
    return np.clip(blended, -4.0 * GRID_MM, None)


def near_depth(value: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth below the skin to first order, mm, from the level on the grid."""
    slope = np.sqrt(sum(part**2 for part in np.gradient(value, GRID_MM)))
    depth: NDArray[np.float64] = value / np.maximum(slope, 1e-6)
    return depth
