"""The part of a picture that shows the breast, at one scale for all views of one magnification."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import Gantry
from mammosim.report.markers import Marker

_MARGIN_MM = 15.0  # air around the skin line, and room for the view's name


class Shown(Protocol):
    """A For Presentation image and its geometry: a mammogram, or one read back from a run."""

    @property
    def gantry(self) -> Gantry:
        """Of the view."""

    @property
    def for_presentation(self) -> NDArray[Any]:
        """[row, column] grey levels; air is 0."""


@dataclass(frozen=True)
class Crop:
    """Part of a picture, in pixels.

    Parameters
    ----------
    top, left : int
        First row and column.
    rows, columns : int
        Size.
    """

    top: int
    left: int
    rows: int
    columns: int


def common_crops(mammograms: Sequence[Shown], marks: Sequence[Sequence[Marker]]) -> list[Crop]:
    """Crop all views of one magnification to one size in mm, so that they hang at one scale.

    Parameters
    ----------
    mammograms : sequence of Mammogram, or of images read back
    marks : sequence of sequence of Marker
        Marks of each, which stay inside.

    Returns
    -------
    list of Crop
        From the detector's chest-wall edge to beyond the nipple, centred on the breast's height.
        A picture without breast is not cropped.
    """
    spans = [_breast_mm(*pair) for pair in zip(mammograms, marks, strict=True)]
    # To a tenth: contact views count as alike.
    scales = [round(mammogram.gantry.magnification, 1) for mammogram in mammograms]
    crops = []
    for mammogram, (top, bottom, _), scale in zip(mammograms, spans, scales, strict=True):
        alike = [span for span, other in zip(spans, scales, strict=True) if other == scale]
        height_mm = max(end - start for start, end, _ in alike) + 2.0 * _MARGIN_MM
        depth_mm = max(depth for *_, depth in alike) + _MARGIN_MM
        crops.append(_crop(mammogram, (top + bottom) / 2.0, height_mm, depth_mm))
    return crops


def _breast_mm(mammogram: Shown, marks: Sequence[Marker]) -> tuple[float, float, float]:
    """First and last row of the breast, and its reach from the chest-wall edge, mm."""
    shown = mammogram.for_presentation > 0  # air is 0
    columns = shown.shape[1]
    rows_px = [*np.flatnonzero(shown.any(axis=1))[[0, -1]]] if shown.any() else [0, len(shown) - 1]
    columns_px = [*np.flatnonzero(shown.any(axis=0))[[0, -1]]] if shown.any() else [0, columns - 1]
    rows_px += [mark.y for mark in marks]
    columns_px += [mark.x for mark in marks]
    left_breast = mammogram.gantry.view.laterality == "L"
    depth_px = max(columns_px) + 1 if left_breast else columns - min(columns_px)
    pitch = mammogram.gantry.pixel_mm
    return min(rows_px) * pitch, (max(rows_px) + 1) * pitch, depth_px * pitch


def _crop(mammogram: Shown, middle_mm: float, height_mm: float, depth_mm: float) -> Crop:
    all_rows, all_columns = mammogram.for_presentation.shape
    pitch = mammogram.gantry.pixel_mm
    rows = min(all_rows, math.ceil(height_mm / pitch))
    columns = min(all_columns, math.ceil(depth_mm / pitch))
    top = min(max(0, round(middle_mm / pitch - rows / 2.0)), all_rows - rows)
    left = 0 if mammogram.gantry.view.laterality == "L" else all_columns - columns
    return Crop(top, left, rows, columns)
