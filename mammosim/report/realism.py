"""Numbers of a simulated mammogram beside what is published of real ones, with a verdict each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mammosim.acquisition import Mammogram, dose_limit_mgy
from mammosim.compression import CompressedBreast, breast_volume_ml, population_thickness_mm
from mammosim.report.appearance import SOURCE, appearance, measures_of
from mammosim.report.quantities import number
from mammosim.report.texture import power_law_exponent

Basis = Literal["published", "expected", "measured"]

# Below this the detector would get too little; assumed, from the least of clinical surveys.
_MIN_DOSE_MGY = 0.4

# Standard deviation of the thickness of breasts of one volume (M-PACT's fit, see compression).
_THICKNESS_SPREAD = 0.09

# Relative quantum noise of a 0.07 mm pixel: 1.7 % behind 5 cm with 20 % gland at 80 mAs of W/Rh
# (computed); half and twice of it are taken for what exposure controls leave. Assumed.
_NOISE_PERCENT, _NOISE_PIXEL_MM = (0.8, 3.4), 0.07


PUBLISHED = {
    "volumetric_density_percent": (
        0.0, 45.0,
        "Yaffe et al. 2009 (Med Phys 36:5437): 19 % on average, 95 % of women below 45 %",
    ),
    "force_n": (
        49.0, 186.0, "Sullivan et al. 1991 (Radiology 181:355): all of 560 women, median 122.5 N",
    ),
}  # fmt: skip
"""Lowest and highest value, and source, of quantities with one range for all breasts."""


@dataclass(frozen=True)
class Finding:
    """One number of one view beside its published range.

    Parameters
    ----------
    name, unit : str
    value : float
        NaN where it is not known.
    low, high : float
        Range that is published.
    source : str
        Where the range is from, and what it is of.
    decimals : int
        Decimals to print.
    basis : {"published", "expected", "measured"}
        Whether the range is published, measured on clinical images, or only to be expected.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float
    source: str
    decimals: int = 1
    basis: Basis = "published"

    @property
    def verdict(self) -> str:
        """Where the value lies against the range, in words; the ends belong to it."""
        if not math.isfinite(self.value):
            return "not measured"
        if self.value < self.low:
            return f"lower than {self.basis}"
        return f"higher than {self.basis}" if self.value > self.high else f"as {self.basis}"

    @property
    def value_text(self) -> str:
        """The value as printed."""
        return number(self.value, self.decimals)

    @property
    def range_text(self) -> str:
        """The range as printed; a range from zero is an upper bound."""
        low, high = number(self.low, self.decimals), number(self.high, self.decimals)
        return f"up to {high}" if self.low == 0.0 else f"{low} to {high}"


# g c s of Dance's tables from 80 mm, 0.30 mm Al, 100 % gland to 20 mm, 0.60 mm Al, 0.1 % gland.
_DOSE_PER_KERMA = (0.06, 0.75)
_SCATTER_RATIO = (0.24, 1.1)


def realism(compressed: CompressedBreast, mammogram: Mammogram) -> list[Finding]:
    """Numbers that tell whether a view could be a real one.

    Parameters
    ----------
    compressed : CompressedBreast
    mammogram : Mammogram
        Of the same view.

    Returns
    -------
    list of Finding
        Always the same quantities in the same order.
    """
    found: tuple[Callable[[CompressedBreast, Mammogram], Finding], ...] = (
        _texture, _density, _thickness, _force, _pressure, _dose, _dose_per_kerma, _scatter, _noise,
    )  # fmt: skip
    return [one(compressed, mammogram) for one in found]


def appearance_findings(view: str, mammogram: Mammogram) -> dict[str, Finding]:
    """How the For Presentation image looks, in numbers, beside those of clinical images.

    Parameters
    ----------
    view : str
        CC or MLO; nothing was measured of others.
    mammogram : Mammogram

    Returns
    -------
    dict of str to Finding
        By key, in the order of `MEASURES`.
    """
    if view not in SOURCE:
        return {}
    low = mammogram.window_center - 0.5 * mammogram.window_width
    grey = (mammogram.for_presentation - low) / mammogram.window_width
    values = appearance(np.clip(grey, 0.0, 1.0), mammogram.gantry.pixel_mm, view)
    return {
        key: Finding(
            measure.name, measure.unit, values.get(key, math.nan), first, last, SOURCE[view], 2,
            "measured",
        )
        for key, (measure, first, last) in measures_of(view).items()
    }  # fmt: skip


