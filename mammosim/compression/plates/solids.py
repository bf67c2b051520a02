"""What a plate is: its place, its shape, and the table of shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.plates._straight_kernels import StraightPlate

EDGE_RADIUS_MM = 3.0
"""Of the rounding at the plates' edge; the paddle of FDA's VICTRE has it."""


class PlatePlace(NamedTuple):
    """Where a plate is, in the units of a lattice.

    Parameters
    ----------
    face : float
        z of its face.
    side : float
        +1 for the paddle, which is solid above its face, -1 for the breast support.
    edge : float
        x of its edge.
    middle : float
        y of the breast frame's origin, the middle of the detector.
    spacing_mm : float
        Length of the lattice's unit, mm.
    """

    face: float
    side: float
    edge: float
    middle: float
    spacing_mm: float


def straight(place: PlatePlace) -> StraightPlate:
    """A flat plate with a straight edge."""
    return StraightPlate(place.face, place.side, place.edge, EDGE_RADIUS_MM / place.spacing_mm)


SHAPES: dict[str, Callable[[PlatePlace], Any]] = {"straight": straight}
"""Solids by the name of their shape: each gives the NamedTuple whose class has a formula of
`depth_in_plate`."""


@dataclass(frozen=True)
class Plates:
    """Paddle and breast support.

    Parameters
    ----------
    support_z_mm, paddle_z_mm : float
        Heights of their faces, compression frame, mm.
    edge_mm : float
        Breast-frame x of their edge, mm.
    paddle : str
        Shape of the paddle, a name in `SHAPES`; the breast support is straight.
    """

    support_z_mm: float
    paddle_z_mm: float
    edge_mm: float
    paddle: str = "straight"

    @property
    def thickness_mm(self) -> float:
        """Gap between the faces, mm."""
        return self.paddle_z_mm - self.support_z_mm

    def solids(self, origin_mm: NDArray[np.float64], spacing_mm: float) -> tuple[Any, Any]:
        """Paddle and breast support as kernels take them.

        Parameters
        ----------
        origin_mm : ndarray, (3,)
            Place of node [0, 0, 0] of a lattice, compression frame, mm.
        spacing_mm : float
            Its spacing, mm.
        """
        edge = (self.edge_mm - origin_mm[0]) / spacing_mm
        middle = -float(origin_mm[1]) / spacing_mm
        parts = ((self.paddle, self.paddle_z_mm, 1.0), ("straight", self.support_z_mm, -1.0))
        paddle, support = (
            SHAPES[shape](
                PlatePlace(
                    float((z_mm - origin_mm[2]) / spacing_mm), side, float(edge), middle, spacing_mm
                )
            )
            for shape, z_mm, side in parts
        )
        return paddle, support

    def shaped(self, paddle: str) -> Plates:
        """The same places with another shape of the paddle."""
        return replace(self, paddle=paddle)

    def closing_to(self, end: Plates, part: float) -> Plates:
        """Plates that have gone the part 0 to 1 of their way to `end`, at one speed each."""
        lower = self.support_z_mm + part * (end.support_z_mm - self.support_z_mm)
        upper = self.paddle_z_mm + part * (end.paddle_z_mm - self.paddle_z_mm)
        return Plates(lower, upper, end.edge_mm, end.paddle)
