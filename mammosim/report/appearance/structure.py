"""Texture of the inner breast: spectrum, bands, ridges, and regular patterns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.report.appearance.region import F64, Mask, Region, block_mean_of, smooth

SPECTRUM_MM = 19.2
"""Side of the squares of the power spectrum."""

PATTERN_MM = (12.8, 6.4)
"""Side of the squares in which a regular pattern is looked for, and of their parts."""

PATTERN_PER_MM = (1.2, 3.2)
"""Frequencies of a pattern of voxels."""

PATTERN_RATIO = 5.0
"""A peak this much above the spectrum around it is a pattern; noise reaches about 2."""


def spectrum_exponents(region: Region, inner: Mask) -> dict[str, float]:
    """Exponents of the power spectrum from 0.15 to 0.7 and from 0.7 to 2 per mm."""
    side = round(SPECTRUM_MM / region.pixel_mm)
    window = np.outer(np.hanning(side), np.hanning(side))
    logs = []
    for row in range(0, inner.shape[0] - side, side // 2):
        for column in range(0, inner.shape[1] - side, side // 2):
            square = np.s_[row : row + side, column : column + side]
            if inner[square].mean() > 0.97:
                flat = _without_plane(region.grey[square])
                power = np.abs(np.fft.fft2(flat * window)) ** 2 / (flat.var() + 1e-12)
                logs.append(np.log(power + 1e-12))
    if not logs:
        return {}
    power = np.exp(np.mean(logs, axis=0))
    step = side * region.pixel_mm
    frequency = np.fft.fftfreq(side, region.pixel_mm)
    ring = np.round(np.hypot(frequency[:, None], frequency) * step).astype(int)
    radial = np.bincount(ring.ravel(), power.ravel()) / np.bincount(ring.ravel())
    at = np.arange(radial.size) / step
    return {
        name: _falling_slope(at, radial, low, high)
        for name, low, high in (("beta_015_07", 0.15, 0.7), ("beta_07_2", 0.7, 2.0))
    }


def bands_and_ridges(region: Region, inner: Mask) -> dict[str, float]:
    """Skewness of bands, spread of local contrast, strength and direction of ridges."""
    px, values = region.pixel_mm, region.grey[inner]
    grey_range = float(np.subtract(*np.quantile(values, [0.99, 0.01])))
    found = {}
    for sigma in (0.3, 0.6):
        band = _band(region.grey, sigma / px, 2.0 * sigma / px)[inner]
        found[f"band{sigma}_skew"] = float(((band - band.mean()) ** 3).mean() / band.std() ** 3)
    band = _band(region.grey, 0.3 / px, 2.0 / px)
    local = np.sqrt(np.maximum(smooth(band * band, 1.5 / px)[inner], 0.0))
    low, high = np.quantile(local, [0.1, 0.9])
    found["loc_p90_over_p10"] = float(high / low)
    fine, _, _ = _ridges(region.grey, 0.4 / px)
    found["ridge0.4_p99"] = float(np.quantile(fine[inner], 0.99)) / grey_range
    step = 2 if px < 0.15 else 1  # 0.8 mm is wide enough for pixels of 0.2 mm
    inner = inner[::step, ::step][: region.grey.shape[0] // step, : region.grey.shape[1] // step]
    bright, dark, angle = _ridges(block_mean_of(region.grey, step), 0.8 / (px * step))
    strongest = float(np.quantile(bright[inner], 0.99))
    found["ridge0.8_p99"] = strongest / grey_range
    found["ridge0.8_bright_dark"] = strongest / float(np.quantile(dark[inner], 0.99))
    weight, turned = bright[inner], 2.0 * (angle - _to_nipple(region, step))[inner]
    found["ridge0.8_to_nipple"] = float((weight * np.cos(turned)).sum() / weight.sum())
    found["ridge0.8_length_mm"] = _ridge_length_mm(bright, inner, px * step)
    return found


def pattern_share(region: Region, muscle: Mask) -> float:
    """Share of the margin's squares with a regular pattern; NaN without a square."""
    px = region.pixel_mm
    margin = (region.depth_mm > 3.0) & (region.depth_mm < 22.0)
    if muscle.any():
        margin &= ndimage.distance_transform_edt(~muscle) * px > 3.0
    side, part = (round(mm / px) for mm in PATTERN_MM)
    found = [
        _peak_ratio(region.grey[row : row + side, column : column + side], part, px)
        for row in range(0, margin.shape[0] - side, side // 2)
        for column in range(0, margin.shape[1] - side, side // 2)
        if margin[row : row + side, column : column + side].mean() >= 0.95
    ]
    return float(np.mean(np.array(found) > PATTERN_RATIO)) if found else float("nan")


def _peak_ratio(square: F64, part: int, px: float) -> float:
    """Highest peak of the mean spectrum of overlapping parts over the median around it."""
    frequency = np.fft.fftfreq(part, px)
    radius = np.hypot(frequency[:, None], frequency)
    band = (radius >= PATTERN_PER_MM[0]) & (radius <= PATTERN_PER_MM[1])
    band &= frequency[:, None] >= 0.0
    window = np.outer(np.hanning(part), np.hanning(part))
    starts = np.linspace(0, len(square) - part, 5).astype(int)
    pieces = np.stack([
        square[row : row + part, column : column + part] for row in starts for column in starts
    ])  # fmt: skip
    pieces = pieces - ndimage.gaussian_filter(pieces, 0.8 / px, axes=(1, 2))
    pieces -= pieces.mean(axis=(1, 2), keepdims=True)
    power = (np.abs(np.fft.fft2(pieces * window)) ** 2).sum(axis=0)
    around = ndimage.median_filter(power, size=9, mode="wrap")
    return float((power[band] / around[band]).max())


def _without_plane(values: F64) -> F64:
    side = len(values)
    ramp = np.arange(side) - 0.5 * (side - 1)
    scale = (ramp**2).sum() * side
    down, along = (values * ramp[:, None]).sum() / scale, (values * ramp).sum() / scale
    flat: F64 = values - values.mean() - down * ramp[:, None] - along * ramp
    return flat


def _falling_slope(frequency: F64, power: F64, low: float, high: float) -> float:
    used = (frequency >= low) & (frequency <= high) & (power > 0.0)
    slope, _ = np.polyfit(np.log(frequency[used]), np.log(power[used]), 1)
    return -float(slope)


def _band(grey: F64, narrow: float, wide: float) -> F64:
    band: F64 = smooth(grey, narrow) - smooth(grey, wide)
    return band


def _ridges(grey: F64, sigma: float) -> tuple[F64, F64, F64]:
    """Strength of bright and of dark ridges and the direction along a bright one.

    From the eigenvalues of the second derivatives (in units of `sigma`): the one across the ridge
    less the magnitude of the one along it, so that spots do not count. The derivatives' kernels end
    at four deviations, which leaves a trace of the mean grey in them, as in the clinical ranges.
    """
    xx, yy, xy = (
        ndimage.gaussian_filter(grey, sigma, order=order) for order in ((0, 2), (2, 0), (1, 1))
    )
    mean, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    lower, upper = mean - half, mean + half
    bright = np.where(lower < 0.0, np.maximum(-lower - np.abs(upper), 0.0), 0.0)
    dark = np.where(upper > 0.0, np.maximum(upper - np.abs(lower), 0.0), 0.0)
    return bright * sigma**2, dark * sigma**2, 0.5 * np.arctan2(2.0 * xy, xx - yy)


def _to_nipple(region: Region, step: int) -> F64:
    """Direction from each pixel of a grid `step` times as coarse to the tip, radians."""
    row = region.tip_row
    tip = np.count_nonzero(region.body[row])
    rows, columns = np.ogrid[: region.grey.shape[0] // step, : region.grey.shape[1] // step]
    direction: F64 = np.arctan2(row - step * rows, tip - step * columns)
    return direction


def _ridge_length_mm(bright: F64, inner: Mask, px: float) -> float:
    """Diagonal of the boxes of connected strong ridges (upper 5 %), mean over their pixels."""
    strong = inner & (bright > np.quantile(bright[inner], 0.95))
    labels, _ = ndimage.label(strong, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())[1:]
    diagonal: NDArray[np.float64] = np.array(
        [
            np.hypot(*(part.stop - part.start for part in box))
            for box in ndimage.find_objects(labels)
        ]
    )
    return float((diagonal * sizes).sum() / sizes.sum() * px) if sizes.size else float("nan")
