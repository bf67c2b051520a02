"""Pictures on the page: window, zoom and marks for all that are shown together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from mammosim.report import Picture, SavedImage, hang_saved, marks_svg

FIT_VH = 68
"""Largest height of a picture that is not enlarged, in hundredths of the window's."""


@dataclass(frozen=True)
class Shown:
    """One picture in a row.

    Parameters
    ----------
    name : str
        Of its view, or of its run where runs are compared.
    image : SavedImage
    """

    name: str
    image: SavedImage


class Wall:
    """Rows of pictures with one window, level and zoom for all of them.

    Parameters
    ----------
    rows : sequence of (str, sequence of Shown)
        Heading of each row, and its pictures.
    """

    def __init__(self, rows: Sequence[tuple[str, Sequence[Shown]]]) -> None:
        self._images: list[tuple[Any, str]] = []
        self._frames: list[tuple[Any, float]] = []
        self._marks: list[Any] = []
        with ui.row().classes("items-center w-full gap-x-4 gap-y-0"):
            self._level = _slider("Level", (0.0, 1.0, 0.02), 0.5)
            self._width = _slider("Window width", (0.05, 1.0, 0.05), 1.0)
            self._zoom = _slider("Zoom", (1.0, 6.0, 0.25), 1.0)
            marked = ui.checkbox("Lesions", value=True)
        hung = iter(hang_saved([shown.image for _, row in rows for shown in row]))
        for heading, row in rows:
            if heading:
                ui.label(heading).props("role=heading aria-level=3").classes("text-subtitle1")
            with ui.element("div").classes("mammosim walls w-full"):
                for shown in row:
                    self._add(heading, shown, next(hung))
        ui.label(
            "Circles: lesions. Crosses: nipple and landmarks. An arrow starts where the same "
            "tissue would have appeared without compression. Bar: 2 cm at the breast support."
        ).classes("soft text-caption")
        self._enlarge()
        for slider in (self._level, self._width):
            slider.on_value_change(self._window)
        self._zoom.on_value_change(self._enlarge)
        marked.on_value_change(lambda change: self._mark(bool(change.value)))

    def _add(self, heading: str, shown: Shown, picture: Picture) -> None:
        crop, (rows, columns) = picture.crop, shown.image.for_presentation.shape
        with ui.element("figure").classes("view"):
            enlarged = ui.element("div").classes("enlarged")
            enlarged.props["tabindex"], enlarged.props["role"] = 0, "region"
            enlarged.props["aria-label"] = f"{heading} {shown.name}, enlarged by Zoom".strip()
            with enlarged, ui.element("svg") as frame:
                frame.props["viewBox"] = f"{crop.left} {crop.top} {crop.columns} {crop.rows}"
                frame.props["role"], frame.props["aria-label"] = "img", picture.alt
                image = ui.element("image")
                image.props["href"] = _address(picture.uri, 0.5, 1.0)
                image.props["width"], image.props["height"] = columns, rows
                image.props["preserveAspectRatio"] = "none"
                self._marks.append(ui.html(marks_svg(picture), sanitize=False, tag="g"))
            with ui.element("figcaption"):
                ui.label(f"{shown.name}  {picture.technique}")
        self._images.append((image, picture.uri))
        self._frames.append((frame, crop.columns / crop.rows))

    def _window(self) -> None:
        for image, address in self._images:
            image.props["href"] = _address(address, self._level.value, self._width.value)
            image.update()

    def _enlarge(self) -> None:
        zoom = float(self._zoom.value)
        for frame, aspect in self._frames:
            fitting = f"min(100%, {FIT_VH * aspect:.2f}vh)"
            frame.style(f"width: calc({zoom:g} * {fitting}); aspect-ratio: {aspect:.4f}")

    def _mark(self, shown: bool) -> None:
        for marks in self._marks:
            marks.visible = shown


def _address(uri: str, level: float, width: float) -> str:
    return f"{uri}?level={level:g}&width={width:g}"


def _slider(label: str, span: tuple[float, float, float], value: float) -> ui.slider:
    """A slider with its label; the span is its minimum, maximum and step."""
    low, high, step = span
    with ui.row().classes("items-center gap-2 no-wrap"):
        ui.label(label).classes("text-caption")
        slider = ui.slider(min=low, max=high, step=step, value=value)
    return slider.classes("w-24").props(f'aria-label="{label}"')
