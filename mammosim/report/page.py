"""The report: one self-contained page that opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from mammosim._wording import counted
from mammosim.report.appearance import MEASURES
from mammosim.report.facts import compression_rows, exposure_rows, lesions_seen
from mammosim.report.glance import glance
from mammosim.report.hanging import ReportedView, hanging, hanging_order, targets_of
from mammosim.report.lesion_shift import shift_section
from mammosim.report.markers import shift_arrows
from mammosim.report.quantities import NOT_KNOWN
from mammosim.report.settings import ReportSettings
from mammosim.report.slices import slice_stacks
from mammosim.report.templates import template
from mammosim.targets import LesionShiftResults, Target

_SIDES = {"L": "Left breast", "R": "Right breast"}
_STATUS = {
    "not converged": "This run did not converge: the compression stopped before it reached its "
    "tolerance. What follows is what was reached; do not rely on positions or forces.",
    "interrupted": "This run was interrupted. What follows is what had been reached.",
}


def render_report(
    views: Sequence[ReportedView],
    targets: Sequence[Target],
    record: Mapping[str, Any],
    settings: ReportSettings | None = None,
    title: str = "",
    answers: LesionShiftResults | None = None,
) -> str:
    """Make the report's page.

    Parameters
    ----------
    views : sequence of ReportedView
        Views of one or both breasts; may be empty where a run stopped early.
    targets : sequence of Target
        Rows of lesions.csv.
    record : mapping
        What `run_record` returned.
    settings : ReportSettings, optional
    title : str
        Name of the run, as the configuration's.
    answers : LesionShiftResults, optional
        Rules between views, biopsy and uncertainty.

    Returns
    -------
    str
        HTML with its style, pictures and script inside; nothing is loaded from elsewhere.
    """
    settings = settings or ReportSettings()
    ordered = sorted(views, key=hanging_order)
    lesions = lesions_seen([view.compressed.view for view in ordered], targets)
    return template("template.html").render(
        title=title,
        headline=_headline(ordered),
        case=_case(ordered, lesions),
        status=_STATUS.get(record.get("status", "done"), ""),
        warnings=_warnings(ordered, record),
        hanging=hanging(ordered, targets, settings),
        glance=glance(ordered, targets, answers or LesionShiftResults()),
        stacks=slice_stacks(ordered, targets),
        lesions=lesions,
        shift_views=_shift_views(ordered, targets),
        shift=shift_section(ordered, targets, answers or LesionShiftResults(), settings),
        view_names=[view.compressed.view.folder for view in ordered],
        compression=compression_rows([view.compressed for view in ordered]),
        convergence=_convergence(ordered),
        exposed=[view.compressed.view.folder for view in ordered if view.mammogram],
        realism=_realism_rows(ordered),
        appearance=_appearance_rows(ordered),
        exposure=exposure_rows([view.mammogram for view in ordered if view.mammogram]),
        record=record,
        settings_text=json.dumps(record.get("settings"), indent=2, ensure_ascii=False, default=str),
        not_known=NOT_KNOWN,
    )


def _headline(views: Sequence[ReportedView]) -> str:
    if not views:
        return "Simulated mammography"
    sides = dict.fromkeys(_SIDES[view.compressed.view.laterality] for view in views)
    names = dict.fromkeys(view.compressed.view.name for view in views)
    breast = "Both breasts" if len(sides) == 2 else next(iter(sides))
    return f"{breast}, {' and '.join(names)}"


def _case(views: Sequence[ReportedView], lesions: Sequence[dict[str, Any]]) -> str:
    """The case in one line."""
    if not views:
        return "No view was computed."
    parts = [views[0].compressed.phantom.source or "phantom of unknown source"]
    thicknesses = [
        f"{view.compressed.view.folder} {view.compressed.thickness_mm:.1f} mm" for view in views
    ]
    parts.append("compressed to " + ", ".join(thicknesses))
    mammograms = [view.mammogram for view in views if view.mammogram]
    if mammograms:
        first = mammograms[0]
        parts.append(f"{first.target}/{first.filter} {first.kvp:g} kV")
    count = sum(entry["first"].is_lesion for entry in lesions)
    parts.append(counted(count, "lesion") if count else "no lesion")
    return " · ".join(parts)


def _warnings(views: Sequence[ReportedView], record: Mapping[str, Any]) -> list[str]:
    """Every warning once: the record's own, the phantom's and each view's."""
    found: list[str] = list(record.get("warnings", ()))
    for view in views:
        found += view.compressed.phantom.notes
        found += view.compressed.notes
        found += view.mammogram.notes if view.mammogram else ()
    return list(dict.fromkeys(found))


def _shift_views(views: Sequence[ReportedView], targets: Sequence[Target]) -> list[dict[str, Any]]:
    """The frontal drawing of each breast: where targets were, and where each view moved them."""
    drawings = []
    for side in dict.fromkeys(view.compressed.view.laterality for view in views):
        of_side = [view.compressed for view in views if view.compressed.view.laterality == side]
        rows = {
            compressed.view.folder: [
                row for row in targets_of(compressed.view, targets) if row.kind != "nipple"
            ]
            for compressed in of_side
        }
        if any(rows.values()):
            drawing = shift_arrows(rows, of_side[0].phantom.nipple_mm)
            drawings.append({"side": _SIDES[side], **drawing})
    return drawings


def _convergence(views: Sequence[ReportedView]) -> list[tuple[str, int, Markup]]:
    """Name, number of rows and drawing of each view that has a history."""
    drawn = []
    for view in views:
        if view.convergence:
            # Drawn by matplotlib from column names and numbers, which it escapes itself.
            svg, rows = Markup(view.convergence), len(view.compressed.history)
            drawn.append((view.compressed.view.folder, rows, svg))
    return drawn


def _realism_rows(views: Sequence[ReportedView]) -> list[dict[str, Any]]:
    """One row a quantity, with what each exposed view has of it."""
    of_view = [view.findings for view in views if view.mammogram]
    return [
        {"name": row[0].name, "unit": row[0].unit, "source": row[0].source, "findings": row}
        for row in zip(*of_view, strict=True)
    ]


def _appearance_rows(views: Sequence[ReportedView]) -> list[dict[str, Any]]:
    """One row a measure, with what each exposed view has of it; None where it has no range."""
    of_view = [view.appearance for view in views if view.mammogram]
    return [
        {"name": measure.name, "unit": measure.unit, "findings": [f.get(key) for f in of_view]}
        for key, measure in MEASURES.items()
        if any(key in f for f in of_view)
    ]
