"""Peripheral equalization: what the breast's margin lacks of the attenuation at full thickness."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition.blocks import block_mean, cell_pixels
from mammosim.acquisition.breast_outline import Margin, signed_depth
from mammosim.acquisition.discs import distance_to

F64 = NDArray[np.float64]

BEYOND_MM = 2.0
"""Farther from the breast nothing is added: other objects in the field are not equalized."""

NIPPLE_SIGMA_MM = 1.5
"""A nipple's thickness is taken from its own attenuation on this scale."""

NIPPLE_REACH_MM = (0.0, 12.0)
"""Into the breast this thickness counts in full up to the first distance from what protrudes, at
the second not at all; there the breast's own is greater anyway."""

NIPPLE_CONTOUR_MM = 0.7
"""Depths in a nipple are smoothed by this much: less than elsewhere, as it is smaller."""

AREOLA_MM = 15.0
"""So near to a nipple in profile the profile of fat is that of the margin beside it: the areola's
skin is thicker, and would be taken for fat. Its radius is 20 mm (Sanuki et al. 2009, Aesthetic
Plast Surg 33:295), of which the nipple is 6."""

NIPPLE_CLEAR_MM = 1.0
"""Up to this distance from what protrudes, thin places are left alone: the groove at its base."""

WIDE_CELL_MM = 2.0
"""Grid of the filters along the margin, which are far wider."""

ALONG_EDGE_SIGMA_MM = 12.0
"""Width of the averages along the margin."""

RING_DEPTHS_MM = (4.0, 6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 30.0)
"""Depths at which the profile of the margin is taken; the breast is at full thickness at the last.
Nearer the edge, skin seen along its surface attenuates more than what lies below it."""

EDGE_MM = 0.5
"""Depth of the true edge: smoothing puts the mask's about a cell farther out."""

EDGE_RISE_MM, EDGE_RISE_PART = 0.45, 0.05
"""Depth over which grey rises from black: this, and this part of the depth over which the margin
rounds off. A scanner's equalization follows the smoothed image and misses the outermost part of a
millimetre; and it amplifies only so far, so that the image fades into air where the breast is less
than about a third of full thickness, which takes longer where the margin is wide. On clinical
images the skin line rises over 0.55 to 1.65 mm."""

PROFILE_SIGMA_MM = 0.7
"""The profile of fat is smoothed by this before it is compensated, as scanners' estimates of the
thickness are: just inside the edge a little too much is added, and too little at it. Twice as much
widens the skin line by half a millimetre."""

SKIN_MM = 1.5
"""Thickness of skin; 1.45 mm on average (Huang et al. 2008, Med Phys 35:1199)."""

SKIN_KEPT_MM = (0.5, 1.8)
"""Down to the first depth skin keeps its height above fat, from the second it is compensated like
fat: on clinical images the skin line is brightest at 0.8 to 1.2 mm, and 0.6 to 1.7 mm wide,
although rays cross much skin below it (six images)."""

SKIN_ABOVE_FAT = 0.45
"""Attenuation of skin over that of as much fat, less 1: between 15 and 25 keV 0.5 to 0.4 by the
tissues' own compositions."""

ROUNDING_STEPS = 4
"""Fixed-point steps for the margin's rounding; the last changes it by some per cent."""

PROFILE_STEP_MM = 0.5
"""Step of the mean profile over depth."""

FAT_EXPECTILE = 0.05
"""The profile of fat is this expectile of the ring: gland above it hardly counts."""

EXPECTILE_STEPS = 6
"""Reweighted averages of an expectile; the last changes it by less than a hundredth."""

MIN_ROUNDING_MM, MAX_ROUNDING_MM = 6.0, 40.0
"""Depth over which the margin rounds off: half the thickness for a semicircle, more for a wedge."""

PLATEAU_DEPTH_MM = 20.0
"""Fat at full thickness is looked for deeper than this."""

PLATEAU_QUANTILE = 0.05
"""Fat among what is that deep."""

