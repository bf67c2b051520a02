"""Parts of a report made from the files of finished runs, for a page that shows several."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from mammosim.geometry import Gantry
from mammosim.report.crop import common_crops
from mammosim.report.hanging import Picture, framed
from mammosim.report.markers import markers
from mammosim.report.templates import part, template
from mammosim.targets import Target

_SHIFT_DATA = re.compile(r'<script type="application/json" id="shift-data">(.*?)</script>', re.S)


@dataclass(frozen=True, eq=False)
class SavedImage:
    """A view's For Presentation image, read back from a run.

    Parameters
    ----------
    gantry : Gantry
    for_presentation : ndarray, [row, column]
        Grey levels; air is 0.
    targets : sequence of Target
        Of this view.
    technique : str
        Text below the picture.
    uri : str
        Address of the whole picture.
    """

    gantry: Gantry
    for_presentation: NDArray[Any]
    targets: Sequence[Target]
    technique: str
    uri: str


def hang_saved(images: Sequence[SavedImage]) -> list[Picture]:
    """Pictures of saved images with their marks, all at one scale.

    Parameters
    ----------
    images : sequence of SavedImage

    Returns
    -------
    list of Picture
        In the order of `images`, cropped to the breast; marks and crops are in pixels of the whole
        image, from its upper left corner.
    """
    marks = [markers(image.targets, image.gantry) for image in images]
    return [
        framed(image.gantry, image.targets, crop, image.technique, image.uri)
        for image, crop in zip(images, common_crops(images, marks), strict=True)
    ]


def marks_svg(picture: Picture) -> str:
    """The marks, name and scale bar of a picture.

    Parameters
    ----------
    picture : Picture

    Returns
    -------
    str
        SVG elements without an `svg` element around them, in pixels of the whole image.
    """
    return str(template("macros.html").module.marks(picture))  # type: ignore[attr-defined]


def number_table_html(
    caption: str, columns: Sequence[str], rows: Sequence[tuple[str, str, Sequence[str]]]
) -> str:
    """A table of quantities.

    Parameters
    ----------
    caption : str
    columns : sequence of str
        Headings of the values.
    rows : sequence of (str, str, sequence of str)
        Label, unit, and a value per column, each as it is printed.

    Returns
    -------
    str
        An HTML table; texts are escaped.
    """
    table = template("macros.html").module.number_table  # type: ignore[attr-defined]
    return str(table(caption, columns, rows))


def text_table_html(caption: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of texts.

    Parameters
    ----------
    caption : str
    columns : sequence of str
        Headings, the first one's above the rows' own.
    rows : sequence of sequence of str
        The first text of each row heads it.

    Returns
    -------
    str
        An HTML table; texts are escaped.
    """
    return str(template("macros.html").module.text_table(caption, columns, rows))  # type: ignore[attr-defined]


def pictures_css() -> str:
    """Style of pictures with their marks, as in the report.

    Returns
    -------
    str
        CSS rules, to be nested in that of the element around the pictures.
    """
    return part("pictures.css")


def planes_page(report: str) -> str:
    """A page with nothing but a report's slider from uncompressed to compressed.

    Parameters
    ----------
    report : str
        HTML of a run's report.

    Returns
    -------
    str
        HTML; empty where the report has no such slider.
    """
    found = _SHIFT_DATA.search(report)
    if found is None:
        return ""
    data = json.loads(found[1])
    for view in data["views"].values():
        view["solid"] = None
    return template("planes.html").render(data=data, view_names=list(data["views"]))
