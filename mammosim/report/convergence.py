"""How a solver converged: a drawing for the page, as SVG text, and one for Matplotlib's axes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_COLOURS = ("#3b82c4", "#c2742d", "#4f9a5b", "#a55fa5")  # legible on white and on near-black

_WIDTH, _HEIGHT = 331.0, 194.0
_LEFT, _RIGHT, _BOTTOM = 40.0, 321.0, 158.0
"""Size of the drawing, and where its axes are, in its own units; text is 9 of them high."""

_LEGEND_ROW, _LEGEND_COLUMNS = 12.0, 2
_MOST_ROWS, _MOST_DECADES = 6, 7
"""Ticks along either axis, at most."""


class Line(NamedTuple):
    """One quantity over the rows of a history: its name, their numbers from 1, and its values."""

    label: str
    rows: NDArray[np.intp]
    values: NDArray[Any]


def convergence_svg(history: NDArray[np.void]) -> str:
    """Draw how a solver converged.

    Parameters
    ----------
    history : ndarray, structured
        One row an iteration.

    Returns
    -------
    str
        SVG whose text and axes take the colour of the text around it; empty if there is nothing
        to draw.
    """
    lines = convergence_lines(history)
    if not lines:
        return ""
    top = 10.0 + _LEGEND_ROW * -(-len(lines) // _LEGEND_COLUMNS)
    values = np.concatenate([line.values for line in lines]).astype(float)
    low, high = math.floor(math.log10(values.min())), math.ceil(math.log10(values.max()))
    high = max(high, low + 1)
    last = max(int(max(line.rows[-1] for line in lines)), 2)
    across, up = (_RIGHT - _LEFT) / (last - 1), (_BOTTOM - top) / (high - low)

    def drawn(line: Line) -> str:
        x = _LEFT + (line.rows - 1) * across
        y = _BOTTOM - (np.log10(line.values.astype(float)) - low) * up
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    parts = [
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" xmlns="http://www.w3.org/2000/svg" '
        'font-size="9" fill="currentColor">',
        *_legend(lines),
        *_decades(low, high, up),
        *_row_numbers(last, across),
        f'<path d="M{_LEFT:g} {top:.1f}V{_BOTTOM:g}H{_RIGHT:g}" fill="none" '
        'stroke="currentColor" stroke-width="0.8"/>',
        f'<text x="{0.5 * (_LEFT + _RIGHT):g}" y="{_HEIGHT - 6:g}" text-anchor="middle">'
        "row of convergence.csv</text>",
    ]
    for line, colour in zip(lines, _COLOURS, strict=False):
        parts.append(
            f'<polyline points="{drawn(line)}" fill="none" stroke="{colour}" stroke-width="1.5" '
            'stroke-linejoin="round" stroke-linecap="round"/>'
        )
    return "".join([*parts, "</svg>"])


def _legend(lines: Sequence[Line]) -> Iterator[str]:
    """Name and colour of each line, above the axes."""
    for number, (line, colour) in enumerate(zip(lines, _COLOURS, strict=False)):
        x = _LEFT + (_RIGHT - _LEFT) / _LEGEND_COLUMNS * (number % _LEGEND_COLUMNS)
        y = 10.0 + _LEGEND_ROW * (number // _LEGEND_COLUMNS)
        yield f'<path d="M{x:.1f} {y - 3:.1f}h14" stroke="{colour}" stroke-width="1.5"/>'
        yield f'<text x="{x + 18:.1f}" y="{y:.1f}">{escape(line.label)}</text>'


def _decades(low: int, high: int, up: float) -> Iterator[str]:
    """Powers of ten along the logarithmic axis, with their lines across."""
    step = -(-(high - low) // _MOST_DECADES)
    for power in range(low, high + 1, step):
        y = _BOTTOM - (power - low) * up
        yield (
            f'<path d="M{_LEFT:g} {y:.1f}H{_RIGHT:g}" stroke="currentColor" opacity="0.12"/>'
            f'<text x="{_LEFT - 5:g}" y="{y + 3:.1f}" text-anchor="end">10<tspan dy="-4" '
            f'font-size="6.5">{power}</tspan></text>'.replace(">-", ">\u2212")
        )


def _row_numbers(last: int, across: float) -> Iterator[str]:
    """Numbers of rows along the other axis: multiples of 1, 2 or 5 times a power of ten."""
    rough = last / _MOST_ROWS
    power = 10 ** max(math.floor(math.log10(rough)), 0)
    step = next(part * power for part in (1, 2, 5, 10) if part * power >= rough)
    for row in range(step, last + 1, step):
        x = _LEFT + (row - 1) * across
        yield (
            f'<path d="M{x:.1f} {_BOTTOM:g}v3" stroke="currentColor" stroke-width="0.8"/>'
            f'<text x="{x:.1f}" y="{_BOTTOM + 14:g}" text-anchor="middle">{row}</text>'
        )


def draw_convergence(axes: Any, history: NDArray[np.void]) -> None:
    """Draw the same lines into Matplotlib's axes."""
    for line, colour in zip(convergence_lines(history), _COLOURS, strict=False):
        axes.semilogy(line.rows, line.values, color=colour, linewidth=1.5, label=line.label)
    axes.set_xlabel("row of convergence.csv")
    if axes.lines:
        axes.legend(frameon=False, fontsize=8)


def convergence_lines(history: NDArray[np.void]) -> list[Line]:
    """The quantities that tell of convergence, as far as they are positive and finite.

    A column of words, as the axis that an iteration worked on, makes a line of each word.
    """
    lines = []
    for column in _columns_to_draw(history):
        # An error that is not known yet is infinite.
        drawable = np.asarray(history[column] > 0) & np.isfinite(history[column])
        for word, of_word in _parts(history):
            rows = np.flatnonzero(drawable & of_word)
            if rows.size:
                label = " ".join((column.replace("_", " "), word)).strip()
                lines.append(Line(label, rows + 1, history[column][rows]))
    return lines[: len(_COLOURS)]


def _parts(history: NDArray[np.void]) -> list[tuple[str, NDArray[np.bool_]]]:
    """Each word of the first column of words and its rows; without one, all rows."""
    for name in history.dtype.names or ():
        if history.dtype[name].kind == "U":
            return [(str(word), history[name] == word) for word in np.unique(history[name])]
    return [("", np.ones(history.shape, bool))]


def _columns_to_draw(history: NDArray[np.void]) -> list[str]:
    """Names of floating-point columns; if there are any, only those that tell of convergence."""
    names = [name for name in history.dtype.names or () if history.dtype[name].kind == "f"]
    telling = ("residual", "error", "change", "move", "update", "deviation", "out_of_balance")
    return [name for name in names if any(word in name for word in telling)] or names
