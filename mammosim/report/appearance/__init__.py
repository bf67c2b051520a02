"""How a mammogram looks, in numbers, beside the same numbers of clinical images."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.report.appearance.grey import grey_levels, skin_line
from mammosim.report.appearance.pectoral import find_muscle, muscle_measures
from mammosim.report.appearance.ranges import MEASURES, SOURCE, WIDENED, Measure
from mammosim.report.appearance.region import Region, find_region, inner_breast
from mammosim.report.appearance.structure import (
    bands_and_ridges,
    pattern_share,
    spectrum_exponents,
)

__all__ = ["MEASURES", "SOURCE", "WIDENED", "Measure", "appearance", "measures_of"]

_MAX_PIXEL_MM = 0.25  # the finest spectrum reaches to 2 per mm
_MIN_INNER_MM2 = 400.0  # below, there is no texture to speak of


def appearance(grey: NDArray[np.floating], pixel_mm: float, view: str) -> dict[str, float]:
    """Measure how a mammogram looks.

    Parameters
    ----------
    grey : ndarray, [row, column]
        As displayed: 0 (black) to 1 (white), bright is dense.
    pixel_mm : float
        Pixel pitch, mm.
    view : str
        In MLO the pectoral muscle is looked for.

    Returns
    -------
    dict of str to float
        Keys of `MEASURES`; what was not found is not there, nor anything of pixels too large to
        show fine structure.

    Notes
    -----
    Texture is measured deeper than 8 mm under the skin, away from chest wall and muscle, relative
    to the range from the 1st to the 99th percentile of grey there, since scanners' grey scales
    differ. A number within the range of real images is no proof of realism.
    """
    if pixel_mm > _MAX_PIXEL_MM:
        return {}
    region = find_region(np.asarray(grey, dtype=np.float64), pixel_mm)
    if region is None:
        return {}
    line = find_muscle(region) if view == "MLO" else None
    muscle = np.zeros(region.breast.shape, bool)
    if line is not None:
        muscle = (line.inside_mm(region) > 0.0) & region.breast
    inner = inner_breast(region, muscle)
    found = _shape(region)
    if np.count_nonzero(inner) * region.pixel_mm**2 < _MIN_INNER_MM2:
        return found
    found |= grey_levels(region, inner) | skin_line(region, inner)
    found |= spectrum_exponents(region, inner) | bands_and_ridges(region, inner)
    found["margin_lattice_share_over_5"] = pattern_share(region, muscle)
    if line is not None:
        found |= muscle_measures(region, inner, line)
    return found


def measures_of(view: str) -> dict[str, tuple[Measure, float, float]]:
    """Measures that have a range in a view, with its widened ends."""
    chosen = {}
    for key, measure in MEASURES.items():
        ends = measure.mlo if view == "MLO" else measure.cc
        if ends is not None:
            more = WIDENED * (ends[1] - ends[0])
            chosen[key] = (measure, ends[0] - more, ends[1] + more)
    return chosen


def _shape(region: Region) -> dict[str, float]:
    """Depth over length, and width at the upper edge over the greatest."""
    px = region.pixel_mm
    rows = np.flatnonzero(region.breast[:, : max(2, int(4.0 / px))].any(axis=1))
    extent = region.extent_mm
    deepest = float(extent.max())
    top = extent[rows[0] : rows[0] + max(2, int(3.0 / px))]
    return {
        "depth_over_length": deepest / ((rows[-1] - rows[0] + 1) * px),
        "top_over_greatest": float(np.median(top)) / deepest,
    }
