"""Names and numbers as the report prints them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

_UNITS = {
    "mm": "mm", "mm2": "cm²", "mm3": "mL", "ml": "mL", "n": "N", "kpa": "kPa", "mgy": "mGy",
    "kev": "keV", "mj": "mJ", "s": "s", "ms": "ms", "mb": "MB", "voxel": "voxels",
    "deg": "°", "percent": "%", "px": "px",
}  # fmt: skip

# Areas and volumes of a breast are read in cm² and mL.
_SCALE = {"mm2": 1e-2, "mm3": 1e-3}

_NAMES = {
    "kvp": "Tube voltage, kV",
    "mas": "Tube load, mAs",
    "density": "Density class",
    "laterality": "Side",
    "force_n": "Force on the paddle",
    "support_force_n": "Force on the support",
    "front_force_n": "Force on the paddle, > 20 mm from its edge",
    "pressure_kpa": "Mean pressure",
    "front_pressure_kpa": "Mean pressure, > 20 mm from its edge",
    "smallest_j": "Minimum volume ratio (J)",
    "out_of_balance": "Residual force, relative",
    "depth_mm": "Tissue inside the plates, RMS depth",
    "error_mm": "Estimated error, mean",
    "largest_error_mm": "Estimated error, largest",
    "height_error_mm": "Plates' distance from the height where both press equally, estimated",
    "energy_mj": "Elastic energy",
    "skin_mm": "Skin thickness",
    "scatter_noise_percent": "Statistical error of scatter",
    "scatter_photons": "Photons followed",
    "dose_by_monte_carlo_mgy": "Mean glandular dose by Monte Carlo",
    "dose_by_dance_mgy": "Mean glandular dose by Dance's factors",
    "dose_error_percent": "Statistical error of dose",
}

# Keys whose ending is no unit.
_WHOLE = {
    "dose_factor_g": "Dose factor g",
    "dose_factor_c": "Dose factor c",
    "dose_factor_s": "Dose factor s",
    "counts_per_kev": "Counts per keV/mm²",
}

NOT_KNOWN = "–"
"""Printed where a value is missing."""


def key_in_words(path: str) -> str:
    """A configuration's key, such as `phantom.lesions.0.diameter_mm`, in words with its unit.

    Examples
    --------
    >>> key_in_words("phantom.lesions.0.diameter_mm"), key_in_words("phantom.generate.volume_ml")
    ('Lesion 1: diameter, mm', 'Volume, mL')
    >>> key_in_words("acquisition.kvp")
    'Tube voltage, kV'
    """
    *above, key = path.split(".")
    stem, _, ending = key.rpartition("_")
    unit = _UNITS[ending] if stem and ending in _UNITS and ending not in _SCALE else ""
    words = _NAMES.get(key) or _capital((stem if unit else key).replace("_", " "))
    if above and above[-1].isdigit():
        thing = above[-2].removesuffix("s") if len(above) > 1 else ""
        words = f"{_capital(thing)} {int(above[-1]) + 1}: {words[:1].lower()}{words[1:]}"
    return f"{words}, {unit}" if unit else words


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def quantity(key: str, values: Iterable[float | None]) -> tuple[str, str, list[str]]:
    """One row of a table: a record's key in words, its unit, and its values as text.

    Parameters
    ----------
    key : str
        Name whose ending is its unit.
    values : iterable of float or None

    Examples
    --------
    >>> quantity("contact_area_mm2", [8123.4, None])
    ('Contact area', 'cm²', ['81.23', '–'])
    >>> quantity("inverted_cells", [3.0])
    ('Inverted cells', '', ['3'])
    >>> quantity("dose_factor_s", [1.042])
    ('Dose factor s', '', ['1.042'])
    """
    if key in _WHOLE:
        return _WHOLE[key], "", [number(value) for value in values]
    stem, _, ending = key.rpartition("_")
    unit = _UNITS.get(ending, "") if stem else ""
    label = _NAMES.get(key) or _capital((stem if unit else key).replace("_", " "))
    scale = _SCALE.get(ending, 1.0)
    return label, unit, [number(None if value is None else value * scale) for value in values]


def number(value: Any, decimals: int | None = None) -> str:
    """A value for a table cell.

    Parameters
    ----------
    value : object
        A number, a bool, a text, or None.
    decimals : int, optional
        Fixed decimals; without it four significant digits, whole numbers in full.

    Examples
    --------
    >>> number(134041.3), number(0.000012345), number(float("nan")), number(3.0), number(5.099, 1)
    ('134041', '1.234e-05', '–', '3', '5.1')
    """
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return NOT_KNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, (int, float)):
        return str(value)
    if decimals is not None:
        text = f"{value:.{decimals}f}"
        return text.removeprefix("-") if float(text) == 0.0 else text
    if value == round(value) or abs(value) >= 1000.0:
        return f"{value:.0f}"
    return f"{value:.4g}"
