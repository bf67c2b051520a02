"""Voxels of a lesion whose shape comes from a file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mammosim.phantom.lesion_kinds import Site, nearest_voxel, window_around
from mammosim.phantom.lesion_shapes.shape import LesionShape

WHOLE = 1e-9
"""Part of a voxel by which a number of voxels may miss a whole one."""

ALIKE = 1e-6
"""Parts of two voxels that differ by less are alike."""


def paint_shape(site: Site, shape: LesionShape, rotation_deg: tuple[float, float, float]) -> float:
    """Label the voxels of a shape and return its volume, mm3.

    Voxels are taken in the order of the part of them that the shape fills until they hold its
    volume, those that are filled alike together. A part thinner than a voxel thus stays where it
    fills most; where the voxels hold more than the shape's volume, they count as partly filled.

    Parameters
    ----------
    site : Site
        Its radius is that which the shape is scaled to.
    shape : LesionShape
    rotation_deg : tuple of float
        Turns about x, then y, then z of the breast frame, right-handed, degrees.
    """
    corner, window = window_around(site.breast, site.centre_mm, site.radius_mm, site.labels)
    scale = site.radius_mm / shape.radius_mm
    placing = _placing(site, shape, corner, scale, rotation_deg)
    nx, ny, nz = window.shape
    filled = shape.filled(placing, (nx, ny, nz))
    volume = shape.volume_mm3 * scale**3
    number = max(1, int(np.ceil(volume / float(np.prod(site.breast.voxel_mm)) - WHOLE)))
    if not filled.any():  # smaller than the steps in which it is looked at
        _, offsets = site.window(site.centre_mm, site.radius_mm)
        filled = nearest_voxel(offsets).astype(np.float64)
    parts = np.sort(filled[filled > 0.0])
    window[filled >= parts[-min(number, parts.size)] - ALIKE] = site.label
    return volume


def _placing(
    site: Site,
    shape: LesionShape,
    corner: NDArray[np.int64],
    scale: float,
    rotation_deg: tuple[float, float, float],
) -> NDArray[np.float64]:
    """(3, 4) from points of the shape to indices of the window."""
    turned = Rotation.from_euler("xyz", rotation_deg, degrees=True).as_matrix() * scale
    linear = turned / site.breast.voxel_mm[:, None]
    start = site.breast.frame.index(site.centre_mm) - corner - linear @ shape.centre_mm
    return np.column_stack([linear, start])