def _texture(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    return Finding(
        "Exponent of the texture's power spectrum", "", power_law_exponent(mammogram), 1.5, 3.5,
        "Burgess 2003 (Proc SPIE 5034): 1.5 to 3.5 over normal mammograms, 2.8 on average; "
        "25 mm squares, 0.15 to 0.7 per mm", 2,
    )  # fmt: skip


def _density(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    value = mammogram.measures.get("volumetric_density_percent", math.nan)
    return Finding(
        "Volumetric density, skin included", "%", value, *PUBLISHED["volumetric_density_percent"],
    )  # fmt: skip


def _thickness(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    volume = breast_volume_ml(compressed.phantom)
    usual = population_thickness_mm(compressed.view.name, volume)
    return Finding(
        "Compressed thickness", "mm", compressed.thickness_mm,
        usual * (1.0 - 2.0 * _THICKNESS_SPREAD), usual * (1.0 + 2.0 * _THICKNESS_SPREAD),
        f"population fit of M-PACT for this breast's {volume:.0f} mL, two standard deviations of "
        "9 % either way",
    )  # fmt: skip


def _force(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    return Finding(
        "Force on the paddle", "N", compressed.measures.get("force_n", math.nan),
        *PUBLISHED["force_n"], 0,
    )  # fmt: skip


def _pressure(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    high = 21.3 * 1.54 if compressed.view.name == "CC" else 14.2 * 1.32
    return Finding(
        "Mean pressure under the paddle", "kPa", compressed.measures.get("pressure_kpa", math.nan),
        7.0, high,
        "de Groot et al. 2013 (Med Phys 40:081901): CC 21.3 ± 11.5, MLO 14.2 ± 4.5 kPa under "
        "18 daN, to one standard deviation above; 7 to 15 kPa is what is aimed at",
    )  # fmt: skip


def _dose(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    limit = dose_limit_mgy(mammogram.thickness_mm)
    return Finding(
        "Mean glandular dose", "mGy", mammogram.dose_mgy, _MIN_DOSE_MGY, limit,
        "European guidelines, 4th edition: acceptable level at this thickness; the lower end is "
        "assumed", 2,
    )  # fmt: skip


def _dose_per_kerma(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    value = (
        mammogram.dose_mgy / mammogram.air_kerma_mgy if mammogram.air_kerma_mgy > 0.0 else math.nan
    )
    return Finding(
        "Glandular dose over incident air kerma", "mGy/mGy", value, *_DOSE_PER_KERMA,
        "Dance et al. 2000 (Phys Med Biol 45:3225): g c s for 20 to 80 mm and half-value layers of "
        "0.3 to 0.6 mm Al; a fifth less for real distributions of gland is assumed", 2,
    )  # fmt: skip


def _scatter(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    return Finding(
        "Scatter over primary without a grid", "",
        mammogram.measures.get("scatter_to_primary_ratio", math.nan), *_SCATTER_RATIO,
        "Boone et al. 2000 (Med Phys 27:2408): 0.24 to 0.89 for breasts of 2 to 8 cm; a quarter "
        "more for paddle and support is assumed", 2,
    )  # fmt: skip


def _noise(compressed: CompressedBreast, mammogram: Mammogram) -> Finding:
    # Relative quantum noise goes with one over the pixel's side.
    scale = _NOISE_PIXEL_MM / mammogram.gantry.pixel_mm
    value = 100.0 * mammogram.measures.get("relative_quantum_noise", math.nan)
    return Finding(
        "Quantum noise of a pixel behind the dense part", "%", value,
        _NOISE_PERCENT[0] * scale, _NOISE_PERCENT[1] * scale,
        "our own estimate, no published range: half to twice of what 80 mAs of W/Rh leave behind "
        "5 cm, at this pixel size", 2, "expected",
    )  # fmt: skip
