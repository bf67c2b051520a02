"""The picture for reading: logarithm, peripheral equalisation and a contrast curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition._kernels import present_kernel
from mammosim.acquisition.blocks import block_mean, cell_pixels
from mammosim.acquisition.discs import beyond_discs
from mammosim.acquisition.muscle import above_level, muscle_of

CELL_MM = 0.5  # grid of mask and distance to the skin
AIR_LEVEL = 0.04  # attenuation (ln) that tells tissue from air: half a millimetre of skin
CONTOUR_SIGMA_MM = 1.5  # distances are smoothed by it: the edge of the mask is a staircase
MARGIN_MM = 30.0  # the breast is at full thickness this far from its edge at the latest
FULL_MARGIN_MM = 20.0  # between this depth and that, equalisation fades out
LOCAL_SIGMA_MM = 3.0  # what is thinner than the margin's profile on this scale (folds)
LOCAL_DEPTH_MM = 15.0  # is looked at on its own up to this depth
OUTLINE_RADIUS_MM = (
    10.0  # what no disc of this radius reaches stands out from the outline: a nipple
)
LEAST_NIPPLE_MM = 2.0  # by at least so much
NIPPLE_BASE_MM = 2.5  # so far into the breast goes its base, where the margin has no skin line
NIPPLE_SIGMA_MM = (
    1.5  # its own attenuation on this scale, and the width of its border to the breast
)
RING_MM = 2.0  # the margin's profile is taken in rings of equal depth this wide
ALONG_EDGE_SIGMA_MM = 12.0  # and along the edge on this scale
PROFILE_QUANTILE = 0.30  # fat between gland: what the margin is equalised by
STRENGTH = 0.90  # part of the margin's missing thickness that is made up; of the nipple's, all
SKIN_RAMP_MM = 2.5  # over which equalisation sets in, so that the skin line stands against air
# Dense breasts have little pure fat, but some; a thin spot at the chest wall is no fat's level.
FAT_QUANTILE, GLAND_QUANTILE = 0.08, 0.99
LEVELS_DEPTH_MM = 8.0  # the levels of fat and gland are taken deeper than this
FAT_LEVEL = 0.28  # grey of fat, as part of the range, on clinical mammograms
MUSCLE_LEVEL = 0.88  # grey of muscle
# Contrast (ln) of what is shown at white, above fat: a fatty breast is not stretched beyond the
# first; what an all-dense breast (about 33 mm of gland more than its neighbour) has beyond the
# second goes into the shoulder of the curve.
LEAST_CONTRAST, MOST_CONTRAST = 0.45, 1.0
BENDS = (0.12, 0.75)  # grey below and above which the curve bends, as film's toe and shoulder do
MAXIMUM = 4095  # 12 bits


@dataclass(frozen=True, eq=False)
class Presentation:
    """A picture for reading, with its window.

    Parameters
    ----------
    pixels : ndarray of uint16, [row, column]
        0 is air, bright is dense.
    window_center, window_width : float
    """

    pixels: NDArray[np.uint16]
    window_center: float
    window_width: float


def present(attenuation: NDArray[np.float32], pixel_mm: float) -> Presentation:
    """Make the picture for reading from a flat-fielded logarithmic image.

    Parameters
    ----------
    attenuation : ndarray of float32, [row, column]
        ln(signal of air / signal), about 0 in air.
    pixel_mm : float
        Pixel pitch, mm.

    Returns
    -------
    Presentation

    Notes
    -----
    Around the margin, where the breast is thinner than the gap, the missing attenuation is
    estimated from the distance to the breast's edge (the profile of fat, rising to its plateau)
    and added back; near the edge, what is thinner still (between folds) from its neighbourhood, and
    what stands out from the outline (the nipple) from itself. What is added is smooth, so details
    keep their contrast, and at any one place more attenuation is always brighter. Muscle that runs
    out at a corner is brought down to just below white by its median. Nothing but the image is
    used, as in a scanner's software. Where gland reaches the skin along most of the edge, the
    profile takes it for fat.
    """
    cell = cell_pixels(CELL_MM, pixel_mm)
    coarse = block_mean(attenuation, cell)
    breast = _breast_mask(coarse)
    if not breast.any():
        return Presentation(np.zeros(attenuation.shape, np.uint16), (MAXIMUM + 1) / 2, MAXIMUM + 1)
    cell_mm = cell * pixel_mm
    body = _without_nipple(breast, cell_mm)
    depth_mm = _signed_depth(body, CONTOUR_SIGMA_MM / cell_mm) * cell_mm
    added = _missing_attenuation(coarse, breast, body, depth_mm, cell_mm)
    equalised = coarse + added
    muscle, low, high = _levels(equalised, breast, depth_mm, cell_mm)
    added -= above_level(equalised, muscle, low + MUSCLE_LEVEL * (high - low), cell_mm)
    pixels = np.empty(attenuation.shape, np.uint16)
    present_kernel(attenuation, added, float(cell), low, high, BENDS, float(MAXIMUM), pixels)
    return Presentation(pixels, (MAXIMUM + 1) / 2, float(MAXIMUM + 1))


def _breast_mask(coarse: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The largest connected region that is not air, without holes."""
    smooth = ndimage.gaussian_filter(coarse, 1.0, mode="nearest")
    labels, count = ndimage.label(smooth > AIR_LEVEL)
    if count == 0:
        return np.zeros(coarse.shape, bool)
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    filled: NDArray[np.bool_] = ndimage.binary_fill_holes(labels == largest)
    return filled


