"""Curves of a solver: how it converges, and beside it volume and folded cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

Rows = Mapping[str, Sequence[Mapping[str, Any]]]
"""Rows of the solver's history, by view."""

MAX_POINTS = 600
"""Points of a curve that are drawn: about one per pixel."""

VOLUME = {
    "volume_change_percent": "volume change, %",
    "smallest_j": "minimum volume ratio (J)",
    "inverted_cells": "folded cells",
}
"""Columns of the second drawing, and what they are called."""

LAST = {**VOLUME, "force_n": "force, N", "gap_mm": "gap, mm"}
"""Columns whose latest value is printed."""

_RESIDUALS = ("residual", "error", "move", "deviation", "out_of_balance")


class Curves:
    """Both drawings and the latest numbers; empty until `show` has something to draw."""

    def __init__(self) -> None:
        with ui.element("div").classes("curves w-full") as self._both:
            self._residual = _chart("residual", "log")
            self._volume = _chart("", "value")
        self._numbers = ui.label().classes("soft text-caption")

    def show(self, histories: Rows) -> None:
        """Draw the rows that there are."""
        residuals = [
            _series(view, key, key.replace("_", " "), rows, above=0.0)
            for view, rows in histories.items()
            for key in residual_columns(rows)
        ]
        volumes = [
            _series(view, key, words, rows)
            for view, rows in histories.items()
            for key, words in VOLUME.items()
            if rows and key in rows[-1]
        ]
        self._both.visible = bool(residuals)
        self._volume.visible = bool(volumes)
        for chart, series in ((self._residual, residuals), (self._volume, volumes)):
            if chart.options["series"] != series:
                chart.options["series"] = series
                chart.update()
        numbers = {view: latest_numbers(rows) for view, rows in histories.items() if rows}
        self._numbers.text = " · ".join(f"{view}: {text}" for view, text in numbers.items() if text)


def residual_columns(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """At most two columns that show convergence."""
    names = rows[0] if rows else {}
    return [key for key in names if any(word in key for word in _RESIDUALS)][:2]


def latest_numbers(rows: Sequence[Mapping[str, Any]]) -> str:
    """The last row's numbers in words."""
    last = rows[-1]
    return ", ".join(f"{words} {last[key]:.3g}" for key, words in LAST.items() if key in last)


def _series(
    view: str, key: str, words: str, rows: Sequence[Mapping[str, Any]], above: float | None = None
) -> dict[str, Any]:
    step = -(-len(rows) // MAX_POINTS) or 1
    points = [
        [place + 1, rows[place][key]]
        for place in range(0, len(rows), step)
        if key in rows[place] and (above is None or rows[place][key] > above)
    ]
    counted = {"yAxisIndex": 1} if key == "inverted_cells" else {}
    return {"type": "line", "name": f"{view} {words}", "data": points,
            "showSymbol": len(points) < 3,
            **counted}  # fmt: skip


def _chart(name: str, kind: str) -> Any:
    faint = {"lineStyle": {"color": "#8886"}}
    across = {"type": "value", "name": "row", "splitLine": {"show": False}, "minInterval": 1}
    up = {"type": kind, "name": name, "splitLine": faint, "scale": True}
    count = {
        "type": "value",
        "name": "folded cells",
        "splitLine": {"show": False},
        "minInterval": 1,
    }
    options: dict[str, Any] = {
        "xAxis": across, "yAxis": up if kind == "log" else [up, count], "animation": False,
        "legend": {"type": "scroll", "top": 0}, "series": [], "tooltip": {"trigger": "axis"},
        "grid": {"left": 56, "right": 56, "top": 56, "bottom": 32},
    }  # fmt: skip
    words = "Convergence of the solver" if kind == "log" else "Volume and folded cells"
    chart = ui.echart(options, renderer="svg").classes("h-64")
    return chart.props(f'role=img aria-label="{words}; the latest numbers are below"')
