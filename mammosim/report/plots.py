"""Results drawn with matplotlib, for notebooks and scripts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.phantom import BreastPhantom
from mammosim.report.convergence import draw_convergence
from mammosim.report.hanging import ReportedView, targets_of
from mammosim.report.markers import markers
from mammosim.report.sections import Box, Plane, breast_sections, middle_mm, moved_sections
from mammosim.targets import Target

_MARK = "#ffd95a"
_ARROW = "#ff9d4d"
_ARROWS = 16
"""Arrows along the longer side of a section."""


def plot_breast(
    phantom: BreastPhantom, through_mm: ArrayLike | None = None, axes: Any = None
) -> Any:
    """Draw three sections; see `BreastPhantom.plot`.

    Parameters
    ----------
    phantom : BreastPhantom
    through_mm : array_like, (3,), optional
        Point that the sections go through, breast frame, mm; default: the middle that the
        report's sections have too.
    axes : array of matplotlib axes, (3,), optional
        Default: a new figure.

    Returns
    -------
    ndarray of matplotlib axes, (3,)
    """
    through = None if through_mm is None else np.asarray(through_mm, dtype=float)
    axes = _axes(axes, (1, 3), (10.0, 4.0)).ravel()
    for one, (plane, box, grey) in zip(axes, breast_sections(phantom, through), strict=True):
        _show(one, plane, box, grey)
        _mark(one, plane, [lesion.position_mm for lesion in phantom.lesions])
    return axes


def plot_compressed(compressed: CompressedBreast, what: str = "planes", axes: Any = None) -> Any:
    """Draw a compression; see `CompressedBreast.plot`.

    Parameters
    ----------
    compressed : CompressedBreast
    what : str
        ``planes``, ``displacement`` or ``convergence``.
    axes : matplotlib axes, optional
        Default: a new figure.

    Returns
    -------
    matplotlib axes, or an array of them

    Raises
    ------
    InputError
        If `what` is another word.
    """
    draw = {"planes": _planes, "displacement": _displacement, "convergence": _convergence}
    if what not in draw:
        raise InputError(f"what: found '{what}', expected one of {', '.join(draw)}")
    return draw[what](compressed, axes)


def plot_mammogram(
    mammogram: Mammogram,
    targets: Sequence[Target] = (),
    window: tuple[float, float] | None = None,
    axes: Any = None,
) -> Any:
    """Draw the image and its lesions; see `Mammogram.plot`.

    Parameters
    ----------
    mammogram : Mammogram
    targets : sequence of Target
        Those of other views are left out.
    window : (float, float), optional
        Centre and width in stored grey values; default: the image's own.
    axes : matplotlib axes, optional
        Default: a new figure.

    Returns
    -------
    matplotlib axes
        Rows and columns of the image, counted from the centre of the upper left pixel.
    """
    axes = _axes(axes, (1, 1), (5.0, 7.0)).ravel()[0]
    centre, width = window or (mammogram.window_center, mammogram.window_width)
    axes.imshow(mammogram.for_presentation, cmap="gray", vmin=centre - 0.5 * width,
                vmax=centre + 0.5 * width, interpolation="antialiased")  # fmt: skip
    axes.set(title=mammogram.gantry.view.folder, xlabel="column, pixels", ylabel="row, pixels")
    for mark in markers(targets_of(mammogram.gantry.view, targets), mammogram.gantry):
        place = (mark.x - 0.5, mark.y - 0.5)  # pixels count from their centres here
        axes.plot(*place, "o", markersize=12, markerfacecolor="none", markeredgecolor=_MARK)
        axes.annotate(mark.name, place, xytext=(8, 6), textcoords="offset points", color=_MARK)
    return axes


def plot_study(views: Sequence[ReportedView], targets: Sequence[Target], axes: Any = None) -> Any:
    """Draw all mammograms and their lesions; see `Study.plot`.

    Parameters
    ----------
    views : sequence of ReportedView
        Those without a mammogram are left out.
    targets : sequence of Target
        Lesions, nipple and landmarks of all views.
    axes : array of matplotlib axes, one per mammogram, optional
        Default: a new figure.

    Returns
    -------
    ndarray of matplotlib axes, one per mammogram

    Raises
    ------
    InputError
        If no view has a mammogram.
    """
    taken = [view.mammogram for view in views if view.mammogram is not None]
    if not taken:
        raise InputError("plot: the study has no mammogram")
    axes = _axes(axes, (1, len(taken)), (4.5 * len(taken), 6.0)).ravel()
    for one, mammogram in zip(axes, taken, strict=True):
        plot_mammogram(mammogram, targets, axes=one)
    return axes


def _planes(compressed: CompressedBreast, axes: Any) -> Any:
    """Sections before (upper row) and after (lower row)."""
    axes = _axes(axes, (2, 3), (10.0, 7.0))
    places = [lesion.position_mm for lesion in compressed.phantom.lesions]
    ends = list(places + compressed.displacement_at(places)) if places else []
    sections = moved_sections(compressed, (0.0, 1.0))
    for column, (plane, box, greys) in zip(axes.T, sections, strict=True):
        for one, grey, shown in zip(column, greys, (places, ends), strict=True):
            _show(one, plane, box, grey)
            _mark(one, plane, shown)
    axes[0, 0].set_ylabel("before, mm")
    axes[1, 0].set_ylabel(f"compressed for {compressed.view.folder}, mm")
    return axes


def _displacement(compressed: CompressedBreast, axes: Any) -> Any:
    """Arrows over sections before compression, from where tissue was to where it is."""
    axes = _axes(axes, (1, 3), (12.0, 4.5)).ravel()
    through = middle_mm(compressed.phantom)
    for one, (plane, box, (seen,)) in zip(axes, moved_sections(compressed, (0.0,)), strict=True):
        _show(one, plane, box, seen)
        step = max(1, round(max(seen.shape) / _ARROWS))
        middle = (slice(step // 2, None, step),) * 2
        place = box.centres_mm[middle][seen[middle] > 0]
        shift = plane.project(compressed.displacement_at(plane.points(place, through)))
        one.quiver(*place.T, *shift.T, color=_ARROW, angles="xy", scale_units="xy", scale=1.0,
                   width=0.006)  # fmt: skip
    return axes


def _convergence(compressed: CompressedBreast, axes: Any) -> Any:
    axes = _axes(axes, (1, 1), (5.5, 3.5)).ravel()[0]
    draw_convergence(axes, compressed.history)
    axes.set_title(compressed.view.folder)
    return axes


def _axes(axes: Any, shape: tuple[int, int], inches: tuple[float, float]) -> NDArray[Any]:
    """The axes that were given as an array, or those of a new figure."""
    if axes is None:
        import matplotlib.pyplot as plt  # a second of start-up

        _, axes = plt.subplots(*shape, figsize=inches, squeeze=False, layout="constrained")
    given = np.asarray(axes, dtype=object)
    if given.size != shape[0] * shape[1]:
        raise InputError(f"axes: found {given.size}, expected {shape[0] * shape[1]}")
    return given.reshape(shape)


def _show(axes: Any, plane: Plane, box: Box, grey: NDArray[np.uint8]) -> None:
    extent = (box.left, box.left + box.width, box.top + box.height, box.top)
    axes.imshow(grey, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
    axes.set(title=f"{plane.name}, {plane.caption}", xlabel="mm")
    axes.yaxis.set_major_formatter(lambda down, _: f"{0.0 - down:g}")  # mm up


def _mark(axes: Any, plane: Plane, places_mm: Sequence[NDArray[np.float64]]) -> None:
    """Circle places, also those in front of the plane or behind it."""
    if len(places_mm):
        right, down = plane.project(np.asarray(places_mm)).T
        axes.plot(right, down, "o", markersize=9, markerfacecolor="none", markeredgecolor=_MARK)