def _signed_depth(breast: NDArray[np.bool_], sigma_cells: float) -> NDArray[np.float64]:
    """Distance to the edge of the breast in cells, negative in air.

    The image's border is no edge: where the breast is cut off, it goes on.
    """
    if breast.all():
        return np.full(breast.shape, float(sum(breast.shape)))
    inside = ndimage.distance_transform_edt(breast)
    outside = ndimage.distance_transform_edt(~breast)
    depth = np.where(breast, inside - 0.5, 0.5 - outside)
    smooth: NDArray[np.float64] = ndimage.gaussian_filter(depth, sigma_cells, mode="nearest")
    return smooth


def _without_nipple(breast: NDArray[np.bool_], cell_mm: float) -> NDArray[np.bool_]:
    """The breast without what stands out from its rounded outline; the image's border is none."""
    wide = int(np.ceil(OUTLINE_RADIUS_MM / cell_mm)) + 1
    padded = np.pad(breast, wide, mode="edge")
    if padded.all():
        return breast
    beyond = beyond_discs(padded, wide)[wide:-wide, wide:-wide]
    if np.isinf(beyond).all():  # a breast narrower than the disc
        return breast
    labels, count = ndimage.label(breast & (beyond > 0.0))
    far = ndimage.maximum(beyond * cell_mm, labels, np.arange(1, count + 1))
    nipples = 1 + np.flatnonzero(np.asarray(far) >= LEAST_NIPPLE_MM)
    body: NDArray[np.bool_] = breast & ~np.isin(labels, nipples)
    return body


def _missing_attenuation(
    coarse: NDArray[np.float64],
    breast: NDArray[np.bool_],
    body: NDArray[np.bool_],
    depth_mm: NDArray[np.float64],
    cell_mm: float,
) -> NDArray[np.float64]:
    """What margin and nipple lack against the plateau, ln units, on the coarse grid; 0 in air."""
    expected, plateau = _fat_profile(coarse, body, depth_mm, cell_mm)
    sigma = LOCAL_SIGMA_MM / cell_mm
    local = _local_mean(coarse, body, _nearness(body, sigma), sigma)
    shallow = np.clip(2.0 - depth_mm / LOCAL_DEPTH_MM, 0.0, 1.0)
    thinner = shallow * np.maximum(expected - local, 0.0)
    fade = _smooth_step((MARGIN_MM - depth_mm) / (MARGIN_MM - FULL_MARGIN_MM))
    lacking = STRENGTH * np.maximum(plateau - expected + thinner, 0.0) * fade
    if not body[breast].all():
        lacking = _with_nipple(lacking, coarse, breast, body, plateau, cell_mm)
        depth_mm = _signed_depth(breast, CONTOUR_SIGMA_MM / cell_mm) * cell_mm
    return np.where(breast, lacking * _smooth_step(depth_mm / SKIN_RAMP_MM), 0.0)


