"""Looks of the For Presentation image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
    """

    gains: tuple[float, float]
    noise_sigma_mm: float
    sharpness: float
    skin_rise: float = 1.0
    white: float = 0.86


UNIT_STREAM = 7
"""Tells the stream of random numbers of a unit's processing from others of a seed; any number."""

SHARP_MM = 0.2
"""Width of the Gaussian above which sharpness does nothing, mm."""

SHARP_LIMIT = 0.02
"""Details (ln) well below this are raised in full, those above not at all."""

LOOKS = {"crisp": Look((1.35, 1.9), 0.055, 0.7), "soft": Look((1.1, 1.35), 0.06, 0.2)}
"""Scanners differ in how far they enhance local contrast and suppress noise; these are two ends of
what is seen on clinical images, of no manufacturer in particular."""

DRAWN = "drawn"
"""Name of the look that each seed draws for itself."""

WIDE_GAINS, FINE_GAINS = (1.3, 1.55), (1.9, 2.8)
"""Range of a unit's gains. Grain in the middle greys differs by a factor of 1.8 over the images of
three women from two manufacturers; this is a range of 1.5."""

SHARPNESS = (0.5, 0.9)
"""Range of a unit's sharpness. Chosen."""

SKIN_RISES = (0.8, 1.3)
"""Range of a unit's rise of the skin line: on clinical images grey rises over 0.55 to 1.65 mm in
CC, 0.93 mm on average (twelve images), and is brightest 0.7 to 1.2 mm below the edge (six). With
more than this the line is brightest beyond that, and a dim band."""

WHITES = (0.76, 0.92)
"""Range of the grey that muscle nears: on clinical images muscle is at 0.34 to 0.81 (five)."""


def look_of(name: str, unit_seed: int | None = None) -> Look:
    """A look by its name; `DRAWN` is that of the unit of a seed.

    Units differ by manufacturer, version and site, so that women's images differ in more than their
    breasts.
    """
    if name != DRAWN:
        return LOOKS[name]
    rng = np.random.default_rng([unit_seed or 0, UNIT_STREAM])
    wide, sharpness, white = (rng.uniform(*span) for span in (WIDE_GAINS, SHARPNESS, WHITES))
    fine, rise = (np.exp(rng.uniform(*np.log(span))) for span in (FINE_GAINS, SKIN_RISES))
    crisp = LOOKS["crisp"]
    return Look((wide, float(fine)), crisp.noise_sigma_mm, sharpness, float(rise), white)