MAX_GLAND = 1.0
"""The darkest of what is that deep holds no more gland than this (ln): 4 cm."""

EDGE_GAIN, EDGE_TOP, EDGE_REACH = 0.66, 6.0, (1.0, 1.8)
"""Skin on the level of fat is raised by the first part of gland's contrast, and that with the
second part of it not at all, linear between: nine tenths of the differences along the outline stay;
and the places on the skin line's ramp up to which this is done in full and beyond which not at all.
On clinical images skin is about as bright as gland, in dense breasts too: their filters bring out
what stands against the black of air. Where it is least it has two thirds of its mean grey (tenth
part of the outline, six images). Set by eye."""

NIPPLE_LEVEL, NIPPLE_EVENED, NIPPLE_REACHED_MM = 1.1, 0.75, (0.5, 5.0)
"""A nipple in profile is brought near this part of gland's contrast, by the second part of what it
has less or more; and the distances from it up to which this is done in full and beyond which not at
all. On clinical images a nipple is evenly as bright as the skin line beside it, or brighter (three
women), and fades into the breast with no line across its base. Set by eye."""

LIFT_MM = 4.5
"""Depth at which what is added to the margin, that of a nipple included, has fallen to half of that
at its edge. On clinical images fat brightens
towards the skin line, whose grey is 0.63 to 0.73: 3 mm below it it is 0.30 to 0.36, 5 mm below 0.23
to 0.25, 10 mm below 0.14 to 0.17, and a nipple in profile is about as bright as the skin line
(three images)."""

THIN_DEPTH_MM, THIN_SIGMA_MM, THIN_PART = 1.0, 1.5, 0.9
"""Thin places are looked for deeper than the first, on the scale of the second, and this part of
what they lack is added."""


def missing_attenuation(
    coarse: F64, margin: Margin, fat: float | None = None, skin_rise: float = 1.0
) -> tuple[F64, F64, float]:
    """What each place lacks against fat at full thickness.

    Parameters
    ----------
    coarse : ndarray of float64, [row, column]
        Attenuation (ln).
    margin : Margin
    fat : float, optional
        Attenuation of fat at full thickness; default: estimated from the image.
    skin_rise : float
        Length of the skin line's ramp over that of `EDGE_RISE_MM` and `EDGE_RISE_PART`.

    Returns
    -------
    missing : ndarray of float64, [row, column]
        Attenuation (ln), 0 beyond the margin; in air, that of the nearest edge.
    rise : ndarray of float64, [row, column]
        Place on the ramp of the skin line: black at 0, full grey from 1.
    plateau : float
        Attenuation of fat at full thickness, ln.

    Notes
    -----
    The profile of fat over depth is measured in rings below the skin, as a low expectile (Newey
    and Powell 1987, Econometrica 55:819) over `ALONG_EDGE_SIGMA_MM` of the margin. From the
    outermost ring to the edge it is continued as an ellipse, since a free surface between two
    plates is rounded. What a layer of skin on that surface adds is taken off, so that skin keeps
    the height above fat that its own attenuation gives it: most where it is seen along its
    surface, then less and less over some millimetres. A nipple in profile is soft tissue as thick
    as its own attenuation says. Nothing in a breast attenuates less than fat; what does in the sum
    is thinner than its surroundings, as between folds, and is brought up to it.
    """
    plateau = _plateau(coarse, margin, fat)
    rings = np.minimum(_ring_profiles(coarse, margin), plateau)
    rounding = _rounding_mm(rings[0] / plateau)
    depth_mm = margin.depth_mm - EDGE_MM
    expected = _at_depth(rings, depth_mm, rounding, plateau)
    sigma = PROFILE_SIGMA_MM / margin.cell_mm
    expected = ndimage.gaussian_filter(np.maximum(expected, 0.0), sigma, mode="nearest")
    ramp_mm = skin_rise * (EDGE_RISE_MM + EDGE_RISE_PART * rounding)
    rise = depth_mm / ramp_mm
    if not margin.body[margin.breast].all():
        expected, rise = _with_nipple(expected, rise, ramp_mm, coarse, margin)
    missing = np.maximum(plateau - expected, 0.0)
    missing += _thin_places(coarse + missing, margin, plateau)
    missing[distance_to(margin.breast) * margin.cell_mm > BEYOND_MM] = 0.0
    return missing, rise, plateau


