"""Grey levels and skin line of a mammogram."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.report.appearance.region import F64, Mask, Region, smooth

SKIN_STEP_MM = 0.05
"""Step of the profiles across the skin line."""

PROFILE_MM = (-3.0, 15.0)
"""They begin in air and end in the breast."""

BRIGHT_PART = 0.6
"""What is above this part of the range is bright."""

_MIN_PROFILES = 20
"""Fewer profiles give no measure. Assumed."""


def grey_levels(region: Region, inner: Mask) -> dict[str, float]:
    """Percentiles, skewness and bright share of the inner breast, and the nipple's grey.

    "Relative" grey runs from 0 at the 1st to 1 at the 99th percentile of the inner breast.
    """
    values = region.grey[inner]
    low, fifth, median, high = np.quantile(values, [0.01, 0.05, 0.5, 0.99])
    deviation = values - values.mean()
    blurred = smooth(region.grey, 0.5 / region.pixel_mm)[inner]
    found = {
        "grey_p5": float(fifth),
        "grey_p50": float(median),
        "skew": float((deviation**3).mean() / values.std() ** 3),
        "bright_share": float((blurred > low + BRIGHT_PART * (high - low)).mean()),
    }
    if np.count_nonzero(region.nipple) > 20:
        nipple = float(np.median(region.grey[region.nipple]))
        found["nipple_grey"] = (nipple - float(low)) / float(high - low)
    return found


def skin_line(region: Region, inner: Mask) -> dict[str, float]:
    """Rise and width of the skin line, and relative grey 5 and 10 mm under it."""
    profiles, places_mm = _profiles(region)
    if len(profiles) <= _MIN_PROFILES:
        return {}
    low, high = np.quantile(region.grey[inner], [0.01, 0.99])
    rise, width = zip(*(_rise_and_width(p, places_mm) for p in profiles), strict=True)

    def relative(depth_mm: float) -> float:
        at = int(np.argmin(np.abs(places_mm - depth_mm)))
        return float((np.median(profiles[:, at]) - low) / (high - low))

    return {
        "skin_rise_mm": float(np.median(rise)),
        "skin_width_mm": float(np.median(width)),
        "subcut_5mm": relative(5.0),
        "subcut_10mm": relative(10.0),
    }


def _profiles(region: Region) -> tuple[F64, F64]:
    """Grey across the skin line, [profile, place], and distances from the edge, mm."""
    px = region.pixel_mm
    places = np.arange(*PROFILE_MM, SKIN_STEP_MM)
    outside = ndimage.distance_transform_edt(~region.body) * px
    signed = np.where(region.body, region.depth_mm, -outside)
    down, along = np.gradient(ndimage.gaussian_filter(signed, 1.5 / px), px)
    points = np.argwhere(region.body & (region.depth_mm <= 1.01 * px))[:: max(1, round(1.0 / px))]
    nipple = _nipple_place(region)
    rows, columns = region.body.shape
    clear = (points[:, 1] * px >= 10.0) & (points[:, 0] * px >= 8.0)
    clear &= (rows - points[:, 0]) * px >= 8.0
    clear &= np.hypot(*(points - nipple).T) * px >= 15.0
    normal = np.stack([down[tuple(points.T)], along[tuple(points.T)]], axis=1)
    length = np.linalg.norm(normal, axis=1)
    clear &= length >= 0.3
    points, normal = points[clear], normal[clear] / length[clear, None]
    at = points[:, :, None] + normal[:, :, None] * places / px
    within = (at.min(axis=(1, 2)) >= 0.0) & (at[:, 0].max(axis=1) <= rows - 1)
    within &= at[:, 1].max(axis=1) <= columns - 1
    at = at[within]
    values = ndimage.map_coordinates(region.grey, at.transpose(1, 0, 2), order=1)
    return values, places


def _nipple_place(region: Region) -> NDArray[np.float64]:
    """Row and column of the nipple, or of the body's tip."""
    if region.nipple.any():
        return np.array(ndimage.center_of_mass(region.nipple))
    row = region.tip_row
    return np.array([row, np.count_nonzero(region.body[row])], dtype=np.float64)


def _rise_and_width(profile: F64, places_mm: F64) -> tuple[float, float]:
    """From 10 to 90 % of the skin line's height over air, and its width at half height, mm."""
    smooth = ndimage.gaussian_filter1d(profile, 2.0)
    near = np.flatnonzero((places_mm > -1.0) & (places_mm < 4.0))
    peak = int(near[0] + np.argmax(smooth[near]))
    valley = peak + int(np.argmin(smooth[peak : peak + round(6.0 / SKIN_STEP_MM)]))
    air = float(smooth[:20].mean())

    def last_below(level: float) -> int:
        below = np.flatnonzero(smooth[:peak] <= level)
        return int(below[-1]) if below.size else 0

    ninth, tenth = (last_below(air + part * (smooth[peak] - air)) for part in (0.9, 0.1))
    half = 0.5 * (smooth[peak] + smooth[valley])
    after = np.flatnonzero(smooth[peak : valley + 1] <= half)
    end = peak + int(after[0]) if after.size else valley
    return (ninth - tenth) * SKIN_STEP_MM, (end - last_below(half)) * SKIN_STEP_MM
