"""Calcifications: clusters by morphology, and the calcified wall of an artery."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy import ndimage

from mammosim.config import Settings
from mammosim.errors import InputError
from mammosim.phantom.lesion_kinds.clusters import cluster_balls
from mammosim.phantom.lesion_kinds.kind import ABNORMAL_STRUCTURE, LesionForm, LesionKind
from mammosim.phantom.lesion_kinds.site import Site, paint_ball
from mammosim.tissues import TISSUES

WALL_MM, WALL_SHARE, WALL_STRETCH_MM = 0.08, 0.4, 2.5
"""Thickness of an artery's calcified wall, the share of the wall that is calcified, and about how
long its stretches are, mm. Chosen by eye, so that parallel broken tracks are seen (ACR BI-RADS
Atlas, 5th edition, 2013, "Vascular")."""

VESSEL_ROOM_MM = 2.0
"""Room that a drawn place has around it for calcifications of a vessel, which stay in its wall."""


class CalcificationKeys(Settings):
    """Keys of calcifications."""

    morphology: Literal["punctate", "pleomorphic", "linear", "vascular"] = "pleomorphic"
    """Form of calcifications: round, irregular, in a row that branches along ducts, or in the wall
    of an artery, which the breast must have there."""

    count: int | None = Field(default=None, ge=1, le=200)
    """Number of calcifications in a cluster (not in an artery); default: drawn from 5 to 30."""

    calcification_mm: float | None = Field(default=None, ge=0.05, le=3.0)
    """Diameter of a sphere with each calcification's volume, mm, or thickness of calcified wall;
    default: drawn for each from 0.1 to 0.8, and 0.08 in a wall."""

    @model_validator(mode="after")
    def _an_artery_has_no_count(self) -> Self:
        if self.count is not None and self.morphology == "vascular":
            raise ValueError("count does not belong to morphology 'vascular'")
        return self


def paint_cluster(site: Site, keys: CalcificationKeys, rng: np.random.Generator) -> float:
    """Label the voxels of a cluster and return the volume of its members, mm3."""
    rng.standard_normal(3)  # not used; drawn so that a seed keeps the clusters that it had
    way = site.breast.nipple_mm - site.centre_mm
    towards = way / max(float(np.linalg.norm(way)), 1e-9)
    balls = cluster_balls(
        site.radius_mm, keys.count, keys.calcification_mm, rng, keys.morphology, towards
    )
    for ball in balls:
        paint_ball(site, ball)
    return sum(ball.volume_mm3 for ball in balls)


def paint_wall(site: Site, keys: CalcificationKeys, rng: np.random.Generator) -> float:
    """Label stretches of the wall of arteries within a ball; returns their volume, mm3.

    A voxel of the artery is of the wall if a neighbour by a face is not artery. Of the wall the
    share `WALL_SHARE` is taken where slow noise is highest.

    Raises
    ------
    InputError
        If there is no artery.
    """
    window, offsets = site.window(site.centre_mm, site.radius_mm)
    artery = window == TISSUES["artery"].label
    wall = artery & ~ndimage.binary_erosion(artery, border_value=1)
    wall &= (offsets**2).sum(axis=-1) <= site.radius_mm**2
    if not wall.any():
        raise InputError(
            f"lesion '{site.name}': no artery within {site.radius_mm:g} mm of "
            f"{np.round(site.centre_mm, 1).tolist()} mm, expected one for morphology 'vascular'; "
            "remove position_mm, or use a breast with labelled arteries"
        )
    waves, phases = rng.standard_normal((6, 3)) / WALL_STRETCH_MM, rng.uniform(0.0, 2 * np.pi, 6)
    noise = np.cos(offsets[wall] @ waves.T + phases).sum(axis=-1)
    chosen = np.zeros(wall.shape, bool)
    chosen[wall] = noise >= np.quantile(noise, 1.0 - WALL_SHARE)
    window[chosen] = site.label
    thickness = keys.calcification_mm or WALL_MM
    filled = min(1.0, thickness / float(site.breast.voxel_mm.mean()))
    return filled * np.count_nonzero(chosen) * float(np.prod(site.breast.voxel_mm))


# A cluster lies within 1 cm (ACR BI-RADS Atlas, 5th edition, 2013, "Grouped") and arises in the
# terminal units (Wellings, Jensen & Marcum 1975, J Natl Cancer Inst 55:231-273); the length along
# an artery is a choice.
CLUSTER = LesionForm(10.0, (("tdlu",), ("gland", "duct")), paint_cluster)
ARTERY = LesionForm(25.0, (("artery",),), paint_wall, room_mm=VESSEL_ROOM_MM)

CALCIFICATION = LesionKind(
    title="Calcifications",
    tissue="calcification",
    form=lambda keys: ARTERY if keys.morphology == "vascular" else CLUSTER,
    keys=CalcificationKeys,
    dicom_category=ABNORMAL_STRUCTURE,
    dicom_type=("129769006", "SCT", "Calcification Cluster"),
    victre_type=1,
    clustered=True,
    few_voxels=True,
)