def raised_edge(
    equalized: F64, margin: Margin, plateau: float, fat: float, contrast: float, lift: float
) -> tuple[F64, F64]:
    """What is added to the margin, and to its skin, which are seen before the black of air.

    Parameters
    ----------
    equalized : ndarray of float64, [row, column]
        Attenuation (ln) with what the margin lacks.
    margin : Margin
    plateau : float
        Attenuation (ln) of fat at full thickness, above which skin is raised.
    fat, contrast : float
        Attenuation (ln) shown at the grey of fat, and that of gland above it.
    lift : float
        Part of what is missing up to the level of gland that is added at the edge.

    Returns
    -------
    lifted : ndarray of float64, [row, column]
        Part of what is missing up to the level of gland, so that more attenuation stays brighter.
    raised : ndarray of float64, [row, column]
        What skin has beyond that, to be added within `EDGE_REACH` of the skin line's ramp.
    """
    depth_mm = _outline_depth_mm(margin)
    level = (equalized - fat) / contrast
    above = (equalized - plateau) / contrast
    part = lift / (1.0 + np.square(np.maximum(depth_mm, 0.0) / LIFT_MM))
    lifted = part * (1.0 - np.clip(level, -1.0, 1.0))
    raised = above - level + EDGE_GAIN * (1.0 - np.clip(above / EDGE_TOP, 0.0, 1.0))
    return contrast * lifted, contrast * np.maximum(raised - lifted, 0.0)


def evened_nipple(margin: Margin) -> F64:
    """Part of the way to `NIPPLE_LEVEL` that a nipple in profile is brought, and what is near it.

    Parameters
    ----------
    margin : Margin

    Returns
    -------
    ndarray of float64, [row, column]
    """
    nipple = margin.breast & ~margin.body
    if not nipple.any():
        return np.zeros(nipple.shape)
    near, far = NIPPLE_REACHED_MM
    close = smooth_step((far - distance_to(nipple) * margin.cell_mm) / (far - near))
    return NIPPLE_EVENED * close


def _outline_depth_mm(margin: Margin) -> F64:
    """Distance to the edge of breast and nipple together, negative outside, mm."""
    return signed_depth(margin.breast, NIPPLE_CONTOUR_MM / margin.cell_mm) * margin.cell_mm


