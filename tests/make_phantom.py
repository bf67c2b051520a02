"""Small phantoms for tests, made without the generator."""

from __future__ import annotations

import numpy as np

from mammosim.phantom import BreastPhantom
from mammosim.projection import ProjectionSettings
from mammosim.tissues import TISSUES

LABELS = {tissue.label: name for name, tissue in TISSUES.items()}


def half_ellipsoid_breast(
    laterality: str = "L",
    voxel_mm: float = 1.0,
    semi_axes_mm: tuple[float, float, float] = (30.0, 28.0, 26.0),
    muscle_mm: float = 0.0,
    origin_mm: tuple[float, float, float] | None = None,
) -> BreastPhantom:
    """Half an ellipsoid of fat with a skin of one voxel, a core of gland and a slab of muscle."""
    a, b, c = semi_axes_mm
    counts = [int(a / voxel_mm) + 2, 2 * int(b / voxel_mm) + 4, 2 * int(c / voxel_mm) + 4]
    voxel = np.full(3, voxel_mm)
    origin = np.array([0.5, -0.5 * (counts[1] - 1), -0.5 * (counts[2] - 1)]) * voxel_mm
    x, y, z = (origin[d] + voxel_mm * np.indices(counts)[d] for d in range(3))
    radius = np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2)
    labels = np.zeros(counts, np.uint8)
    labels[radius <= 1] = TISSUES["adipose"].label
    labels[radius <= 0.5] = TISSUES["gland"].label
    labels[(radius <= 1) & (radius > 1 - 1.5 * voxel_mm / c)] = TISSUES["skin"].label
    labels[(radius <= 1) & (x < muscle_mm)] = TISSUES["muscle"].label
    tip = np.argwhere(labels > 0)[:, 0].max()
    nipple = np.array([origin[0] + tip * voxel_mm, 0.0, 0.0])
    if origin_mm is not None:
        shift = np.asarray(origin_mm) - origin
        origin, nipple = origin + shift, nipple + shift
    return BreastPhantom(labels, voxel, origin, laterality, LABELS, nipple, source="test breast")


def far_away(**keys) -> ProjectionSettings:
    """Settings of a projection from 1 km away, farther than a configuration may ask for."""
    return ProjectionSettings(**keys).model_copy(update={"source_to_detector_mm": 1e6})
