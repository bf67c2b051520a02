"""Where a picture must end because the phantom does, though the body goes on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.phantom import BreastPhantom, OpenEnd, leaves_picture

SAMPLE_MM = 2.0
"""Distance of the points at which an open end is looked at, mm."""

INSIDE_MM = 1.0
"""How far within the open end they lie, mm, so that they are tissue at any voxel's size."""


def open_end_mm(compressed: CompressedBreast, gantry: Gantry) -> tuple[float, float] | None:
    """Where an open end's shadow begins, and on which side.

    Parameters
    ----------
    compressed : CompressedBreast
    gantry : Gantry
        With the tube upright.

    Returns
    -------
    (float, float) or None
        Detector-plane y up to which no ray has seen the open end, mm, and +1 or -1, the side to
        which the body goes on. None where the phantom is closed or this view does not look along
        its end.
    """
    side, points = compressed_end(compressed, gantry.detector_edge_mm)
    if len(points) == 0:
        return None
    x, y, z = gantry.gantry_from_breast(points).T
    spot = gantry.focal_spot_mm
    shadow = spot[1] + (y - spot[1]) * gantry.focal_spot_height_mm / (spot[2] - z)
    return side * float((side * shadow[x > 0.0]).min(initial=np.inf)), side


def compressed_end(
    compressed: CompressedBreast, edge_mm: float
) -> tuple[float, NDArray[np.float64]]:
    """Points of an open end as compression left them.

    Parameters
    ----------
    compressed : CompressedBreast
    edge_mm : float
        Breast-frame x of the detector's edge, mm.

    Returns
    -------
    side : float
        +1 or -1, the side along y of the compression frame to which the body goes on.
    points_mm : ndarray, (n, 3)
        Phantom's frame, mm; none where the phantom is closed or this view does not look along its
        end.
    """
    none = 0.0, np.empty((0, 3))
    held, end = compressed.phantom.compressed, compressed.phantom.open_end
    if held is not None and held.end_points_mm:
        return held.end_side, np.array(held.end_points_mm)
    if end is None or not leaves_picture(compressed.phantom, compressed.view.rotation[1]):
        return none
    points = _on_open_end(compressed.phantom, end, edge_mm)
    side = math.copysign(1.0, float(compressed.view.rotation[1] @ end.normal))
    return side, points + compressed.displacement_at(points) if len(points) else points


def _on_open_end(breast: BreastPhantom, end: OpenEnd, edge_mm: float) -> NDArray[np.float64]:
    """(n, 3) points of tissue just within the open end and before the detector's edge."""
    reach = float((np.array(breast.labels.shape) * breast.voxel_mm).max())
    ahead = np.arange(edge_mm, edge_mm + reach, SAMPLE_MM)
    sideways = np.arange(-reach, reach, SAMPLE_MM)
    across = np.cross(end.normal, [1.0, 0.0, 0.0])
    base = end.point_mm - [end.point_mm[0], 0.0, 0.0] - INSIDE_MM * end.normal
    points = base + ahead[:, None, None] * np.array([1.0, 0.0, 0.0])
    points = (points + sideways[:, None] * across).reshape(-1, 3)
    index = np.rint(breast.frame.index(points)).astype(int)
    within = ((index >= 0) & (index < breast.labels.shape)).all(axis=1)
    points, index = points[within], index[within]
    return points[breast.labels[tuple(index.T)] != 0]
