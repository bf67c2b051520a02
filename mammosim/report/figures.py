"""The report's pictures: mammograms as data URIs, and drawings as SVG text."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mammosim.acquisition import Mammogram
from mammosim.report.crop import Crop

_JPEG_QUALITY = 88  # no visible blocks in noise; a quarter of the size of a PNG
_INK = "#010203"  # stands for the page's text colour, which the figure cannot know
_STYLE = Lock()
"""Matplotlib's style is one for all threads; pages are drawn on several."""


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
    import matplotlib as mpl  # half a second of start-up
    from matplotlib.figure import Figure

    style = {
        "svg.fonttype": "none", "svg.hashsalt": name, "font.size": 9, "font.family": "sans-serif",
        "text.color": _INK, "axes.edgecolor": _INK, "axes.labelcolor": _INK, "xtick.color": _INK,
        "ytick.color": _INK, "axes.spines.top": False, "axes.spines.right": False,
    }  # fmt: skip
    with _STYLE, mpl.rc_context(style):
        figure = Figure(figsize=inches, layout="constrained")
        draw(figure.subplots())
        stream = io.StringIO()
        figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :].replace(_INK, "currentColor")
    # The ids, and the references to them.
    return re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)
