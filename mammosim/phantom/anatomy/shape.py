"""The breast's outer shape: a body on four half-axes that hangs, leans and fills unevenly.

Coordinates of the generator are [x anterior, lateral, superior] in mm with the nipple's foot on
the x axis; a left breast has lateral = +y and a right one lateral = -y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Points = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

TYPICAL_ML = 620.0
"""Volume about which proportions are drawn, mL."""

FOOT_PART = 0.26
"""Height in which the foot of the base falls to a third, in radii."""

BLUNT = 0.35
"""Over this part of the radius the tip of a cone is rounded."""

FOOT_STEPS = 200
"""Points on the x axis between which the skin is found by linear interpolation."""

FRONT_LATERAL, FRONT_SUPERIOR = (0.00, 0.12), (-0.12, -0.06)
"""How far the front point lies lateral of the nipple and above it, in radii. It lies below, since
the lower half of the breast is the smaller one: the middle of its sections, where plates close in
CC, was 4 to 9 mm above a nipple that was level with the front point, and is 0 to 3 mm above this
one. That is how a breast is lifted, so that the nipple is in profile. Chosen."""

BASE_SUPERIOR, BASE_SUPERIOR_PTOSIS = -0.08, 0.11
"""How far the centre of the base lies above the nipple of a breast that does not hang, and how much
more with ptosis, in radii. Chosen with `FRONT_SUPERIOR`."""

SLOPE_MM = 1.0
"""Distance over which the skin's slope at the nipple is taken."""

SIDES_SPREAD = 0.025
"""Spread of the logarithm of each breast's half-axes about those that a woman's have in common."""


@dataclass(frozen=True)
class Shape:
    """Outer shape, all lengths in mm.

    Parameters
    ----------
    front_mm : float
        Chest wall to the front point, which in a breast that hangs is not the nipple.
    radius_mm : float
        Size of the base, to which the half-axes are relative.
    lateral, medial, upper, lower : float
        Half-axes of the base, in radii.
    base_lateral_mm, base_superior_mm : float
        Centre of the base against the nipple: it lies medial and above, as the nipple points
        outward and hangs.
    front_lateral_mm, front_superior_mm : float
        The front point against the nipple, which lies below the most prominent part of the breast.
    sag_mm : float
        How far the middle of the breast hangs below the line from base to nipple.
    fullness : float
        Growth of the base towards the upper outer quadrant, as a fraction of the radius.
    straight : tuple of float
        Profile towards lateral, medial, upper and lower: 0 is round, 1 a blunt cone's.
    straight_upper_outer : float
        Profile towards the upper outer quadrant, between lateral and upper.
    foot : tuple of float
        How far the base spreads on the chest wall in these directions, as a fraction of its reach:
        skin and fat of the chest, in which the breast ends.
    boxiness : float
        Exponent of the base's outline: 2 is an ellipse, less is flatter between them.
    ripple : tuple of float
        Cosine and sine parts of the base's second and third harmonics, fractions of the radius.
    """

    front_mm: float
    radius_mm: float
    lateral: float
    medial: float
    upper: float
    lower: float
    base_lateral_mm: float
    base_superior_mm: float
    front_lateral_mm: float
    front_superior_mm: float
    sag_mm: float
    fullness: float
    straight: tuple[float, float, float, float]
    straight_upper_outer: float
    foot: tuple[float, float, float, float]
    boxiness: float
    ripple: tuple[float, float, float, float]

    def scaled(self, factor: float) -> Shape:
        """The same shape, larger by a factor."""
        lengths = (
            "front_mm", "radius_mm", "base_lateral_mm", "base_superior_mm", "front_lateral_mm",
            "front_superior_mm", "sag_mm",
        )  # fmt: skip
        return replace(self, **{name: getattr(self, name) * factor for name in lengths})

    @cached_property
    def depth_mm(self) -> float:
        """Chest wall to the nipple's foot, where the x axis meets the skin, mm."""
        x = np.linspace(0.5 * self.front_mm, self.front_mm, FOOT_STEPS)
        inside = level(self, (x, np.zeros(1), np.zeros(1)))
        return float(np.interp(0.0, -inside, x))

    @cached_property
    def facing(self) -> tuple[float, float]:
        """Where the skin faces at the nipple's foot, lateral and superior, mm per mm forward."""
        foot = np.array([[self.depth_mm], [0.0], [0.0]])
        either = np.array([foot - SLOPE_MM * np.eye(3), foot + SLOPE_MM * np.eye(3)])
        before, after = (level(self, (x, lateral, superior)) for x, lateral, superior in either)
        forward, lateral, superior = after - before
        return float(lateral / forward), float(superior / forward)


