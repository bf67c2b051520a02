"""The For Presentation image: peripheral equalization, local contrast and a tone curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition._kernels import ToneCurve, present_kernel
from mammosim.acquisition.blocks import block_mean, cell_pixels
from mammosim.acquisition.breast_outline import Margin, find_margin, wall_is_left
from mammosim.acquisition.looks import SHARP_LIMIT, SHARP_MM, Look, look_of
from mammosim.acquisition.margin import (
    EDGE_REACH,
    NIPPLE_LEVEL,
    evened_nipple,
    missing_attenuation,
    raised_edge,
    smooth_step,
)
from mammosim.acquisition.muscle import muscle_of

CELL_MM = 0.5
"""Grid of mask, depth and base."""

LEVELS_DEPTH_MM = 8.0
"""The levels of fat and gland are taken deeper than this."""

LEVELS_WALL_MM = 10.0
"""Nor are they taken within this distance of the chest wall, where a strip of muscle may show
(assumed)."""

FAT_QUANTILE, GLAND_QUANTILE = 0.05, 0.99
"""Quantiles of the inner breast at which fat and gland are taken: not the extremes, which noise and
calcifications set. Assumed."""

DARK_SHARE, MAX_DARK = 0.85, 0.45
"""Where the darkest part of a dense breast still holds gland, its level lies this share of the way
from fat to that part, at most `MAX_DARK` (ln) above fat: a dense breast is not shown all white, nor
its subcutaneous fat black. On clinical MLO images the 5th percentile of grey is no higher than 0.12
in dense breasts too. Chosen."""

MIN_CONTRAST, MAX_CONTRAST = 0.45, 1.0
"""Attenuation (ln) of gland above fat is taken within these: a fatty breast is not stretched beyond
the first; what an all-dense breast (about 40 mm of gland) has beyond the second goes into the
shoulder of the curve."""

TOE, SHOULDER = 0.55, 0.58
"""Grey below and above which the base bends; the shoulder nears the look's white. The toe reaches
nearly up to gland, so that bright lines stand out more than dark ones within gland too, and shows
half of gland's attenuation at a quarter of the range, for clinical medians are 0.20 to 0.36.
Muscle, with two to four times the contrast of gland, lies on the shoulder; on clinical MLO images
it is at 0.34 to 0.81."""

DETAIL_CONTRAST = 0.45
"""Weak details are shown as if the contrast (ln) of gland above fat were no larger: those of dense
breasts do not fade as the scale of the base widens."""

GRAIN = 0.004
"""Fine details (ln) well below this are taken for grain, which is about a hundredth in fat; the
limit grows with sharpness, as grain does. Bright and dark grain are shown alike; with a higher
limit, so would be the fine lines of dense gland, which are as faint. Chosen by eye."""

FLOOR_CONTRAST = 0.3
"""The base goes no further below fat than this part of the contrast: it takes no part in air."""

BASE_RADIUS_MM, MIDDLE_RADIUS_MM = 2.5, 0.5
"""Half the sides of the windows, without the cell in the middle, that separate detail from base,
and fine detail from wide."""

BASE_EDGE = 0.10
"""Steps (ln) well above this, as the muscle's edge, belong to the base and get no halo."""

MAXIMUM = 4095  # 12 bits


@dataclass(frozen=True, eq=False)
class Presentation:
    """A For Presentation image with its window.

    Parameters
    ----------
    pixels : ndarray of uint16, [row, column]
        0 is air, bright is dense.
    window_center, window_width : float
    """

    pixels: NDArray[np.uint16]
    window_center: float
    window_width: float


def present(
    attenuation: NDArray[np.float32],
    pixel_mm: float,
    fat: float | None = None,
    look: str | Look = "crisp",
    region: NDArray[np.bool_] | None = None,
) -> Presentation:
    """Make the For Presentation image from a flat-fielded logarithmic image.

    Parameters
    ----------
    attenuation : ndarray of float32, [row, column]
        ln(signal of air / signal), about 0 in air.
    pixel_mm : float
        Pixel pitch, mm.
    fat : float, optional
        Attenuation of fat that fills the gap between the plates, which a scanner knows from
        thickness and beam; default: estimated from the image.
    look : {"crisp", "soft"} or Look
        See `looks`.
    region : ndarray of bool, [row, column], optional
        Part of the breast that the image is made for, on any coarser grid over the same field: the
        levels are taken there. Default: all of it.

    Returns
    -------
    Presentation

    Notes
    -----
    1. Peripheral equalization (`missing_attenuation`): what margin, nipple and thin places lack
       against fat at full thickness is added. It is smooth, so details keep their contrast.
       Margin and skin are raised towards the level of gland (`raised_edge`), a nipple in profile is
       evened out about it (`evened_nipple`).
    2. The sum is split into a base, smoothed over a window of 5 mm by the guided filter of He et
       al. (2013, IEEE Trans Pattern Anal Mach Intell 35:1397), which keeps strong edges, and
       detail, of which the same filter of 1.5 mm leaves the wide part.
    3. The base is shown on a curve with a long toe and a shoulder by the levels of fat and gland;
       muscle that fills a corner of the image is left out of the levels and lies on the shoulder.
       Detail is added with the slope of the straight part times the look's gains: fine detail is
       enhanced more than wide. This is the multiscale enhancement of scanners (as in Vuylsteke
       and Schoeters 1994, Proc SPIE 2167:551) in its simplest form.
    4. Before all this the finest noise is smoothed and fine detail raised, as scanners do.

    At any one place more attenuation is always brighter (except for the overshoot of the raised
    detail); nothing is clipped.
    """
    unit = look_of(look) if isinstance(look, str) else look
    cell = cell_pixels(CELL_MM, pixel_mm)
    coarse = block_mean(attenuation, cell)
    margin = find_margin(coarse, cell * pixel_mm)
    pixels = np.zeros(attenuation.shape, np.uint16)
    if margin is not None:
        missing, rise, plateau = missing_attenuation(coarse, margin, fat, unit.skin_rise)
        equalized = coarse + missing
        low, contrast = _levels(equalized, margin, plateau, _resampled(region, coarse.shape))
        near, far = EDGE_REACH
        evened, nipple = evened_nipple(margin), low + NIPPLE_LEVEL * contrast
        lifted, raised = raised_edge(equalized, margin, plateau, low, contrast, unit.lift)
        raised *= 1.0 - evened
        missing, equalized = missing + lifted, equalized + lifted
        equalized += smooth_step((far - rise) / (far - near)) * raised
        equalized += evened * (nipple - equalized)
        level = np.maximum(equalized, low - FLOOR_CONTRAST * contrast)
        base, even = _base(level, BASE_RADIUS_MM / margin.cell_mm)
        middle, _ = _base(level, MIDDLE_RADIUS_MM / margin.cell_mm)
        # what the toe shows as fat's grey
        fat_place = TOE * (1.0 + np.log(unit.fat_grey / TOE))
        wide_gain, fine_gain = np.array(unit.gains) * max(contrast / DETAIL_CONTRAST, 1.0)
        curve = ToneCurve(
            low, contrast, fat_place, unit.gland_grey, TOE, SHOULDER, unit.white,
            wide_gain, fine_gain, GRAIN * (1.0 + unit.sharpness),
        )  # fmt: skip
        smooth = _restored(attenuation, unit, pixel_mm)
        present_kernel(
            smooth, missing, raised, rise, evened, base, middle, even, float(cell),
            EDGE_REACH, nipple, curve, float(MAXIMUM), pixels,
        )  # fmt: skip
    return Presentation(pixels, (MAXIMUM + 1) / 2, float(MAXIMUM + 1))