def _with_nipple(
    lacking: NDArray[np.float64],
    coarse: NDArray[np.float64],
    breast: NDArray[np.bool_],
    body: NDArray[np.bool_],
    plateau: float,
    cell_mm: float,
) -> NDArray[np.float64]:
    """What margin and nipple lack, of which the nipple lacks all but what it has on average."""
    from_nipple_mm = ndimage.distance_transform_edt(body | ~breast) * cell_mm
    nipple = breast & (from_nipple_mm <= NIPPLE_BASE_MM)
    sigma = NIPPLE_SIGMA_MM / cell_mm
    near = _nearness(nipple, sigma)
    own = _local_mean(coarse, nipple, near, sigma)
    share = near / _nearness(breast, sigma)
    return lacking + share * (np.maximum(plateau - own, 0.0) - lacking)


def _smooth_step(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 up to 0, 1 from 1 on, smooth between."""
    ramp = np.clip(place, 0.0, 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


def _fat_profile(
    coarse: NDArray[np.float64],
    breast: NDArray[np.bool_],
    depth_mm: NDArray[np.float64],
    cell_mm: float,
) -> tuple[NDArray[np.float64], float]:
    """Attenuation that fat at each place's depth has in its neighbourhood, and at full thickness.

    The breast rounds off differently along its edge, so each ring of equal depth is averaged over
    `ALONG_EDGE_SIGMA_MM` of itself; what lies above that average, gland, is cut off at it and the
    rest averaged again.
    """
    centres = np.arange(0.5 * RING_MM, MARGIN_MM, RING_MM)
    sigma = ALONG_EDGE_SIGMA_MM / cell_mm
    rings = np.empty((centres.size, *coarse.shape))
    level = np.zeros(coarse.shape)
    for number, centre in enumerate(centres):
        ring = breast & (np.abs(depth_mm - centre) <= 0.5 * RING_MM)
        if ring.any():
            near = _nearness(ring, sigma)
            mean = _local_mean(coarse, ring, near, sigma)
            level = np.maximum(level, _local_mean(np.minimum(coarse, mean), ring, near, sigma))
        rings[number] = level
    place = np.clip((depth_mm - centres[0]) / RING_MM, 0.0, centres.size - 1.0)
    below = np.minimum(place.astype(np.intp), centres.size - 2)
    part = place - below
    low, high = (np.take_along_axis(rings, (below + step)[None], 0)[0] for step in (0, 1))
    deepest = breast & (depth_mm >= min(MARGIN_MM - 2.0 * RING_MM, 0.8 * float(depth_mm.max())))
    plateau = float(np.quantile(coarse[deepest], PROFILE_QUANTILE))
    return (1.0 - part) * low + part * high, plateau


def _nearness(region: NDArray[np.bool_], sigma_cells: float) -> NDArray[np.float64]:
    """Share of each place's neighbourhood that belongs to a region."""
    share: NDArray[np.float64] = ndimage.gaussian_filter(
        region.astype(np.float64), sigma_cells, mode="nearest"
    )
    return np.maximum(share, 1e-6)


def _local_mean(
    coarse: NDArray[np.float64],
    region: NDArray[np.bool_],
    nearness: NDArray[np.float64],
    sigma_cells: float,
) -> NDArray[np.float64]:
    """Mean of the part of the neighbourhood that belongs to a region."""
    total = ndimage.gaussian_filter(np.where(region, coarse, 0.0), sigma_cells, mode="nearest")
    mean: NDArray[np.float64] = total / nearness
    return mean


def _levels(
    equalised: NDArray[np.float64],
    breast: NDArray[np.bool_],
    depth_mm: NDArray[np.float64],
    cell_mm: float,
) -> tuple[NDArray[np.bool_], float, float]:
    """Where muscle is, equalised attenuation shown black, and that at the straight curve's white.

    Muscle is left out of the levels.
    """
    inner = depth_mm > LEVELS_DEPTH_MM
    inner = inner if inner.any() else breast
    fat = float(np.quantile(equalised[inner], FAT_QUANTILE))
    muscle = muscle_of(equalised, breast, fat, LEAST_CONTRAST, cell_mm)
    rest = inner & ~muscle
    fat, gland = np.quantile(
        equalised[rest if rest.any() else inner], [FAT_QUANTILE, GLAND_QUANTILE]
    )
    contrast = float(np.clip(gland - fat, LEAST_CONTRAST, MOST_CONTRAST))
    low = float(fat) - contrast * FAT_LEVEL / (1.0 - FAT_LEVEL)
    return muscle, low, float(fat) + contrast
