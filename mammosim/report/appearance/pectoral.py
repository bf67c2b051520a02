"""The pectoral muscle of an MLO image: the line of its edge, its grey and texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from mammosim.report.appearance.region import F64, Mask, Region, smooth

WIDTHS_MM = np.arange(12.0, 90.0, 2.0)
"""Widths at the upper edge of the image that are tried."""

LENGTHS_MM = np.arange(40.0, 200.0, 4.0)
"""Lengths along the chest wall that are tried."""

_SEARCH_MM = 0.5  # grid of the search
_ASIDE_MM = 2.5  # the step is taken between points this far to either side of the line
_SEARCHED = np.linspace(0.08, 0.80, 60)  # part of the line that is looked at
_MEASURED = np.linspace(0.1, 0.8, 80)
_ACROSS_MM = np.arange(-14.0, 14.0, 0.1)


@dataclass(frozen=True)
class MuscleLine:
    """Straight line of the muscle's edge.

    Parameters
    ----------
    width_mm : float
        From the chest wall at the upper edge of the breast.
    length_mm : float
        Along the chest wall.
    top_mm : float
        The breast's first row, mm from the image's.
    """

    width_mm: float
    length_mm: float
    top_mm: float

    def inside_mm(self, region: Region) -> F64:
        """Distance of each pixel from the line, mm; positive in the muscle."""
        rows, columns = np.ogrid[: region.grey.shape[0], : region.grey.shape[1]]
        y, x = rows * region.pixel_mm - self.top_mm, columns * region.pixel_mm
        distance: F64 = self.width_mm * (1.0 - y / self.length_mm) - x
        return distance * self.length_mm / np.hypot(self.width_mm, self.length_mm)


def find_muscle(region: Region) -> MuscleLine | None:
    """The line with the largest and most even step of grey across it; None without one."""
    step = max(1, round(_SEARCH_MM / region.pixel_mm))
    cell = step * region.pixel_mm
    blurred = smooth(region.grey, 1.0 / region.pixel_mm)[::step, ::step]
    top = int(np.flatnonzero(region.breast[::step, ::step].any(axis=1))[0])
    rows, columns = blurred.shape
    width, length = (a.ravel() for a in np.meshgrid(WIDTHS_MM, LENGTHS_MM, indexing="ij"))
    x = width[:, None] * (1.0 - _SEARCHED) / cell
    y = top + length[:, None] * _SEARCHED / cell
    fits = (y.max(axis=1) <= rows - 2) & (x.max(axis=1) + 2.0 * _ASIDE_MM / cell <= columns - 1)
    if not fits.any():
        return None
    width, length, x, y = width[fits], length[fits], x[fits], y[fits]
    norm = np.hypot(width, length)
    aside_x, aside_y = (_ASIDE_MM / cell * (side / norm)[:, None] for side in (length, width))
    inner, outer = (
        ndimage.map_coordinates(blurred, [y + s * aside_y, x + s * aside_x], order=1)
        for s in (-1.0, 1.0)
    )
    change = np.clip(inner - outer, -0.1, 0.25)
    score = (change.mean(axis=1) - 0.4 * change.std(axis=1)) * np.sqrt(norm)
    best = int(np.argmax(score))
    if score[best] <= 0.0:
        return None
    return MuscleLine(float(width[best]), float(length[best]), top * cell)


def muscle_measures(region: Region, inner: Mask, line: MuscleLine) -> dict[str, float]:
    """Grey, texture and edge of the muscle."""
    px = region.pixel_mm
    found = {"pect_top_mm": line.width_mm, "pect_down_mm": line.length_mm}
    distance = line.inside_mm(region)
    inside = (distance > 6.0) & region.breast & (region.depth_mm > 3.0)
    deep = inside & (distance > 8.0)
    if np.count_nonzero(inside) <= 500 or not deep.any():
        return found
    grey_range = float(np.subtract(*np.quantile(region.grey[inner], [0.99, 0.01])))
    band = smooth(region.grey, 0.3 / px) - smooth(region.grey, 3.0 / px)
    along, down = (
        ndimage.gaussian_filter(region.grey, 0.4 / px, order=order)[deep]
        for order in ((0, 1), (1, 0))
    )
    xx, yy, xy = (along**2).mean(), (down**2).mean(), (along * down).mean()
    found["muscle_grey"] = float(np.median(region.grey[inside]))
    found["muscle_texture"] = float(band[deep].std()) / grey_range
    found["muscle_anisotropy"] = float(np.hypot(xx - yy, 2.0 * xy) / (xx + yy))
    return found | _edge(region, line)


def _edge(region: Region, line: MuscleLine) -> dict[str, float]:
    """How far the edge wanders from its line, and over what distance it falls."""
    px = region.pixel_mm
    norm = np.hypot(line.width_mm, line.length_mm)
    to_x, to_y = line.length_mm / norm, line.width_mm / norm
    x = line.width_mm * (1.0 - _MEASURED)[:, None]
    y = line.top_mm + line.length_mm * _MEASURED[:, None]

    def across(image: F64, shift_mm: F64) -> F64:
        u = _ACROSS_MM + shift_mm[:, None]
        at = [(y + to_y * u) / px, (x + to_x * u) / px]
        values: F64 = ndimage.map_coordinates(image, at, order=1, mode="nearest")
        return values

    blurred = across(smooth(region.grey, 0.8 / px), np.zeros(_MEASURED.size))
    near = np.abs(_ACROSS_MM) < 7.0
    fall = -np.gradient(blurred, axis=1)[:, near]
    shift = _ACROSS_MM[near][np.argmax(fall, axis=1)]
    straight = np.polyval(np.polyfit(_MEASURED, shift, 1), _MEASURED)
    profile = np.median(across(region.grey, shift), axis=0)
    return {
        "pect_edge_wander_mm": float(np.std(shift - straight)),
        "pect_edge_15_85_mm": _fall_mm(profile),
    }


def _fall_mm(profile: F64) -> float:
    """From 85 to 15 % of the step, mm."""
    high, low = (
        float(np.median(profile[(u > 4.0) & (u < 7.0)])) for u in (-_ACROSS_MM, _ACROSS_MM)
    )
    part = ndimage.gaussian_filter1d((profile - low) / (high - low + 1e-9), 2.0)
    middle = int(np.argmin(np.abs(_ACROSS_MM)))
    before = np.flatnonzero(part[: middle + 1] >= 0.85)
    after = np.flatnonzero(part[middle:] <= 0.15)
    first = int(before[-1]) if before.size else 0
    last = middle + int(after[0]) if after.size else part.size - 1
    return (last - first) * 0.1
