"""What a plate is: its place, its shape, and the table of shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.plates._panel_kernels import PanelPlate
from mammosim.compression.plates._straight_kernels import StraightPlate
from mammosim.compression.settings import SMALL_PADDLE_MM

EDGE_RADIUS_MM = 3.0
"""Of the rounding at the plates' edge; the paddle of FDA's VICTRE has it."""

MAX_ROUNDED = 0.4
"""Part of a panel's smaller side that the radius of its edges takes up at most."""


@dataclass(frozen=True)
class Panel:
    """What a paddle covers, and how it is tilted; compression frame.

    Parameters
    ----------
    back_mm, front_mm : float
        x of its edge towards the chest wall and of its opposite edge, mm.
    low_mm, high_mm : float
        y of its sides, mm.
    hinge_mm : float
        x of the line in its face about which it tilts, mm. The face's height is that of this line.
    tilt_deg : float
        Angle by which its front is turned towards the breast support, degrees.
    """

    back_mm: float
    front_mm: float
    low_mm: float
    high_mm: float
    hinge_mm: float
    tilt_deg: float = 0.0

    @property
    def widest_rounding_mm(self) -> float:
        """Largest radius of its edges that leaves its face a flat part, mm."""
        return MAX_ROUNDED * min(self.front_mm - self.back_mm, self.high_mm - self.low_mm)

    def covers(self, places_mm: NDArray[np.float64], edge_mm: float) -> NDArray[np.bool_]:
        """Which of some places (n, 3), compression frame, lie over or under it where it is level.

        Parameters
        ----------
        places_mm : ndarray, (n, 3)
        edge_mm : float
            x of the plates' edge, mm.
        """
        x, y = places_mm[:, 0] - edge_mm, places_mm[:, 1]
        return np.asarray(
            (x > self.back_mm) & (x < self.front_mm) & (y > self.low_mm) & (y < self.high_mm)
        )


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
    panel : Panel, optional
        What it covers, in mm in front of `edge` along x and beside `middle` along y; None: all in
        front of its edge.
    radius_mm : float
        Of its rounded edge, mm.
    """

    face: float
    side: float
    edge: float
    middle: float
    spacing_mm: float
    panel: Panel | None = None
    radius_mm: float = EDGE_RADIUS_MM


def straight(place: PlatePlace) -> StraightPlate:
    """A flat plate with a straight edge."""
    return StraightPlate(place.face, place.side, place.edge, place.radius_mm / place.spacing_mm)


def panel(place: PlatePlace) -> PanelPlate:
    """A plate that ends on all sides and may be tilted; of the usual size if that is not given."""
    depth, width = SMALL_PADDLE_MM
    covered = place.panel or Panel(0.0, depth, -0.5 * width, 0.5 * width, 0.0)
    spacing, angle = place.spacing_mm, np.deg2rad(covered.tilt_deg)
    return PanelPlate(
        place.face,
        place.side,
        place.edge + covered.back_mm / spacing,
        place.edge + covered.front_mm / spacing,
        place.middle + covered.low_mm / spacing,
        place.middle + covered.high_mm / spacing,
        min(place.radius_mm, covered.widest_rounding_mm) / spacing,
        place.edge + covered.hinge_mm / spacing,
        float(np.sin(angle)),
        float(np.cos(angle)),
    )


SHAPES: dict[str, Callable[[PlatePlace], Any]] = {"straight": straight, "panel": panel}
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
    panel : Panel, optional
        What a paddle of the shape `panel` covers, x counted from `edge_mm`.
    radius_mm : float
        Of their rounded edges, mm.
    """

    support_z_mm: float
    paddle_z_mm: float
    edge_mm: float
    paddle: str = "straight"
    panel: Panel | None = None
    radius_mm: float = EDGE_RADIUS_MM

    @property
    def thickness_mm(self) -> float:
        """Gap between the faces, mm."""
        return self.paddle_z_mm - self.support_z_mm

    @property
    def centre_mm(self) -> float:
        """Height of the middle between the faces, mm."""
        return 0.5 * (self.support_z_mm + self.paddle_z_mm)

    def at_height(self, centre_mm: float, thickness_mm: float | None = None) -> Plates:
        """The same plates about another height, with the same gap or another one, mm."""
        half = 0.5 * (self.thickness_mm if thickness_mm is None else thickness_mm)
        return replace(self, support_z_mm=centre_mm - half, paddle_z_mm=centre_mm + half)

    def solids(self, origin_mm: NDArray[np.float64], spacing_mm: float) -> tuple[Any, Any]:
        """Paddle and breast support as kernels take them.

        Parameters
        ----------
        origin_mm : ndarray, (3,)
            Place of node [0, 0, 0] of a lattice, compression frame, mm.
        spacing_mm : float
            Its spacing, mm.
        """
        edge = float((self.edge_mm - origin_mm[0]) / spacing_mm)
        middle = -float(origin_mm[1]) / spacing_mm

        def solid(shape: str, z_mm: float, side: float, panel: Panel | None = None) -> Any:
            face = float((z_mm - origin_mm[2]) / spacing_mm)
            place = PlatePlace(face, side, edge, middle, spacing_mm, panel, self.radius_mm)
            return SHAPES[shape](place)

        paddle = solid(self.paddle, self.paddle_z_mm, 1.0, self.panel)
        return paddle, solid("straight", self.support_z_mm, -1.0)

    def carried(self, end: Plates, places_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where places go with paddle and support while these go to `end`, [plate, n, 3], mm.

        Parameters
        ----------
        end : Plates
        places_mm : ndarray, (n, 3)
            Compression frame.
        """
        moved = np.repeat(places_mm[None], 2, axis=0)
        moved[0, :, 2] += end.paddle_z_mm - self.paddle_z_mm
        moved[1, :, 2] += end.support_z_mm - self.support_z_mm
        if self.panel is not None and end.panel is not None:
            angle = np.deg2rad(end.panel.tilt_deg - self.panel.tilt_deg)
            ahead = moved[0, :, 0] - (end.edge_mm + end.panel.hinge_mm)
            above = moved[0, :, 2] - end.paddle_z_mm
            moved[0, :, 0] += (np.cos(angle) - 1.0) * ahead + np.sin(angle) * above
            moved[0, :, 2] += (np.cos(angle) - 1.0) * above - np.sin(angle) * ahead
        return moved

    def shaped(self, paddle: str, panel: Panel | None = None) -> Plates:
        """The same places with another shape of the paddle."""
        return replace(self, paddle=paddle, panel=panel)

    def closing_to(self, end: Plates, part: float) -> Plates:
        """Plates that have gone the part 0 to 1 of their way to `end`, at one speed each."""
        lower = self.support_z_mm + part * (end.support_z_mm - self.support_z_mm)
        upper = self.paddle_z_mm + part * (end.paddle_z_mm - self.paddle_z_mm)
        return replace(end, support_z_mm=lower, paddle_z_mm=upper)
