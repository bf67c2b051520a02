"""Looks of the For Presentation image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAT_GREY, GLAND_GREY = 0.10, 0.64
"""Usual grey of fat and of gland. On clinical images the 5th percentile of grey in the breast is
0.08 to 0.22 (twelve CC; mean 0.12) and 0.09 to 0.12 (five MLO), the 99th 0.55 to 0.75."""


@dataclass(frozen=True)
class Look:
    """How strongly details are shown.

    Parameters
    ----------
    gains : tuple of float
        Contrast of details over that of the base, which is wider than half a window of 5 mm: of
        those down to half a window of 1.5 mm, and of finer ones.
    noise_sigma_mm : float
        Width of the smoothing that takes out the finest noise, mm.
    sharpness : float
        Part by which what is finer than `SHARP_MM` is raised before all else, to make up for what
        focal spot, detector and voxels have blurred.
    skin_rise : float
        Depth over which grey rises from black at the skin line, over that of the least.
    white : float
        Grey that the shoulder of the base nears, where muscle lies.
    fat_grey, gland_grey : float
        Grey of fat and of gland.
    lift : float
        Part of what is missing up to the level of gland that is added at the margin's edge.
    """

    gains: tuple[float, float]
    noise_sigma_mm: float
    sharpness: float
    skin_rise: float = 1.0
    white: float = 0.86
    fat_grey: float = FAT_GREY
    gland_grey: float = GLAND_GREY
    lift: float = 0.65


UNIT_STREAM = 7
"""Tells the stream of random numbers of a unit's processing from others of a seed; any number."""

SHARP_MM = 0.2
"""Width of the Gaussian above which sharpness does nothing, mm."""

SHARP_LIMIT = 0.03
"""Details (ln) well below this are raised in full, those above not at all. Up to a sharpness of 2.2
the stronger of two details stays the stronger one."""

LOOKS = {"crisp": Look((1.35, 1.9), 0.055, 0.7), "soft": Look((1.1, 1.35), 0.06, 0.2)}
"""Scanners differ in how far they enhance local contrast and suppress noise; these are two ends of
what is seen on clinical images, of no manufacturer in particular."""

DRAWN = "drawn"
"""Name of the look that each seed draws for itself."""

WIDE_GAINS, FINE_GAINS = (1.27, 1.47), (2.05, 2.5)
"""Range of a unit's gains; that of fine detail at the sharpness of `USUAL_SHARPNESS`."""

SHARPNESS, USUAL_SHARPNESS = (0.65, 2.0), 0.9
"""Range of a unit's sharpness. The spectral exponent from 0.7 to 2 per mm, which is 2.45 to 3.20 on
clinical CC and 2.26 to 3.27 on MLO, falls by 0.5 over it."""

FINE_EXCHANGE = 0.6
"""Fine gain falls with this power of what sharpness raises the finest detail by (1 + sharpness), so
that grain differs by a factor of 1.5 between units (by these constants; not measured). In the
middle greys it differs by 1.8 over the images of three women from two manufacturers."""

NOISE_SIGMAS_MM = (0.072, 0.060)
"""Range of the smoothing of the finest noise, from the weakest processing to the strongest."""

SKIN_RISES = (0.8, 1.3)
"""Range of a unit's rise of the skin line: on clinical images grey rises over 0.55 to 1.65 mm in
CC, 0.93 mm on average (twelve images), and is brightest 0.7 to 1.25 mm below the edge (six). With
more than this the line is brightest beyond that, and a dim band."""

WHITES = (0.92, 0.74)
"""Range of the grey that muscle nears, from the weakest processing to the strongest: on clinical
images muscle is at 0.34 to 0.81 (five)."""

FAT_GREYS, GLAND_GREYS = (0.087, 0.099), (0.58, 0.70)
"""Ranges of the grey of fat and of gland, which are the unit's window. Chosen within what is seen
on clinical images (see `FAT_GREY`)."""

LIFTS = (0.6, 0.85)
"""Range of how far a unit's equalization overcompensates the margin: on clinical images grey 5 mm
below the skin line is 0.05 to 0.31 of the range above the darkest (twelve CC)."""

FAMILIES = 0.6
"""Both parameters of the beta distribution of how strongly a unit processes: most lie near one of
two ends, since there are few families of processing. Assumed from three clinical MLO of two women:
that with the greyest muscle (0.41) has the flattest spectrum of fine detail (exponent 2.3), by eye
the finest grain, and the wider skin line; those with white muscle (0.79, 0.81) have a steep one
(3.2, 3.3). The number is chosen, so that women's images differ about as clinical ones do."""

IN_COMMON = 0.8
"""Part of a unit's place in the ranges of sharpness, noise, skin line and white that is common to
all four, since processing by scales compresses what is wide and raises what is fine at once; the
rest is each one's own. Chosen."""


def look_of(name: str, unit_seed: int | None = None) -> Look:
    """A look by its name; `DRAWN` is that of the unit of a seed.

    Units differ by manufacturer, version and site, so that women's images differ in more than their
    breasts.
    """
    if name != DRAWN:
        return LOOKS[name]
    rng = np.random.default_rng([unit_seed or 0, UNIT_STREAM])
    strength = rng.beta(FAMILIES, FAMILIES)

    def related(span: tuple[float, float]) -> float:
        part = IN_COMMON * strength + (1.0 - IN_COMMON) * rng.uniform()
        return float(span[0] + (span[1] - span[0]) * part)

    def own(span: tuple[float, float]) -> float:
        return float(rng.uniform(*span))

    sharpness = float(np.exp(related(_logarithm(SHARPNESS))))
    exchange = ((1.0 + sharpness) / (1.0 + USUAL_SHARPNESS)) ** FINE_EXCHANGE
    fine = float(np.exp(own(_logarithm(FINE_GAINS)))) / exchange
    return Look(
        gains=(own(WIDE_GAINS), fine),
        noise_sigma_mm=related(NOISE_SIGMAS_MM),
        sharpness=sharpness,
        skin_rise=float(np.exp(related(_logarithm(SKIN_RISES)))),
        white=related(WHITES),
        fat_grey=own(FAT_GREYS),
        gland_grey=own(GLAND_GREYS),
        lift=own(LIFTS),
    )


def _logarithm(span: tuple[float, float]) -> tuple[float, float]:
    """Logarithms of both ends of a range."""
    return float(np.log(span[0])), float(np.log(span[1]))
