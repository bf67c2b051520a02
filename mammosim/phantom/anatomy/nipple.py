"""The nipple, a blunt cone of many shapes, sometimes flat; its root, and the areola around it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom.anatomy.settings import GenerateSettings

FLAT_SHARE = 0.08
"""Share of breasts whose nipple is flat or drawn in: of 600 breasts 3.5 % were inverted (Sanuki et
al. 2009, Aesthetic Plast Surg 33:295-297), of women a tenth has one that is flat or inverted
(Alexander, Grant & Campbell 1992, BMJ 304:1030-1032)."""

HEIGHT_MM, HEIGHT_SHAPE, HEIGHTS_MM = 6.2, 10.0, (4.0, 8.0)
"""Mean height of a nipple that is not flat, shape of its gamma law, and bounds: measured with
calipers it is 9 mm on average (Sanuki et al. 2009), here less (assumed: it is not stimulated), as
`STOUT` takes some. Stretched skin takes another third between plates, and the areola's bulge hides
a part: it stands out by up to 4 mm, as on clinical images."""

DIAMETER_MM, DIAMETER_SPREAD_MM, DIAMETERS_MM = 9.2, 1.4, (7.0, 12.5)
"""Diameter: 13 mm on average (Sanuki et al. 2009), reached here between plates: the flare at the
foot adds 2 mm and the skin's stretch a fifth, which a real nipple, of smooth muscle, resists. The
spread is assumed."""

STOUT = 0.65
"""A nipple is no higher than this part of its diameter: a thin, high one looks like a thumb. Chosen
by eye."""

TAPER, DOME, LUMPS_MM = (0.0, 0.5), (1.8, 4.5), (0.3, 1.1)
"""Part of the radius that is lost at the tip, exponent of its rounding, and amplitude of its
unevenness: most nipples are an elevated plateau with steep sides (60 % of 600 breasts; Sanuki et
al. 2009), others are cones and domes. Chosen by eye."""

DOWN, LEAN = -0.05, 0.12
"""How far a nipple leans downward on average, and the spread of that and of its lean aside, mm per
mm of height. Chosen by eye: positioning brings it into profile."""

MAX_TILT = 0.7
"""A nipple turns aside by no more than this, mm per mm forward. Assumed."""

ROOT_MM = (3.0, 8.0)
"""How far the nipple's fibrous tissue reaches below the skin. Assumed."""

AREOLA_MM, AREOLA_SPREAD_MM, AREOLAS_MM = 18.0, 2.5, (12.0, 24.0)
"""Radius of the areola: 20 mm on average (Sanuki et al. 2009), here to where a third of its extra
thickness is left; the spread is assumed."""

AREOLA_THICKER_MM, AREOLA_RAISED_MM = (0.6, 1.9), (0.2, 1.4)
"""How much deeper the areola's skin reaches at the nipple than other skin, and how far it bulges
there: on mammograms skin swells towards the nipple over 15 to 25 mm; the numbers are a choice."""


@dataclass(frozen=True)
class Areola:
    """What surrounds and carries the nipple, lengths in mm.

    Parameters
    ----------
    thicker_mm, raised_mm : float
        Extra thickness of the skin at the nipple inwards and outwards.
    radius_mm : float
        Distance from the nipple at which a third of both is left.
    root_mm : float
        Depth below the skin to which the nipple's fibrous tissue reaches.
    """

    thicker_mm: float
    raised_mm: float
    radius_mm: float
    root_mm: float

    @property
    def bulge_ml(self) -> float:
        """Volume of what stands out, mL."""
        return float(1e-3 * np.pi * self.raised_mm * self.radius_mm**2)

    def bulge_mm(
        self, lateral: NDArray[np.float64], superior: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """How far it stands out at places (mm), which may broadcast, mm."""
        near = (np.square(lateral) + np.square(superior)) / self.radius_mm**2
        bulge: NDArray[np.float64] = self.raised_mm * np.exp(-near)
        return bulge


def draw_areola(rng: np.random.Generator) -> Areola:
    """An areola and the nipple's root."""
    (bulge_rng,) = rng.spawn(1)
    return Areola(
        rng.uniform(*AREOLA_THICKER_MM),
        bulge_rng.uniform(*AREOLA_RAISED_MM),
        float(np.clip(rng.normal(AREOLA_MM, AREOLA_SPREAD_MM), *AREOLAS_MM)),
        rng.uniform(*ROOT_MM),
    )


@dataclass(frozen=True)
class Nipple:
    """Lengths in mm.

    Parameters
    ----------
    height_mm : float
        How far it stands out of the areola.
    radius_mm : float
        Half its width at the foot.
    taper : float
        Part of the radius that is lost at the tip.
    tilt : tuple of float
        How far it leans from where the skin faces, lateral and superior, mm per mm of height.
    dome : float
        Exponent of the rounding at the tip: 2 is a dome, larger is flatter.
    lumps_mm : float
        Amplitude of its unevenness.
    place : float
        Where in the noise it is.
    """

    height_mm: float
    radius_mm: float
    taper: float
    tilt: tuple[float, float]
    dome: float
    lumps_mm: float
    place: float

    def numbers(
        self, foot_mm: float, facing: tuple[float, float], root_mm: float
    ) -> NDArray[np.float64]:
        """As the kernels want it; `foot_mm` is where it stands on the x axis, and the skin there is
        `facing` lateral and superior (mm per mm forward)."""
        tilt = np.clip(np.array(self.tilt) + facing, -MAX_TILT, MAX_TILT)
        return np.array(
            [
                foot_mm, self.height_mm, self.radius_mm, self.taper, *tilt, self.dome,
                self.lumps_mm, self.place, root_mm,
            ]
        )  # fmt: skip


def draw_nipple(settings: GenerateSettings, rng: np.random.Generator) -> Nipple:
    """A nipple; height and diameter are as settings say, or drawn."""
    flat = rng.random() < FLAT_SHARE
    height = (
        rng.uniform(0.5, 2.0)
        if flat
        else float(np.clip(rng.gamma(HEIGHT_SHAPE, HEIGHT_MM / HEIGHT_SHAPE), *HEIGHTS_MM))
    )
    diameter = float(np.clip(rng.normal(DIAMETER_MM, DIAMETER_SPREAD_MM), *DIAMETERS_MM))
    tilt = rng.normal((0.0, DOWN), LEAN, 2).clip(-0.5, 0.5)
    return Nipple(
        settings.nipple_height_mm or min(height, STOUT * diameter),
        0.5 * (settings.nipple_diameter_mm or diameter),
        rng.uniform(*TAPER),
        (float(tilt[0]), float(tilt[1])),
        rng.uniform(*DOME),
        rng.uniform(*LUMPS_MM),
        rng.uniform(0.0, 100.0),
    )


def varied(nipple: Nipple, settings: GenerateSettings, rng: np.random.Generator) -> Nipple:
    """The nipple of one breast about what both have in common; set lengths stay."""
    tall, wide = np.exp(0.1 * rng.standard_normal(2).clip(-2.0, 2.0))
    lean = 0.06 * rng.standard_normal(2)
    return replace(
        nipple,
        height_mm=settings.nipple_height_mm or nipple.height_mm * float(tall),
        radius_mm=nipple.radius_mm * (1.0 if settings.nipple_diameter_mm else float(wide)),
        tilt=(nipple.tilt[0] + float(lean[0]), nipple.tilt[1] + float(lean[1])),
        place=nipple.place + rng.uniform(0.0, 100.0),
    )
