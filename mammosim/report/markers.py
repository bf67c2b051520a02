"""Marks over the pictures, and the frontal drawing of how far each target moved."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import Gantry
from mammosim.targets import Target

_LEAST_RADIUS_MM = 5.0  # a circle smaller than a fingertip is overlooked
_MARGIN_MM = 2.0  # the circle must not hide the lesion's edge
_RING_MM = 20.0  # rings of the frontal drawing


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
    text_x : float
        Where the text begins or ends.
    anchor : {"start", "end"}
        Whether the text begins or ends there.
    from_x, from_y : float
        Where the target would have appeared on this detector without compression.
    """

    text: str
    name: str
    kind: str
    x: float
    y: float
    radius: float
    text_x: float
    anchor: str
    from_x: float = math.nan
    from_y: float = math.nan

    @property
    def arrow(self) -> bool:
        """Whether compression moved the mark by more than its own circle."""
        return math.hypot(self.x - self.from_x, self.y - self.from_y) > self.radius


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
    radius = _radius_mm(target.volume_mm3) / gantry.pixel_mm
    # Beside the mark towards the nipple, where a breast has least; back where the picture ends.
    left_breast = gantry.view.laterality == "L"
    row, column = gantry.project(gantry.gantry_from_breast(target.place_mm)).tolist()
    rightwards = x + radius * 3.0 < gantry.columns if left_breast else x - radius * 3.0 < 0.0
    return Marker(
        text="N" if target.kind == "nipple" else str(target.target_id),
        name=target.name,
        kind=target.kind,
        x=x,
        y=y,
        radius=radius,
        text_x=x + radius * 1.25 if rightwards else x - radius * 1.25,
        anchor="start" if rightwards else "end",
        from_x=column + 0.5,
        from_y=row + 0.5,
    )


def _radius_mm(volume_mm3: float) -> float:
    """Radius of a circle around a lesion: the sphere of its volume and a margin."""
    if not math.isfinite(volume_mm3):
        return _LEAST_RADIUS_MM
    sphere = (3.0 * max(volume_mm3, 0.0) / (4.0 * math.pi)) ** (1.0 / 3.0)
    return max(_LEAST_RADIUS_MM, sphere + _MARGIN_MM)


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
        y) and `arrows` (view's number, view, x, y, dx, dy), in mm from the nipple; x towards the
        patient's left, which is the viewer's right, and y **down**, as in SVG.
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
    return {
        "extent": count * _RING_MM + 8.0,
        "rings": [_RING_MM * (ring + 1) for ring in range(count)],
        "dots": list(dots.values()),
        "arrows": arrows,
        "views": list(rows),
    }