def draw_shape(volume_ml: float, rng: np.random.Generator) -> Shape:
    """A shape of about a volume; `fit_volume` makes it the size wanted.

    Parameters
    ----------
    volume_ml : float
        Large breasts are drawn deeper for their base, and hang more.
    rng : Generator

    Notes
    -----
    Proportions are choices, made so that compressed breasts have the areas and thicknesses that
    are published (docs/explanation/phantom.md shows both), and that no two look alike. A breast
    is drawn as it is positioned, lifted so that its nipple lies about midway between the plates.
    """
    radius = 62.0 * (volume_ml / TYPICAL_ML) ** (1.0 / 3.0)
    larger = np.log2(volume_ml / TYPICAL_ML)
    ptosis = float(np.clip(0.45 + 0.18 * larger + 0.28 * rng.standard_normal(), 0.0, 1.2))
    ripple = 0.02 * rng.standard_normal(4).clip(-2.0, 2.0)
    (front_rng,) = rng.spawn(1)
    return Shape(
        front_mm=radius * float(np.clip(rng.normal(1.31 + 0.08 * larger, 0.11), 1.05, 1.67)),
        radius_mm=radius,
        lateral=rng.uniform(1.00, 1.20),
        medial=rng.uniform(0.88, 1.02),
        upper=rng.uniform(0.86, 1.06),
        lower=rng.uniform(0.82, 0.98),
        base_lateral_mm=radius * rng.uniform(-0.06, 0.10),
        base_superior_mm=radius * (BASE_SUPERIOR + BASE_SUPERIOR_PTOSIS * ptosis),
        front_lateral_mm=radius * front_rng.uniform(*FRONT_LATERAL),
        front_superior_mm=radius * front_rng.uniform(*FRONT_SUPERIOR),
        sag_mm=radius * 0.07 * ptosis * rng.uniform(0.5, 1.5),
        fullness=rng.uniform(0.02, 0.22),
        straight=(
            rng.uniform(0.65, 1.1),
            rng.uniform(0.35, 0.90),
            float(np.clip(0.35 + 0.4 * ptosis + 0.2 * rng.standard_normal(), 0.2, 1.1)),
            rng.uniform(0.50, 1.05),
        ),
        straight_upper_outer=rng.uniform(-0.55, 0.05),
        foot=(
            rng.uniform(0.15, 0.30),
            rng.uniform(0.20, 0.40),
            rng.uniform(0.08, 0.20),
            rng.uniform(0.50, 0.80),
        ),
        boxiness=rng.uniform(1.75, 2.1),
        ripple=(float(ripple[0]), float(ripple[1]), float(ripple[2]), float(ripple[3])),
    )


def like(shape: Shape, rng: np.random.Generator) -> Shape:
    """A shape about another: that of one breast about what both of a woman have in common."""
    lengths = ("front_mm", "lateral", "medial", "upper", "lower")
    factors = np.exp(SIDES_SPREAD * rng.standard_normal(len(lengths)).clip(-2.0, 2.0))
    changed = {
        name: float(getattr(shape, name) * factor)
        for name, factor in zip(lengths, factors, strict=True)
    }
    ripple = np.array(shape.ripple) + 0.008 * rng.standard_normal(4).clip(-2.0, 2.0)
    return replace(
        shape,
        **changed,
        base_lateral_mm=shape.base_lateral_mm + 0.02 * shape.radius_mm * float(rng.uniform(-1, 1)),
        sag_mm=shape.sag_mm * float(rng.uniform(0.8, 1.2)),
        straight=_about(shape.straight, 0.06, rng),
        foot=_about(shape.foot, 0.03, rng),
        ripple=(float(ripple[0]), float(ripple[1]), float(ripple[2]), float(ripple[3])),
    )


