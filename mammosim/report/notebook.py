"""How results show themselves in a notebook: small pictures, and the facts in a table."""

from __future__ import annotations

from collections.abc import Sequence

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.report.facts import (
    Row,
    breast_rows,
    compression_rows,
    exposure_rows,
    lesions_seen,
    main_rows,
)
from mammosim.report.figures import jpeg_data_uri
from mammosim.report.hanging import ReportedView, hang_one, hanging, hanging_order
from mammosim.report.sections import breast_sections, moved_sections
from mammosim.report.settings import ReportSettings
from mammosim.report.templates import template
from mammosim.targets import Target

PICTURE_ROWS = 420
"""Height that mammograms are reduced to: about 30 kB each in the notebook's file."""

_SETTINGS = ReportSettings(picture_rows=PICTURE_ROWS)


def breast_html(phantom: BreastPhantom) -> str:
    """Three sections of an uncompressed breast, and its facts, for a notebook.

    Parameters
    ----------
    phantom : BreastPhantom

    Returns
    -------
    str
        HTML that stands on its own: pictures are data URIs of small JPEGs.
    """
    sections = [
        (plane.caption, [jpeg_data_uri(grey)]) for plane, _, grey in breast_sections(phantom)
    ]
    return _filled("Breast phantom", breast_rows(phantom), sections=sections)


def compressed_html(compressed: CompressedBreast) -> str:
    """Three sections before and after compression, and its facts, for a notebook.

    Parameters
    ----------
    compressed : CompressedBreast

    Returns
    -------
    str
        HTML that stands on its own, notes of the compression included.
    """
    sections = [
        (f"{plane.caption}: before, compressed", [jpeg_data_uri(grey) for grey in greys])
        for plane, _, greys in moved_sections(compressed, (0.0, 1.0))
    ]
    rows = compression_rows([compressed])
    title = f"{compressed.view.folder}, compressed"
    return _filled(title, rows, sections=sections, notes=compressed.notes)


def mammogram_html(mammogram: Mammogram) -> str:
    """The image, and how it was taken, for a notebook.

    Parameters
    ----------
    mammogram : Mammogram

    Returns
    -------
    str
        HTML that stands on its own: the For Presentation image, reduced, and a table of voltage,
        load, dose and the like.
    """
    picture = hang_one(mammogram, _SETTINGS)
    title = f"{mammogram.gantry.view.folder}, mammogram"
    rows = exposure_rows([mammogram])
    return _filled(title, rows, wall=[{"single": [picture]}], notes=mammogram.notes)


def study_html(views: Sequence[ReportedView], targets: Sequence[Target]) -> str:
    """All mammograms with their lesions, each lesion's shift, and the main numbers.

    Parameters
    ----------
    views : sequence of ReportedView
        In any order; they are hung as a reader hangs them.
    targets : sequence of Target
        Lesions, nipple and landmarks of all views.

    Returns
    -------
    str
        HTML that stands on its own.
    """
    ordered = sorted(views, key=hanging_order)
    seen = [view.compressed.view for view in ordered]
    rows = main_rows(ordered)
    return _filled(
        "Study", rows, names=[view.folder for view in seen],
        wall=hanging(ordered, targets, _SETTINGS), lesions=lesions_seen(seen, targets),
    )  # fmt: skip


def _filled(title: str, rows: Sequence[Row], **parts: object) -> str:
    """The template with the parts given; the others stay empty."""
    values = {"names": [""], "sections": (), "wall": (), "lesions": (), "notes": (), **parts}
    return template("notebook.html").render(title=title, rows=rows, **values)