def _resampled(mask: NDArray[np.bool_] | None, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """A mask on the nearest cells of another grid over the same field."""
    if mask is None:
        return None
    sizes = zip(shape, mask.shape, strict=True)
    rows, columns = ((np.arange(size) + 0.5) * count / size for size, count in sizes)
    return mask[np.ix_(rows.astype(np.intp), columns.astype(np.intp))]


def _levels(
    equalized: NDArray[np.float64],
    margin: Margin,
    plateau: float,
    region: NDArray[np.bool_] | None,
) -> tuple[float, float]:
    """Attenuation shown at the grey of fat, and that of gland above it, ln; without muscle."""
    inner = margin.depth_mm > LEVELS_DEPTH_MM
    inner = inner & margin.breast if inner.any() else margin.breast
    clear = inner & _off_the_wall(margin)
    inner = clear if clear.any() else inner
    if region is not None and (inner & region).any():
        inner = inner & region
    dark = float(np.quantile(equalized[inner], FAT_QUANTILE))
    muscle = muscle_of(equalized, margin.breast, min(dark, plateau), MIN_CONTRAST, margin.cell_mm)
    rest = inner & ~muscle
    dark, gland = np.quantile(
        equalized[rest if rest.any() else inner], [FAT_QUANTILE, GLAND_QUANTILE]
    )
    low = float(plateau + np.clip(DARK_SHARE * (dark - plateau), 0.0, MAX_DARK))
    return low, float(np.clip(gland - low, MIN_CONTRAST, MAX_CONTRAST))


def _off_the_wall(margin: Margin) -> NDArray[np.bool_]:
    """What is farther from the chest wall; nothing where no breast reaches the image's side."""
    from_wall = margin.cell_mm * (np.arange(margin.breast.shape[1]) + 0.5)
    if not wall_is_left(margin.breast):
        from_wall = from_wall[::-1]
    off: NDArray[np.bool_] = (from_wall > LEVELS_WALL_MM) & margin.breast[:, [0, -1]].any()
    return np.broadcast_to(off, margin.breast.shape)


def _base(
    level: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The image without its details, by the guided filter, guided by the image itself.

    Also how even each place is: 0 where strong steps near it are kept.
    """
    size = 2 * max(1, round(radius)) + 1

    def window_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        mean: NDArray[np.float64] = ndimage.uniform_filter(values, size, mode="nearest")
        return mean

    mean = window_mean(level)
    variance = np.maximum(window_mean(level * level) - mean * mean, 0.0)
    kept = variance / (variance + BASE_EDGE**2)
    near = window_mean(kept)
    return near * level + window_mean((1.0 - kept) * mean), 1.0 - near


def _restored(attenuation: NDArray[np.float32], look: Look, pixel_mm: float) -> NDArray[np.float32]:
    """The image with its finest noise removed and the detail that blur has weakened restored.

    Adding back part of what a Gaussian removes (unsharp masking) is the simplest of the
    restorations that scanners apply. Both steps together are a band-pass with its peak at 1 to 2
    per mm.
    """
    smooth: NDArray[np.float32] = ndimage.gaussian_filter(
        attenuation, look.noise_sigma_mm / pixel_mm, mode="nearest", truncate=3.0
    )
    wide = ndimage.gaussian_filter(smooth, SHARP_MM / pixel_mm, mode="nearest", truncate=3.0)
    np.subtract(smooth, wide, out=wide)
    # strong steps, as at the muscle's edge, are left alone: no halo
    wide *= np.float32(look.sharpness) * np.exp(-np.square(wide / np.float32(SHARP_LIMIT)))
    smooth += wide
    return smooth
