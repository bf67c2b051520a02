"""Settings of the generator."""

from __future__ import annotations

from types import MappingProxyType
from typing import Literal

from pydantic import Field

from mammosim.config import Settings

DENSITY_PERCENT: MappingProxyType[str, float] = MappingProxyType(
    {"fatty": 6.0, "scattered": 13.0, "heterogeneous": 24.0, "dense": 40.0}
)
"""Fibroglandular share of the breast's volume for each class, %. The log-normal law through the
percentiles of Yaffe et al. 2009, Med Phys 36:5437-5443 (80 % of women below 27 %, 95 % below
45 %) has its medians over the lowest 10 %, next 40 %, next 40 % and highest 10 % of women (the
usual shares of BI-RADS a to d) at 5.6, 11, 22 and 45 %; these are close to them, with somewhat
less spread because skin is not counted here."""

DENSITY_ALIASES: MappingProxyType[str, str] = MappingProxyType(
    {"a": "fatty", "b": "scattered", "c": "heterogeneous", "d": "dense"}
)
"""BI-RADS letters."""


class GenerateSettings(Settings):
    """A breast from the built-in generator."""

    density: Literal["fatty", "scattered", "heterogeneous", "dense", "a", "b", "c", "d"] = (
        "scattered"
    )
    """Density class, by name or BI-RADS letter."""

    voxel_mm: float = Field(default=0.2, ge=0.1, le=4.0)
    """Voxel size, mm; at 0.2 mm, septa and margins look as they do with finer voxels."""

    volume_ml: float | None = Field(default=None, ge=100.0, le=1900.0)
    """Volume of the breast without muscle, mL, with the way to the axilla that oblique views
    show, but without the abdominal wall below the fold; default: drawn by the seed, with median 620
    and two thirds of breasts from 380 to 1000."""

    glandular_percent: float | None = Field(default=None, ge=2.0, le=55.0)
    """Fibroglandular fraction of the volume within the skin, %; default: that of the class."""

    skin_mm: float | None = Field(default=None, ge=0.8, le=3.0)
    """Thickness of the skin, mm; default: drawn by the seed as in breast CT, 1.44 with a standard
    deviation of 0.25 (Shi et al. 2013, Med Phys 40(3))."""

    nipple_height_mm: float | None = Field(default=None, ge=2.0, le=12.0)
    """Height of the nipple above the areola, mm; default: drawn by the seed, 5.3 on average, from
    4 to 8, and up to 2 in one breast of twelve."""

    nipple_diameter_mm: float | None = Field(default=None, ge=6.0, le=16.0)
    """Diameter of the nipple, mm; default: drawn by the seed, 9 on average, from
    6 to 13."""

    lymph_nodes: int | None = Field(default=None, ge=0, le=8)
    """Number of lymph nodes towards the axilla; default: drawn by the seed, most often none or one,
    rarely one within the breast."""

    benign_calcifications: Literal[
        "chance", "none", "vascular", "round", "popcorn", "rods", "skin"
    ] = "chance"
    """Benign calcifications of one kind, none, or by chance: in the arteries of one breast in
    thirteen, others in one in seven. They have their own label and are not listed as lesions."""

    moles: int = Field(default=0, ge=0, le=20)
    """Number of raised moles on the skin."""

    skin_folds: int = Field(default=0, ge=0, le=5)
    """Number of skin folds between breast and axilla."""

    @property
    def density_class(self) -> str:
        """Density class by name."""
        return DENSITY_ALIASES.get(self.density, self.density)

    @property
    def target_percent(self) -> float:
        """Fibroglandular share to reach, %."""
        if self.glandular_percent is not None:
            return self.glandular_percent
        return DENSITY_PERCENT[self.density_class]
