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
    """A breast of the built-in generator."""

    density: Literal["fatty", "scattered", "heterogeneous", "dense", "a", "b", "c", "d"] = (
        "scattered"
    )
    """Density class, by name or BI-RADS letter."""

    voxel_mm: float = Field(0.5, ge=0.1, le=4.0)
    """Voxel size, mm."""

    volume_ml: float | None = Field(None, ge=150.0, le=1800.0)
    """Volume of the breast without muscle, mL; left out, drawn by the seed from 350 to 900."""

    glandular_percent: float | None = Field(None, ge=2.0, le=55.0)
    """Fibroglandular share of the volume within the skin, %; left out, that of the class."""

    skin_mm: float = Field(1.45, ge=0.8, le=3.0)
    """Thickness of the skin, mm; mean of breast CT, Huang et al. 2008, Med Phys 35:1199-1206."""

    nipple_height_mm: float = Field(7.0, ge=2.0, le=12.0)
    """How far the nipple stands out of the areola, mm."""

    nipple_diameter_mm: float = Field(10.0, ge=6.0, le=16.0)
    """Diameter of the nipple, mm."""

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
