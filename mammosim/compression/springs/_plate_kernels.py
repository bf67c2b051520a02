"""Where the plates let a node be: the formulas that every solver of the springs shares.

A plate is a solid that fills all beyond its face, from its edge forward; between face and end it is
rounded. Tissue that lies beyond the edge at rest stays between the faces, and tissue behind the
edge, where it is higher than a face, is stopped by the plate's end. As which of the two a node is
treated does not change while it moves, so that places along z follow from z alone, and those along
x from x and z: two problems with one solution each. Each bears along its own axis only.
"""

from typing import NamedTuple

import numpy as np

from mammosim._jit import inlined_kernel


class PlateSolids(NamedTuple):
    """Plates in lattice units; see `SpringProblem`."""

    lower: float
    upper: float
    edge: float
    radius: float


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