def _about(
    sides: tuple[float, float, float, float], by: float, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """Four numbers, each changed by up to a limit."""
    a, b, c, d = (side + float(by * rng.uniform(-1.0, 1.0)) for side in sides)
    return a, b, c, d


def level(shape: Shape, points_mm: Points) -> NDArray[np.float64]:
    """Positive inside, 0 on the skin, negative outside; smooth everywhere.

    Parameters
    ----------
    shape : Shape
    points_mm : tuple of three ndarray that broadcast
        x, lateral, superior, mm.

    Notes
    -----
    The section at depth fraction t = x / front is r = R(angle) (1 - t^p)^(1/q): p = q = 2 is an
    ellipsoid, smaller p and q make the profile straighter; its tip is rounded over `BLUNT`. At the
    wall the section spreads into the foot. The section's centre goes from the base's to the
    front point's as t grows, on a line that sags.
    """
    x, lateral, superior = points_mm
    t = np.clip(x / shape.front_mm, 0.0, None)
    shift = np.clip(1.0 - t**1.6, 0.0, None)
    sag = 4.0 * shape.sag_mm * t * np.clip(1.0 - t, 0.0, None)
    front_lateral, front_superior = shape.front_lateral_mm, shape.front_superior_mm
    across = lateral - front_lateral - (shape.base_lateral_mm - front_lateral) * shift
    up = superior - front_superior - (shape.base_superior_mm - front_superior) * shift + sag
    angle = np.arctan2(up, across)
    cosine, sine, upper_outer = np.cos(angle), np.sin(angle), _upper_outer(angle)
    straight = _by_direction(shape.straight, cosine, sine)
    straight = straight + (shape.straight_upper_outer - straight) * upper_outer
    fall = np.exp(-x / (FOOT_PART * shape.radius_mm))
    full = shape.fullness * upper_outer * np.clip(1.0 - t, 0.0, 1.0) ** 0.5
    reach = _reach_mm(shape, angle, cosine, sine, full)
    reach *= 1.0 + _by_direction(shape.foot, cosine, sine) * fall
    p = 2.15 - 0.95 * straight
    q = 2.1 - 0.60 * straight
    squared = (across**2 + up**2) / reach**2
    blunt = BLUNT**q
    section = ((squared + BLUNT**2) ** (0.5 * q) - blunt) / ((1.0 + BLUNT**2) ** (0.5 * q) - blunt)
    # Odd in x, so that slopes at the wall are those in front of it.
    inside: NDArray[np.float64] = 1.0 - section - np.sign(x) * np.abs(x / shape.front_mm) ** p
    return inside


def _by_direction(
    sides: tuple[float, float, float, float],
    cosine: NDArray[np.float64],
    sine: NDArray[np.float64],
) -> NDArray[np.float64]:
    """A number that varies smoothly from each of four sides to the next."""
    lateral, medial, upper, lower = sides
    across: NDArray[np.float64] = np.where(cosine > 0.0, lateral, medial) * cosine**2
    return across + np.where(sine > 0.0, upper, lower) * sine**2


def _reach_mm(
    shape: Shape,
    angle: NDArray[np.float64],
    cosine: NDArray[np.float64],
    sine: NDArray[np.float64],
    full: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Radius of the section in each direction, as if it were at the base, mm.

    `full` is how much more it is, in radii, where the breast is full.
    """
    # Half-axes merge smoothly, so that the skin has no crease.
    right = 0.5 * (1.0 + np.tanh(2.5 * cosine))
    top = 0.5 * (1.0 + np.tanh(2.5 * sine))
    a = shape.medial + (shape.lateral - shape.medial) * right
    b = shape.lower + (shape.upper - shape.lower) * top
    n = shape.boxiness
    outline = ((np.abs(cosine) / a) ** n + (np.abs(sine) / b) ** n) ** (-1.0 / n)
    c2, s2, c3, s3 = shape.ripple
    reach: NDArray[np.float64] = shape.radius_mm * (
        outline + full
        + c2 * np.cos(2 * angle) + s2 * np.sin(2 * angle)
        + c3 * np.cos(3 * angle) + s3 * np.sin(3 * angle)
    )  # fmt: skip
    return reach


def _upper_outer(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 towards the upper outer quadrant, falling smoothly to nothing in the other three."""
    share: NDArray[np.float64] = np.exp(3.2 * (np.cos(angle - np.deg2rad(50.0)) - 1.0))
    return share


def smooth_step(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 up to 0, 1 from 1 on, smooth between."""
    ramp = np.clip(place, 0.0, 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)
