"""The report's pictures: mammograms as data URIs, and drawings as SVG text."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mammosim.acquisition import Mammogram
from mammosim.report.crop import Crop

_JPEG_QUALITY = 88  # no visible blocks in noise; a quarter of the size of a PNG
_INK = "#010203"  # stands for the page's text colour, which the figure cannot know
_LINES = ("#3b82c4", "#c2742d", "#4f9a5b", "#a55fa5")  # legible on white and on near-black


def picture_data_uri(mammogram: Mammogram, crop: Crop, rows: int) -> str:
    """The picture for reading through its window as a data URI.

    Parameters
    ----------
    mammogram : Mammogram
    crop : Crop
        Part to show.
    rows : int
        Height to reduce to, by whole factors; a smaller picture keeps its pixels.

    Returns
    -------
    str
        ``data:image/jpeg;base64,...``
    """
    down = slice(crop.top, crop.top + crop.rows)
    across = slice(crop.left, crop.left + crop.columns)
    factor = max(1, round(crop.rows / rows))
    pixels = block_means(mammogram.for_presentation[down, across], factor)
    half = (mammogram.window_width - 1.0) / 2.0
    middle = mammogram.window_center - 0.5  # DICOM's linear window, PS3.3 C.11.2.1.2.1
    grey = np.rint(np.interp(pixels, [middle - half, middle + half], [0.0, 255.0]))
    return jpeg_data_uri(grey.astype(np.uint8))


def jpeg_data_uri(grey: NDArray[np.uint8]) -> str:
    """A grey picture as ``data:image/jpeg;base64,...``."""
    stream = io.BytesIO()
    Image.fromarray(grey).save(stream, format="JPEG", quality=_JPEG_QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def block_means(pixels: NDArray[Any], factor: int) -> NDArray[np.float64]:
    """Mean of blocks of factor x factor pixels; the last ones are filled up by repetition."""
    missing = [(0, -size % factor) for size in pixels.shape]
    padded = np.pad(pixels, missing, mode="edge")
    rows, columns = (size // factor for size in padded.shape)
    return padded.reshape(rows, factor, columns, factor).mean(axis=(1, 3), dtype=np.float64)


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
    if not _lines_to_draw(history):
        return ""

    def draw(axes: Any) -> None:
        draw_convergence(axes, history)
        axes.grid(axis="y", color=_INK, alpha=0.12)

    return drawing_svg(draw, name, (4.6, 2.7))


def drawing_svg(draw: Callable[[Any], None], name: str, inches: tuple[float, float]) -> str:
    """A Matplotlib drawing as SVG text for a page, light or dark.

    Parameters
    ----------
    draw : callable
        Draws into the axes passed to it.
    name : str
        Prefix of the drawing's ids, which must differ from others on the page.
    inches : (float, float)
        Width and height.
    """
    import matplotlib as mpl  # a second of start-up
    from matplotlib.figure import Figure

    style = {
        "svg.fonttype": "none", "svg.hashsalt": name, "font.size": 9, "font.family": "sans-serif",
        "text.color": _INK, "axes.edgecolor": _INK, "axes.labelcolor": _INK, "xtick.color": _INK,
        "ytick.color": _INK, "axes.spines.top": False, "axes.spines.right": False,
    }  # fmt: skip
    with mpl.rc_context(style):
        figure = Figure(figsize=inches, layout="constrained")
        draw(figure.subplots())
        stream = io.StringIO()
        figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :].replace(_INK, "currentColor")
    # The ids, and the references to them.
    return re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)


def draw_convergence(axes: Any, history: NDArray[np.void]) -> None:
    """Draw a line for each quantity that tells of convergence, on a logarithmic scale."""
    for (label, rows, values), colour in zip(_lines_to_draw(history), _LINES, strict=False):
        axes.semilogy(rows, values, color=colour, linewidth=1.5, label=label)
    axes.set_xlabel("row of convergence.csv")
    if axes.lines:
        axes.legend(frameon=False, fontsize=8)


def _lines_to_draw(history: NDArray[np.void]) -> list[tuple[str, NDArray[Any], NDArray[Any]]]:
    """Label, row numbers from 1 and positive values of each line.

    A column of words, as the axis that an iteration worked on, makes a line of each word.
    """
    lines = []
    for column in _columns_to_draw(history):
        positive = np.asarray(history[column] > 0)
        for word, of_word in _parts(history):
            rows = np.flatnonzero(positive & of_word)
            if rows.size:
                label = " ".join((column.replace("_", " "), word)).strip()
                lines.append((label, rows + 1, history[column][rows]))
    return lines[: len(_LINES)]


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
