"""The paddle that settings describe: which part of the breast it covers, and how it is tilted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.lattice import Lattice
from mammosim.compression.plates.solids import Panel
from mammosim.compression.settings import PaddleSettings
from mammosim.errors import InputError
from mammosim.geometry import View


def panel_of(paddle: PaddleSettings | None, edge_mm: float) -> Panel | None:
    """The panel of some settings, x counted from the plates' edge; None for a straight paddle.

    Parameters
    ----------
    paddle : PaddleSettings, optional
    edge_mm : float
        Breast-frame x of the plates' edge, mm.
    """
    if paddle is None:
        return None
    depth, width = paddle.size_mm
    x, y = paddle.centre_mm or (edge_mm + 0.5 * depth, 0.0)
    back, hinge, angle = x - 0.5 * depth - edge_mm, 0.5 * depth, 0.0
    if paddle.tilt is not None:
        hinge = hinge if paddle.tilt.hinge_mm is None else paddle.tilt.hinge_mm
        angle = paddle.tilt.angle_deg or 0.0
    return Panel(back, back + depth, y - 0.5 * width, y + 0.5 * width, back + hinge, angle)


def tissue_beyond_edge(lattice: Lattice, edge_mm: float) -> NDArray[np.bool_]:
    """Tissue in front of the plates' edge at rest, [x, y, z].

    Parameters
    ----------
    lattice : Lattice
    edge_mm : float
        Breast-frame x of the edge, mm.
    """
    return lattice.tissue & (lattice.frame.axis_mm(0) > edge_mm)[:, None, None]


def covered_tissue(
    lattice: Lattice, edge_mm: float, panel: Panel | None, view: View
) -> NDArray[np.bool_]:
    """Tissue under or over a paddle at rest, [x, y, z].

    Parameters
    ----------
    lattice : Lattice
    edge_mm : float
        Breast-frame x of the plates' edge, mm.
    panel : Panel, optional
        None: the paddle covers all in front of its edge.
    view : View

    Raises
    ------
    InputError
        If a paddle lies behind the plates' edge or beside the breast.
    """
    ahead = tissue_beyond_edge(lattice, edge_mm)
    if panel is None:
        return ahead
    x, y = lattice.frame.axis_mm(0), lattice.frame.axis_mm(1)
    back, front = edge_mm + panel.back_mm, edge_mm + panel.front_mm
    found = (
        f"compression.paddle: found one from x = {back:.1f} to {front:.1f} mm and from "
        f"y = {panel.low_mm:.1f} to {panel.high_mm:.1f} mm"
    )
    if panel.back_mm < -1e-6:
        raise InputError(
            f"{found}; it must not reach behind the plates' edge at x = {edge_mm:.1f} mm"
        )
    along_x, along_y = (x > back) & (x < front), (y > panel.low_mm) & (y < panel.high_mm)
    covered = ahead & along_x[:, None, None] & along_y[None, :, None]
    if not covered.any():
        ends = [np.flatnonzero(ahead.any(axis=axes)) for axes in ((1, 2), (0, 2))]
        (x0, x1), (y0, y1) = (
            places[some[[0, -1]]] for places, some in zip((x, y), ends, strict=True)
        )
        raise InputError(
            f"{found}, beside the breast, which extends from x = {x0:.1f} to {x1:.1f} mm and from "
            f"y = {y0:.1f} to {y1:.1f} mm in {view.name}"
        )
    return covered
