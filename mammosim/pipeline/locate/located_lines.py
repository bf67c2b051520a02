"""What `mammosim locate` answers, in lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.pipeline.locate.saved_views import read_views
from mammosim.targets import (
    Located,
    RayCurve,
    Sight,
    clock_position,
    curve_of,
    point_at_height,
    point_from_sights,
)

SAME_LESION_MM = 3.0
"""On the detector; a reader marks a lesion's middle to a few mm (assumed)."""


def locate_lines(
    run: str | PathLike[str],
    views: Sequence[str],
    pixels: Sequence[tuple[float, float]],
    tube_angles_deg: Sequence[float] | None = None,
    height_mm: float | None = None,
    step_mm: float = 5.0,
) -> list[str]:
    """Go from one or two pixels of a run back to the uncompressed breast.

    Parameters
    ----------
    run : path
        A finished run's folder.
    views : sequence of str
        View of each pixel, as `CC`; one or two.
    pixels : sequence of (row, column)
    tube_angles_deg : sequence of float, optional
        Angle of the tube in each picture, degrees.
    height_mm : float, optional
        Height above the breast support, for one pixel.
    step_mm : float
        Distance along z of the points of the curve that one pixel gives without a height.

    Raises
    ------
    InputError
        If the options do not go together, the run lacks a file, or a pixel is outside the breast.
    """
    _check(views, pixels, tube_angles_deg, height_mm)
    saved = read_views(run, views)
    angles = tube_angles_deg or [0.0] * len(views)
    sights = [
        saved[name].sight(*at, angle) for name, at, angle in zip(views, pixels, angles, strict=True)
    ]
    nipple_mm = saved[views[0]].nipple_mm
    lines = [
        f"note: the compression of {name} did not converge"
        for name, view in saved.items()
        if not view.converged
    ]
    if len(sights) > 1:
        return lines + _point(point_from_sights(sights), sights, nipple_mm)
    if height_mm is not None:
        return lines + _point(point_at_height(sights[0], height_mm), sights, nipple_mm)
    return lines + _curve(curve_of(sights[0], step_mm), nipple_mm)


def _check(
    views: Sequence[str],
    pixels: Sequence[tuple[float, float]],
    tube_angles_deg: Sequence[float] | None,
    height_mm: float | None,
) -> None:
    problems = []
    if len(views) != len(pixels):
        problems.append(
            f"locate: found {len(views)} --view and {len(pixels)} --pixel, expected one each"
        )
    if len(views) not in (1, 2):
        problems.append(f"locate: found {len(views)} --view, expected one or two")
    if tube_angles_deg and len(tube_angles_deg) != len(views):
        problems.append(
            f"locate: found {len(tube_angles_deg)} --tube-angle and {len(views)} --view, expected "
            "one each"
        )
    if height_mm is not None and len(views) > 1:
        problems.append("locate: --height-mm goes with one --view; two pictures give the height")
    if problems:
        raise InputError(problems)


def _point(found: Located, sights: Sequence[Sight], nipple_mm: NDArray[np.float64]) -> list[str]:
    x, y, z = found.point_mm
    lines = [
        f"uncompressed: x {x:.2f}, y {y:.2f}, z {z:.2f} mm (anterior, patient's left, superior)",
        f"{clock_position(found.point_mm, nipple_mm)}, "
        f"{np.linalg.norm(found.point_mm - nipple_mm):.1f} mm from the nipple",
    ]
    for sight, height, misfit in zip(sights, found.height_mm, found.misfit_mm, strict=True):
        line = f"{sight.what}: {height:.2f} mm above the breast support"
        if len(sights) > 1:
            line += f"; the point's image is {misfit:.2f} mm from the pixel"
        lines.append(line)
    if max(found.misfit_mm) > SAME_LESION_MM:
        lines.append(
            f"note: no point is within {SAME_LESION_MM:g} mm of both pixels; do they show the same "
            "thing?"
        )
    return lines


def _curve(curve: RayCurve, nipple_mm: NDArray[np.float64]) -> list[str]:
    lines = ["height mm      x mm      y mm      z mm   clock  from nipple mm"]
    for height, point in zip(curve.height_mm, curve.point_mm, strict=True):
        place = "".join(f"{value:10.2f}" for value in point)
        distance = float(np.linalg.norm(point - nipple_mm))
        lines.append(f"{height:9.1f}{place}{clock_position(point, nipple_mm):>8}{distance:16.1f}")
    return [
        *lines,
        "uncompressed breast: x anterior, y patient's left, z superior; height above the breast "
        "support while compressed",
    ]
