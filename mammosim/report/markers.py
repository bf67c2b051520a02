"""Marks over the pictures, and the frontal drawing of how far each target moved."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import Gantry
from mammosim.report.labels import Label, Marked, place_labels, sampled
from mammosim.targets import Target

_MIN_RADIUS_MM = 5.0  # a circle smaller than a fingertip is overlooked
_MARGIN_MM = 2.0  # the circle must not hide the lesion's edge
_RING_MM = 20.0  # rings of the frontal drawing
_HOUR_FONT, _DOT_FONT, _DOT_RADIUS = 1 / 15, 0.06, 0.02  # of half its side


@dataclass(frozen=True)
class Marker:
    """A mark on a picture, in the picture's pixels.

    Parameters
    ----------
    text : str
        Target id, or `N` for the nipple.
    name, kind : str
    x, y : float
        Centre; the middle of the first pixel is at 0.5.
    radius : float
    from_x, from_y : float
        Where the target would have appeared on this detector without compression.
    """

    text: str
    name: str
    kind: str
    x: float
    y: float
    radius: float
    from_x: float = math.nan
    from_y: float = math.nan

    @property
    def arrow(self) -> bool:
        """Whether compression moved the mark by more than its own circle."""
        return math.hypot(self.x - self.from_x, self.y - self.from_y) > self.radius

    @property
    def filled(self) -> float:
        """Radius of what is drawn: a circle, or a cross half as wide."""
        return 0.5 * self.radius if self.kind in ("nipple", "landmark") else self.radius


def markers(targets: Sequence[Target], gantry: Gantry) -> list[Marker]:
    """Marks of the targets of one view that lie in its picture.

    Parameters
    ----------
    targets : sequence of Target
        Of this view.
    gantry : Gantry

    Returns
    -------
    list of Marker
    """
    return [_marker(target, gantry) for target in targets if target.in_field]


def _marker(target: Target, gantry: Gantry) -> Marker:
    x, y = target.image_col_px + 0.5, target.image_row_px + 0.5
    row, column = gantry.project(gantry.gantry_from_breast(target.place_mm)).tolist()
    return Marker(
        text="N" if target.kind == "nipple" else str(target.target_id),
        name=target.name,
        kind=target.kind,
        x=x,
        y=y,
        radius=_radius_mm(target) / gantry.pixel_mm,
        from_x=column + 0.5,
        from_y=row + 0.5,
    )


def _radius_mm(target: Target) -> float:
    """Radius of a circle around a lesion: half its extent and a margin."""
    if not math.isfinite(target.extent_mm):
        return _MIN_RADIUS_MM
    return max(_MIN_RADIUS_MM, 0.5 * target.extent_mm + _MARGIN_MM)


def shift_arrows(
    rows: Mapping[str, Sequence[Target]], nipple_mm: NDArray[np.float64]
) -> dict[str, Any]:
    """The breast from the front, as a radiologist facing the patient sees it.

    Parameters
    ----------
    rows : mapping of str to sequence of Target
        Targets of each view of one breast.
    nipple_mm : ndarray, (3,)
        Nipple of the uncompressed breast, breast frame, mm.

    Returns
    -------
    dict
        `extent` (half side of the square, mm), `rings` (radii, mm), `dots` (target id, name, x,
        y), their `labels`, and `arrows` (view's number, view, x, y, dx, dy), in mm from the
        nipple; x towards the patient's left, which is the viewer's right, and y **down**, as in
        SVG.
    """
    _, nipple_y, nipple_z = (float(value) for value in nipple_mm)
    dots: dict[int, tuple[int, str, float, float]] = {}
    arrows = []
    for number, (view, targets) in enumerate(rows.items()):
        for target in targets:
            x, y = target.y_mm - nipple_y, -(target.z_mm - nipple_z)
            dots[target.target_id] = (target.target_id, target.name, x, y)
            arrows.append((number, view, x, y, target.shift_y_mm, -target.shift_z_mm))
    reach = [math.hypot(x, y) for *_, x, y in dots.values()]
    reach += [math.hypot(x + dx, y + dy) for *_, x, y, dx, dy in arrows]
    count = max(2, math.ceil(max(reach, default=0.0) / _RING_MM))
    extent = count * _RING_MM + 8.0
    return {
        "extent": extent,
        "rings": [_RING_MM * (ring + 1) for ring in range(count)],
        "dots": list(dots.values()),
        "labels": _frontal_labels(list(dots.values()), arrows, extent),
        "arrows": arrows,
        "views": list(rows),
    }


def _frontal_labels(
    dots: Sequence[tuple[int, str, float, float]],
    arrows: Sequence[tuple[int, str, float, float, float, float]],
    extent: float,
) -> list[Label]:
    """Numbers of the dots of the frontal drawing: to the upper left, unless it is full there."""
    font = _DOT_FONT * extent
    ways = sampled([((x, y), (x + dx, y + dy)) for *_, x, y, dx, dy in arrows], font)
    hour = 1.5 * _HOUR_FONT * extent
    hours = [(x * (extent - 0.5 * hour), y * (extent - 0.5 * hour), hour, hour)
             for x, y in ((0, -1), (1, 0), (0, 1), (-1, 0))]  # fmt: skip
    box = (-extent, -extent, 2.0 * extent, 2.0 * extent)
    marked = Marked([[dot[2:] for dot in dots]], [_DOT_RADIUS * extent] * len(dots), box,
                    ways, hours)  # fmt: skip
    return place_labels(marked, [str(dot[0]) for dot in dots], [font] * len(dots), (-1.0, -0.7))
