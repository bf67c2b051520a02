"""The straight plate: a solid behind a flat face, from a straight edge forward, the edge rounded.

The springs see two of them as a gap. Tissue that lies beyond the edge at rest stays between the
faces, and tissue behind the edge, where it is higher than a face, is stopped by the plate's end. As
which of the two a node is treated does not change while it moves, so that places along z follow
from z alone, and those along x from x and z: two problems with one solution each. Each bears along
its own axis only.
"""

from typing import NamedTuple

import numpy as np

from mammosim._jit import inlined_kernel
from mammosim.compression.plates._plate_kernels import depth_in_plate


class StraightPlate(NamedTuple):
    """A straight plate in lattice units.

    `face` is the z of its face; it is solid above that where `side` is +1 (paddle) and below it
    where it is -1 (breast support), and lies in front of x = `edge`, rounded with `radius`.
    """

    face: float
    side: float
    edge: float
    radius: float


@depth_in_plate.of(StraightPlate)
def straight_depth(plate, x, y, z):
    """Depth and outward normal: see `depth_in_plate`. The plate is endless along y."""
    inwards, behind = plate.side * (z - plate.face), x - plate.edge
    if inwards < plate.radius and behind < plate.radius:
        ahead, below = plate.radius - behind, plate.radius - inwards
        distance = np.sqrt(ahead * ahead + below * below)
        return plate.radius - distance, -ahead / distance, 0.0, -plate.side * below / distance
    if inwards <= behind:
        return inwards, 0.0, 0.0, -plate.side
    return behind, -1.0, 0.0, 0.0


class StraightGap(NamedTuple):
    """Two straight plates as the springs see them, lattice units; see `SpringProblem`."""

    lower: float
    upper: float
    edge: float
    radius: float


@inlined_kernel
def lies_between(x, plates):
    """Whether a node at x at rest stays between the plates' faces, or is stopped by their ends."""
    return x > plates.edge


@inlined_kernel
def foremost(z, plates):
    """Largest x that a node from behind the plates' edge can reach at height z."""
    beyond = max(z - plates.upper, plates.lower - z)
    if beyond <= 0.0:
        return np.inf
    if beyond >= plates.radius:
        return plates.edge
    flat = plates.radius - beyond
    return plates.edge + plates.radius - np.sqrt(plates.radius * plates.radius - flat * flat)
