"""Biopsy clips: a rod of titanium wire."""

from __future__ import annotations

from typing import Any

import numpy as np

from mammosim.phantom.lesion_kinds.balls import Ball
from mammosim.phantom.lesion_kinds.kind import PHYSICAL_OBJECT, LesionForm, LesionKind
from mammosim.phantom.lesion_kinds.site import Site, paint_ball

CLIP_RADIUS_MM = 0.25
"""Radius of the wire a biopsy clip is made of, mm."""


def paint_clip(site: Site, keys: Any, rng: np.random.Generator) -> float:
    """Label the voxels of a clip and return the volume of its wire, mm3."""
    ball = clip_ball(2.0 * site.radius_mm, rng)
    paint_ball(site, ball)
    return ball.volume_mm3


def clip_ball(length_mm: float, rng: np.random.Generator) -> Ball:
    """A clip: a rod of titanium wire in a random direction."""
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    radius = min(CLIP_RADIUS_MM, 0.5 * length_mm)
    return Ball(np.zeros(3), radius, 0.5 * length_mm - radius, direction)


# Clips are some millimetres long.
FORM = LesionForm(3.0, (("gland", "tdlu", "duct"),), paint_clip)

CLIP = LesionKind(
    title="Clip",
    tissue="clip",
    form=lambda keys: FORM,
    dicom_category=PHYSICAL_OBJECT,
    dicom_type=("77720000", "SCT", "Clip"),
    few_voxels=True,
)
