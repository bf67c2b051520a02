"""Mean glandular dose by the method of Dance: incident air kerma times g, c and s."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from scipy.interpolate import RegularGridInterpolator

UNKNOWN_SPECTRUM_S = 1.0
"""Dance's factor s of a beam that is not tabulated; the tabulated ones are 1 to 1.061."""

# Acceptable mean glandular dose, mGy, over the thickness of the equivalent breast, mm (European
# guidelines for quality assurance in breast cancer screening and diagnosis, 4th edition, 2006).
_LIMIT_THICKNESS_MM = (21.0, 32.0, 45.0, 53.0, 60.0, 75.0, 90.0)
_LIMIT_MGY = (1.0, 1.5, 2.0, 2.5, 3.0, 4.5, 6.5)


def dose_limit_mgy(thickness_mm: float) -> float:
    """Mean glandular dose that the European guidelines accept at a compressed thickness.

    Parameters
    ----------
    thickness_mm : float
        Compressed thickness of the breast, mm.

    Returns
    -------
    float
        Acceptable level, mGy; between the tabulated thicknesses by interpolation, outside 21 to 90
        mm that of the nearer end.

    Examples
    --------
    >>> dose_limit_mgy(53.0)
    2.5
    """
    return float(np.interp(thickness_mm, _LIMIT_THICKNESS_MM, _LIMIT_MGY))


@dataclass(frozen=True)
class DoseFactors:
    """Factors of one exposure.

    Parameters
    ----------
    g : float
        Mean glandular dose over incident air kerma for 50 per cent glandularity, mGy/mGy.
    c : float
        Correction for another glandularity.
    s : float
        Correction for another spectrum than Mo/Mo.
    notes : tuple of str
        What lay outside the tables, one sentence each.
    """

    g: float
    c: float
    s: float
    notes: tuple[str, ...] = ()

    @property
    def product(self) -> float:
        """Mean glandular dose over incident air kerma, mGy/mGy."""
        return self.g * self.c * self.s


def dose_factors(
    hvl_mm_al: float, thickness_mm: float, glandularity_percent: float, target: str, filter: str
) -> DoseFactors:
    """Conversion factors of a breast, interpolated linearly.

    Parameters
    ----------
    hvl_mm_al : float
        Half-value layer behind the paddle, mm Al; tables hold 0.30-0.60.
    thickness_mm : float
        Compressed thickness, mm; tables hold 20-110.
    glandularity_percent : float
        Gland's share of the breast inside skin and subcutaneous fat, by mass, per cent.
    target, filter : str

    Returns
    -------
    DoseFactors
        Values outside a table are those of its edge, and noted.

    Notes
    -----
    The factors hold for a semicircular breast of a homogeneous mixture inside 5 mm of fat. Real
    distributions of gland lower the dose by some 30 per cent (Dance & Sechopoulos 2016, Phys Med
    Biol 61:R271).

    Examples
    --------
    >>> dose_factors(0.35, 50.0, 50.0, "Mo", "Mo").product
    0.187
    """
    table = _interpolators()
    notes: list[str] = []
    thickness_cm = _clamped(thickness_mm, 20.0, 110.0, "thickness of {:.0f} mm", notes) / 10.0
    hvl = _clamped(hvl_mm_al, 0.30, 0.60, "half-value layer of {:.3f} mm Al", notes)
    glandularity = float(np.clip(glandularity_percent, 0.1, 100.0))
    pair = f"{target}/{filter}"
    if pair not in table["s"]:
        notes.append(f"no s factor is tabulated for {pair}: {UNKNOWN_SPECTRUM_S:g} is used")
    return DoseFactors(
        float(table["g"]((thickness_cm, hvl))),
        float(table["c"]((hvl, thickness_cm, glandularity))),
        float(table["s"].get(pair, UNKNOWN_SPECTRUM_S)),
        tuple(notes),
    )


def _clamped(value: float, low: float, high: float, what: str, notes: list[str]) -> float:
    if not low <= value <= high:
        described = what.format(value)
        notes.append(f"{described} is outside the dose tables ({low:g}-{high:g}): the edge is used")
    return float(np.clip(value, low, high))


@cache
def _interpolators() -> dict[str, Any]:
    text = files(__package__).joinpath("dose_tables.yaml").read_text(encoding="utf-8")
    table = YAML(typ="safe", pure=True).load(text)
    hvl = table["hvl_mm_al"]
    g = RegularGridInterpolator((list(table["g"]), hvl), np.array(list(table["g"].values())))
    axes = (hvl, table["c_thickness_cm"], table["glandularity_percent"])
    c = RegularGridInterpolator(axes, np.array([table["c"][value] for value in hvl]))
    return {"g": g, "c": c, "s": table["s"]}
