"""Settings of the section `acquisition`."""

from __future__ import annotations

from pydantic import Field

from mammosim.config import Settings


class AcquisitionSettings(Settings):
    """How the compressed breast is exposed and what the detector records."""

    target: str = "W"
    """Anode material: W, Mo or Rh; tungsten is that of most systems sold today."""

    filter: str = "Rh"
    """Filter material: Mo, Rh, Ag or Al."""

    filter_mm: float | None = Field(default=None, gt=0.0, le=5.0)
    """Filter thickness in mm; left out: Mo 0.030, Rh 0.025 (on tungsten 0.050), Ag 0.050,
    Al 0.700."""

    kvp: float | None = None
    """Tube voltage in kV, 20 to 40; left out: chosen by the compressed thickness."""

    mas: float | None = None
    """Tube load in mAs; left out: automatic exposure control."""

    spectrum_file: str | None = None
    """Path of a spectrum of two columns, keV and photons a bin per mm2 and mAs at 1 m behind the
    filter, used in place of the tube model."""

    paddle_mm: float = Field(default=3.0, ge=0.0, le=20.0)
    """Polycarbonate of the compression paddle in mm."""

    support_mm: float = Field(default=1.0, ge=0.0, le=10.0)
    """Carbon fibre of breast support and detector cover in mm."""

    composition: str = "hammerstein"
    """What tissues are made of: hammerstein, icru44, woodard, or the path of a YAML file."""

    calcification: str = "hydroxyapatite"
    """What calcifications are made of: hydroxyapatite, oxalate or carbonate."""

    scatter: bool = True
    """Whether scattered radiation is added."""

    grid: bool = True
    """Whether an anti-scatter grid is in front of the detector."""

    grid_primary_transmission: float = Field(default=0.75, gt=0.0, le=1.0)
    """Part of the primary that the grid lets through; 0.75 is usual for 5:1 at 31 lines per cm."""

    grid_scatter_transmission: float = Field(default=0.10, ge=0.0, le=1.0)
    """Part of the scatter that the grid lets through; published values are 0.07 to 0.14."""

    detector: str = "a-Se-70"
    """Detector: a-Se-70, a-Se-85 or CsI-100; any works with any pixel."""

    noise: bool = True
    """Whether quantum, electronic and fixed-pattern noise are added."""
