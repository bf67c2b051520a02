"""Masses: a body with a smooth, lobulated or spiculated margin, or a distortion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mammosim.config import Settings
from mammosim.phantom.lesion_kinds.kind import ABNORMAL_STRUCTURE, LesionForm, LesionKind
from mammosim.phantom.lesion_kinds.site import Site, nearest_voxel

THINNEST_PART = 0.6
"""Least half width of a spicule, of a voxel: half a voxel's diagonal in a face and a little more
keeps a straight line of voxels together."""


@dataclass(frozen=True)
class Margin:
    """How a mass is bounded.

    Parameters
    ----------
    body : float
        Radius of its body, of the mass's.
    lobes : float
        Unevenness of that radius, as a fraction of it.
    spicules : (int, int)
        Fewest and most spicules.
    base, tip : float
        Half the width of a spicule at the centre and at its end, of its length.
    """

    body: float
    lobes: float
    spicules: tuple[int, int] = (0, 0)
    base: float = 0.0
    tip: float = 0.0


MARGINS = {
    "smooth": Margin(0.94, 0.04),
    "lobulated": Margin(0.83, 0.14),
    "spiculated": Margin(0.55, 0.16, (14, 24), 0.17, 0.03),
    "distortion": Margin(0.12, 0.16, (18, 32), 0.05, 0.02),
}
"""By the names of BI-RADS as far as it has them: an architectural distortion has thin straight
lines or spicules that radiate from a point and no definite mass (ACR BI-RADS Atlas, 5th edition,
2013). The numbers are choices by eye; bodies that are uneven stay within the radius."""


class MassKeys(Settings):
    """Keys of a mass."""

    margin: Literal["smooth", "lobulated", "spiculated", "distortion"] = "lobulated"
    """Outline of a mass; `distortion` is architectural distortion, spicules without a mass."""


def paint_mass(site: Site, keys: MassKeys, rng: np.random.Generator) -> None:
    """Label the voxels of a mass, at least the one that holds its centre."""
    window, offsets = site.window(site.centre_mm, site.radius_mm)
    thinnest = THINNEST_PART * float(site.breast.voxel_mm.max())
    mask = inside_mass(offsets, site.radius_mm, keys.margin, rng, thinnest)
    window[mask if mask.any() else nearest_voxel(offsets)] = site.label


def inside_mass(
    offsets_mm: NDArray[np.float64],
    radius_mm: float,
    margin: str,
    rng: np.random.Generator,
    thinnest_mm: float = 0.0,
) -> NDArray[np.bool_]:
    """Which points belong to a mass, a ball made uneven that stays within its radius.

    Parameters
    ----------
    offsets_mm : ndarray, (..., 3)
        Points from the mass's centre, mm.
    radius_mm : float
        Greatest radius, mm.
    margin : {"smooth", "lobulated", "spiculated", "distortion"}
    rng : Generator
    thinnest_mm : float
        Least half width of a spicule, mm: thinner than a voxel it would break up.

    Notes
    -----
    The radius in a direction n is 1 + a sum of cosines of n.k with random wave vectors k, scaled
    to at most `radius_mm`. Spicules are cones from the centre through the body.
    """
    kind = MARGINS[margin]
    distance = np.linalg.norm(offsets_mm, axis=-1)
    direction = offsets_mm / np.maximum(distance, 1e-9)[..., None]
    waves = rng.standard_normal((8, 3)) * 2.6
    phases = rng.uniform(0.0, 2.0 * np.pi, 8)
    uneven = np.cos(direction @ waves.T + phases).sum(axis=-1) / 2.0
    body = kind.body * radius_mm * (1.0 + kind.lobes * uneven)
    inside: NDArray[np.bool_] = distance <= np.minimum(body, radius_mm)
    number = int(rng.integers(kind.spicules[0], kind.spicules[1] + 1))
    axes = rng.standard_normal((number, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for axis in axes:
        reach = radius_mm * rng.uniform(0.75, 1.0)
        along = offsets_mm @ axis
        across = np.sqrt(np.maximum(distance**2 - along**2, 0.0))
        width = kind.tip * reach + (kind.base - kind.tip) * (reach - along)
        inside |= (along > 0) & (along < reach) & (across < np.maximum(width, thinnest_mm))
    inside &= distance <= radius_mm
    return inside


# 10 mm is a choice, the upper end of stage T1b. Masses arise in the epithelium of the terminal
# units (Wellings, Jensen & Marcum 1975, J Natl Cancer Inst 55:231-273).
FORM = LesionForm(10.0, (("tdlu", "gland", "duct"),), paint_mass)

MASS = LesionKind(
    title="Mass",
    tissue="mass",
    form=lambda keys: FORM,
    keys=MassKeys,
    dicom_category=ABNORMAL_STRUCTURE,
    dicom_type=("4147007", "SCT", "Mass"),
    victre_type=2,
    crumbles=True,
)
