"""The panel: a plate that ends on all four sides, every edge rounded, and may be tilted."""

from typing import NamedTuple

import numpy as np

from mammosim.compression.plates._plate_kernels import depth_in_plate


class PanelPlate(NamedTuple):
    """A panel in lattice units.

    At rest its face is at z = `face`, and it is solid above that where `side` is +1 (paddle) and
    below it where it is -1. It reaches from `back` to `front` along x and from `low` to `high`
    along y; edges are rounded with `radius`. It is turned about the line x = `hinge` in its face,
    by an angle of this `sine` and `cosine`: a positive one brings its front towards the breast.
    """

    face: float
    side: float
    back: float
    front: float
    low: float
    high: float
    radius: float
    hinge: float
    sine: float
    cosine: float


@depth_in_plate.of(PanelPlate)
def panel_depth(plate, x, y, z):
    """Depth and outward normal: see `depth_in_plate`.

    A box with rounded edges is a smaller box and all that is within `radius` of it.
    """
    ahead, above = x - plate.hinge, plate.side * (z - plate.face)
    along = plate.hinge + plate.cosine * ahead - plate.sine * above
    inwards = plate.sine * ahead + plate.cosine * above
    to_back, to_front = plate.back + plate.radius - along, along - plate.front + plate.radius
    to_low, to_high = plate.low + plate.radius - y, y - plate.high + plate.radius
    beyond_x, sign_x = (to_back, -1.0) if to_back > to_front else (to_front, 1.0)
    beyond_y, sign_y = (to_low, -1.0) if to_low > to_high else (to_high, 1.0)
    below = plate.radius - inwards
    if beyond_x > 0.0 or beyond_y > 0.0 or below > 0.0:
        a, b, c = max(beyond_x, 0.0), max(beyond_y, 0.0), max(below, 0.0)
        distance = np.sqrt(a * a + b * b + c * c)
        normal_x, normal_y, normal_in = sign_x * a / distance, sign_y * b / distance, -c / distance
        depth = plate.radius - distance
    elif beyond_x >= beyond_y and beyond_x >= below:
        normal_x, normal_y, normal_in, depth = sign_x, 0.0, 0.0, plate.radius - beyond_x
    elif beyond_y >= below:
        normal_x, normal_y, normal_in, depth = 0.0, sign_y, 0.0, plate.radius - beyond_y
    else:
        normal_x, normal_y, normal_in, depth = 0.0, 0.0, -1.0, plate.radius - below
    return (
        depth,
        plate.cosine * normal_x + plate.sine * normal_in,
        normal_y,
        plate.side * (plate.cosine * normal_in - plate.sine * normal_x),
    )
