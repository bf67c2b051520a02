"""How a solver converged: a drawing into Matplotlib's axes, and as SVG text for the page."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim.report.figures import drawing_svg

_COLOURS = ("#3b82c4", "#c2742d", "#4f9a5b", "#a55fa5")  # legible on white and on near-black


class Line(NamedTuple):
    """One quantity over the rows of a history: its name, their numbers from 1, and its values."""

    label: str
    rows: NDArray[np.intp]
    values: NDArray[Any]


def convergence_svg(history: NDArray[np.void], name: str) -> str:
    """Draw how a solver converged.

    Parameters
    ----------
    history : ndarray, structured
        One row an iteration.
    name : str
        Name of the view; keeps the drawing's internal names apart from others on the page.

    Returns
    -------
    str
        SVG whose text and axes take the colour of the text around it; empty if there is nothing
        to draw.
    """
    if not convergence_lines(history):
        return ""

    def draw(axes: Any) -> None:
        draw_convergence(axes, history)
        axes.grid(axis="y", alpha=0.25)

    return drawing_svg(draw, name, (4.6, 2.7))


def draw_convergence(axes: Any, history: NDArray[np.void]) -> None:
    """Draw a line for each quantity that tells of convergence, on a logarithmic scale."""
    for line, colour in zip(convergence_lines(history), _COLOURS, strict=False):
        axes.semilogy(line.rows, line.values, color=colour, linewidth=1.5, label=line.label)
    axes.set_xlabel("row of convergence.csv")
    axes.yaxis.set_major_formatter("{x:g}")  # powers of ten take longer to lay out than the rest
    axes.yaxis.set_minor_formatter("")
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
