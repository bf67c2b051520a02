"""From one or two pixels of a finished run back to the uncompressed breast."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.pipeline.locate.saved_views import SavedView, read_views
from mammosim.targets import (
    ImagePoint,
    Located,
    RayCurve,
    curve_of,
    point_at_height,
    point_from_image_points,
)


@dataclass(frozen=True, eq=False)
class LocatedInRun:
    """What one or two pixels of a run show.

    Parameters
    ----------
    image_points : tuple of ImagePoint
        The pixels, in the order given.
    found : Located or RayCurve
        A point, or for one pixel without a height the curve of all points on its ray.
    nipple_mm : ndarray, (3,)
        Nipple of the uncompressed breast, breast frame, mm.
    not_converged : tuple of str
        Views whose compression did not converge.
    """

    image_points: tuple[ImagePoint, ...]
    found: Located | RayCurve
    nipple_mm: NDArray[np.float64]
    not_converged: tuple[str, ...]


def locate_in_run(
    run: str | PathLike[str],
    views: Sequence[str],
    pixels: Sequence[tuple[float, float]],
    tube_angles_deg: Sequence[float] | None = None,
    height_mm: float | None = None,
    step_mm: float = 5.0,
) -> LocatedInRun:
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

    Returns
    -------
    LocatedInRun

    Raises
    ------
    InputError
        If the arguments do not go together, the run lacks a file, or a pixel is outside the
        breast.
    """
    _check(views, pixels, tube_angles_deg, height_mm)
    saved = read_views(run, views)
    _check_breast(saved)
    angles = tube_angles_deg or [0.0] * len(views)
    image_points = tuple(
        saved[name].image_point(*at, angle)
        for name, at, angle in zip(views, pixels, angles, strict=True)
    )
    found: Located | RayCurve
    if len(image_points) > 1:
        found = point_from_image_points(image_points)
    elif height_mm is not None:
        found = point_at_height(image_points[0], height_mm)
    else:
        found = curve_of(image_points[0], step_mm)
    lost = tuple(name for name, view in saved.items() if not view.converged)
    return LocatedInRun(image_points, found, saved[views[0]].nipple_mm, lost)


def _check_breast(saved: Mapping[str, SavedView]) -> None:
    """Refuse pictures of two breasts: they show no point in common."""
    sides = {view.gantry.view.laterality for view in saved.values()}
    if len(sides) > 1:
        raise InputError(
            f"locate: found {' and '.join(saved)}, which show two breasts; expected views of one"
        )


def _check(
    views: Sequence[str],
    pixels: Sequence[tuple[float, float]],
    tube_angles_deg: Sequence[float] | None,
    height_mm: float | None,
) -> None:
    problems = []
    if len(views) != len(pixels):
        problems.append(
            f"locate: found {len(views)} views and {len(pixels)} pixels, expected one each"
        )
    if len(views) not in (1, 2):
        problems.append(f"locate: found {len(views)} views, expected one or two")
    if tube_angles_deg and len(tube_angles_deg) != len(views):
        problems.append(
            f"locate: found {len(tube_angles_deg)} tube angles and {len(views)} views, expected "
            "one each"
        )
    if height_mm is not None and len(views) > 1:
        problems.append(
            "locate: a height can be given for one view only; two images determine the height"
        )
    if problems:
        raise InputError(problems)