def smooth_step(place: F64) -> F64:
    """0 up to 0, 1 from 1 on, smooth between."""
    ramp = np.clip(place, 0.0, 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


def _plateau(coarse: F64, margin: Margin, fat: float | None) -> float:
    """Attenuation of fat at full thickness: no more than what the darkest part of the image has."""
    deepest = 0.8 * float(margin.depth_mm.max())
    deep = margin.body & (margin.depth_mm >= min(PLATEAU_DEPTH_MM, deepest))
    dark = float(np.quantile(coarse[deep], PLATEAU_QUANTILE))
    return dark if fat is None else float(np.clip(fat, dark - MAX_GLAND, dark))


def _ring_profiles(coarse: F64, margin: Margin) -> F64:
    """Attenuation of fat at each of `RING_DEPTHS_MM`, [ring, row, column]."""
    wide = cell_pixels(WIDE_CELL_MM, margin.cell_mm)
    sigma = ALONG_EDGE_SIGMA_MM / (wide * margin.cell_mm)
    usual = _mean_profile(coarse, margin)
    areola = distance_to(margin.breast & ~margin.body) * margin.cell_mm < AREOLA_MM
    # what differs from the breast's mean profile hardly changes with depth within a ring
    differs = coarse - np.interp(margin.depth_mm, *usual)
    profiles: list[F64] = []
    for depths in _rings():
        # before the first depth and behind the third a ring weighs nothing
        weight = np.interp(margin.depth_mm, depths, (0.0, 1.0, 0.0), left=0.0, right=0.0)
        weight[~margin.body] = 0.0
        beside = np.where(areola, 0.0, weight)
        weight = beside if beside.any() else weight
        share = block_mean(weight, wide)
        if not share.any():
            profiles.append(profiles[-1] if profiles else block_mean(coarse, wide))
            continue
        total = block_mean(weight * differs, wide)
        values = np.divide(total, share, out=np.zeros_like(total), where=share > 0.0)
        profile = np.interp(depths[1], *usual) + _local_expectile(values, share, sigma)
        profiles.append(np.maximum(profiles[-1], profile) if profiles else profile)
    return np.stack([_on_fine_grid(profile, coarse.shape, wide) for profile in profiles])


def _mean_profile(coarse: F64, margin: Margin) -> tuple[F64, F64]:
    """Depths (mm) and the mean attenuation there over the whole margin."""
    edges = np.arange(0.0, 1.2 * RING_DEPTHS_MM[-1], PROFILE_STEP_MM)
    bins = np.digitize(margin.depth_mm[margin.body], edges)
    count = np.bincount(bins, minlength=edges.size + 1)
    total = np.bincount(bins, coarse[margin.body], minlength=edges.size + 1)
    depth = np.bincount(bins, margin.depth_mm[margin.body], minlength=edges.size + 1)
    used = count > 0
    return depth[used] / count[used], total[used] / count[used]


def _rings() -> Iterator[tuple[float, float, float]]:
    """Depth of each ring, between those at which its weight is 0, mm."""
    first, second = RING_DEPTHS_MM[:2]
    depths = (2.0 * first - second, *RING_DEPTHS_MM, 1.2 * RING_DEPTHS_MM[-1])
    yield from zip(depths, depths[1:], depths[2:], strict=False)


def _local_expectile(values: F64, share: F64, sigma: float) -> F64:
    """A low expectile of the neighbourhood: an average in which what is above it counts little."""
    weight = share
    for _ in range(EXPECTILE_STEPS):
        near = np.maximum(ndimage.gaussian_filter(weight, sigma, mode="nearest"), 1e-12)
        mean: F64 = ndimage.gaussian_filter(weight * values, sigma, mode="nearest") / near
        weight = share * np.where(values > mean, FAT_EXPECTILE, 1.0 - FAT_EXPECTILE)
    return mean


def _on_fine_grid(wide_values: F64, shape: tuple[int, ...], wide: int) -> F64:
    """Bilinear interpolation between the cells of the wide grid."""
    place = [
        np.clip((np.arange(n) + 0.5) / wide - 0.5, 0.0, m - 1.0)
        for n, m in zip(shape, wide_values.shape, strict=True)
    ]
    grid = np.meshgrid(*place, indexing="ij")
    fine: F64 = ndimage.map_coordinates(wide_values, grid, order=1)
    return fine


def _rounding_mm(first: F64) -> F64:
    """Depth over which the margin rounds off, mm.

    `first` is what the outermost ring attenuates, as part of fat at full thickness: an ellipse of
    fat and what skin adds to it.
    """
    depth_mm = RING_DEPTHS_MM[0] - EDGE_MM
    rounding = np.full(first.shape, MAX_ROUNDING_MM)
    for _ in range(ROUNDING_STEPS):
        fat = np.clip(first - _skin_part(depth_mm, rounding), 0.0, 1.0)
        rounding = depth_mm / np.maximum(1.0 - np.sqrt(1.0 - fat**2), 1e-6)
        rounding = np.clip(rounding, MIN_ROUNDING_MM, MAX_ROUNDING_MM)
    return rounding


def _at_depth(rings: F64, depth_mm: F64, rounding: F64, plateau: float) -> F64:
    """Attenuation of fat at each place's depth; an ellipse outside the first ring."""
    depths = np.array(RING_DEPTHS_MM) - EDGE_MM
    place = np.interp(depth_mm, depths, np.arange(depths.size))
    below = np.minimum(place.astype(np.intp), depths.size - 2)
    part = place - below
    low, high = (np.take_along_axis(rings, (below + step)[None], 0)[0] for step in (0, 1))
    inner = (1.0 - part) * low + part * high
    fat = rings[0] - plateau * _skin_part(depths[0], rounding)
    outer = fat * _ellipse(depth_mm / rounding) / _ellipse(depths[0] / rounding)
    near, far = SKIN_KEPT_MM
    kept = smooth_step((far - depth_mm) / (far - near))
    skin = plateau * _skin_part(depth_mm, rounding)
    return np.where(depth_mm < depths[0], outer + (1.0 - kept) * skin, inner - kept * skin)


def _skin_part(depth_mm: F64 | float, rounding_mm: F64) -> F64:
    """What skin adds to the attenuation of as much fat, against fat at full thickness.

    Its length along a ray is that between two ellipses; what it has on both faces of the middle of
    the breast belongs to the level of fat.
    """
    deep = 1.0 - _ellipse(1.0 - SKIN_MM / rounding_mm)
    between = _ellipse(depth_mm / rounding_mm) - _ellipse((depth_mm - SKIN_MM) / rounding_mm)
    return SKIN_ABOVE_FAT * np.maximum(between - deep, 0.0)


def _ellipse(part: F64) -> F64:
    """Height of an ellipse over the distance from its edge, both as parts of the semi-axes."""
    height: F64 = np.sqrt(np.maximum(1.0 - (1.0 - np.clip(part, 0.0, 1.0)) ** 2, 0.0))
    return height


def _with_nipple(
    expected: F64, rise: F64, ramp_mm: F64, coarse: F64, margin: Margin
) -> tuple[F64, F64]:
    """The same with a nipple in profile, which is soft tissue and no fat.

    A ray meets the breast, the nipple, or both one behind the other in the same plane: what it
    crosses is as thick as the thicker of the two.
    """
    cell_mm = margin.cell_mm
    nipple = margin.breast & ~margin.body
    own = _local_mean(coarse, nipple, NIPPLE_SIGMA_MM / cell_mm) / (1.0 + SKIN_ABOVE_FAT)
    near, far = NIPPLE_REACH_MM
    own *= smooth_step((far - distance_to(nipple) * cell_mm) / (far - near))
    outline_mm = _outline_depth_mm(margin)
    close = smooth_step(2.0 - distance_to(nipple) * cell_mm / NIPPLE_SIGMA_MM)
    own_rise = (outline_mm - EDGE_MM) / ramp_mm
    return np.maximum(expected, own), rise + close * np.maximum(own_rise - rise, 0.0)


def _thin_places(level: F64, margin: Margin, plateau: float) -> F64:
    """What is missing yet where the sum attenuates less than fat; nothing in and near a nipple."""
    inside = distance_to(~margin.breast) * margin.cell_mm > THIN_DEPTH_MM
    inside &= distance_to(margin.breast & ~margin.body) * margin.cell_mm > NIPPLE_CLEAR_MM
    sigma = THIN_SIGMA_MM / margin.cell_mm
    lacking = np.maximum(plateau - _local_mean(level, inside, sigma), 0.0)
    return THIN_PART * np.minimum(2.0 * _nearness(inside, sigma), 1.0) * lacking


def _local_mean(values: F64, region: NDArray[np.bool_], sigma_cells: float) -> F64:
    """Mean of the part of the neighbourhood that belongs to a region."""
    total = ndimage.gaussian_filter(np.where(region, values, 0.0), sigma_cells, mode="nearest")
    mean: F64 = total / _nearness(region, sigma_cells)
    return mean


def _nearness(region: NDArray[np.bool_], sigma_cells: float) -> F64:
    """Share of each place's neighbourhood that belongs to a region."""
    share: F64 = ndimage.gaussian_filter(region.astype(np.float64), sigma_cells, mode="nearest")
    return np.maximum(share, 1e-6)
