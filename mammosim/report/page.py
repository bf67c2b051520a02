"""The report: one self-contained page that opens offline."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from mammosim.acquisition import Mammogram
from mammosim.phantom import LESION_KINDS
from mammosim.report.appearance import MEASURES
from mammosim.report.figures import convergence_svg
from mammosim.report.hanging import ReportedView, hanging, targets_of
from mammosim.report.lesion_shift import shift_section
from mammosim.report.markers import shift_arrows
from mammosim.report.quantities import NOT_KNOWN, number, quantity
from mammosim.report.realism import appearance_findings, realism
from mammosim.report.settings import ReportSettings
from mammosim.report.slices import slice_stacks
from mammosim.targets import ShiftAnswers, Target

_SIDES = {"L": "Left breast", "R": "Right breast"}
_VIEW_ORDER = ("CC", "MLO", "ML")
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
    answers: ShiftAnswers | None = None,
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
    answers : ShiftAnswers, optional
        Rules between views, biopsy and uncertainty.

    Returns
    -------
    str
        HTML with its style, pictures and script inside; nothing is loaded from elsewhere.
    """
    settings = settings or ReportSettings()
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                              lstrip_blocks=True, loader=FunctionLoader(_part))  # fmt: skip
    environment.filters["number"] = number
    ordered = sorted(views, key=_hanging_order)
    return environment.get_template("template.html").render(
        title=title,
        headline=_headline(ordered),
        case=_case(ordered, targets),
        status=_STATUS.get(record.get("status", "done"), ""),
        warnings=_warnings(ordered, record),
        hanging=hanging(ordered, targets, settings),
        stacks=slice_stacks(ordered, targets),
        lesions=_lesions(ordered, targets),
        shift_views=_shift_views(ordered, targets),
        shift=shift_section(ordered, targets, answers or ShiftAnswers(), settings),
        view_names=[view.squeezed.view.folder for view in ordered],
        compression=_compression_rows(ordered),
        convergence=_convergence(ordered),
        exposed=[view.squeezed.view.folder for view in ordered if view.mammogram],
        realism=_realism_rows(ordered),
        appearance=_appearance_rows(ordered),
        exposure=_exposure_rows([view.mammogram for view in ordered if view.mammogram]),
        record=record,
        settings_text=json.dumps(record.get("settings"), indent=2, ensure_ascii=False, default=str),
        not_known=NOT_KNOWN,
    )


def _part(name: str) -> str:
    """One of the page's files in this package."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _hanging_order(view: ReportedView) -> tuple[bool, int, int]:
    """CC above MLO above ML; right before left; views with a name of their own come last."""
    seen = view.squeezed.view
    return bool(seen.title), _VIEW_ORDER.index(seen.name), "RL".index(seen.laterality)


def _headline(views: Sequence[ReportedView]) -> str:
    if not views:
        return "Simulated mammography"
    sides = dict.fromkeys(_SIDES[view.squeezed.view.laterality] for view in views)
    names = dict.fromkeys(view.squeezed.view.name for view in views)
    breast = "Both breasts" if len(sides) == 2 else next(iter(sides))
    return f"{breast}, {' and '.join(names)}"


def _case(views: Sequence[ReportedView], targets: Sequence[Target]) -> str:
    """The case in one line."""
    if not views:
        return "No view was computed."
    parts = [views[0].squeezed.phantom.source or "phantom of unknown source"]
    thicknesses = [
        f"{view.squeezed.view.folder} {view.squeezed.thickness_mm:.1f} mm" for view in views
    ]
    parts.append("compressed to " + ", ".join(thicknesses))
    mammograms = [view.mammogram for view in views if view.mammogram]
    if mammograms:
        first = mammograms[0]
        parts.append(f"{first.target}/{first.filter} {first.kvp:g} kV")
    count = sum(entry["first"].is_lesion for entry in _lesions(views, targets))
    parts.append({0: "no lesion", 1: "1 lesion"}.get(count, f"{count} lesions"))
    return " · ".join(parts)


def _warnings(views: Sequence[ReportedView], record: Mapping[str, Any]) -> list[str]:
    """Every warning once: the record's own, the phantom's and each view's."""
    found: list[str] = list(record.get("warnings", ()))
    for view in views:
        found += view.squeezed.phantom.notes
        found += view.squeezed.notes
        found += view.mammogram.notes if view.mammogram else ()
    return list(dict.fromkeys(found))


def _lesions(views: Sequence[ReportedView], targets: Sequence[Target]) -> list[dict[str, Any]]:
    """One entry a target of each breast: its number, its kind, and its row in each view."""
    seen = [view.squeezed.view for view in views]
    sides = dict.fromkeys(view.laterality for view in seen)
    entries = []
    for side in sides:
        rows_of = {
            view.folder: {row.target_id: row for row in targets_of(view, targets)}
            for view in seen
            if view.laterality == side
        }
        for target_id in sorted({key for rows in rows_of.values() for key in rows}):
            of_view = {name: rows[target_id] for name, rows in rows_of.items() if target_id in rows}
            entries.append(_lesion(side if len(sides) > 1 else "", of_view))
    return entries


def _lesion(side: str, of_view: Mapping[str, Target]) -> dict[str, Any]:
    first = next(iter(of_view.values()))
    return {
        "number": f"{side} {first.target_id}".strip(),
        "first": first,
        "kind": LESION_KINDS[first.kind].title if first.is_lesion else first.kind.capitalize(),
        "diameter_mm": _ball_diameter_mm(first),
        "of_view": of_view,
    }


def _ball_diameter_mm(target: Target) -> float:
    """Of the ball of a lesion's volume; NaN for a group of calcifications, which is none."""
    clustered = target.is_lesion and LESION_KINDS[target.kind].clustered
    if clustered or not target.volume_mm3 > 0.0:
        return math.nan
    return (6.0 * target.volume_mm3 / math.pi) ** (1.0 / 3.0)


def _shift_views(views: Sequence[ReportedView], targets: Sequence[Target]) -> list[dict[str, Any]]:
    """The frontal drawing of each breast: where targets were, and where each view moved them."""
    drawings = []
    for side in dict.fromkeys(view.squeezed.view.laterality for view in views):
        of_side = [view.squeezed for view in views if view.squeezed.view.laterality == side]
        rows = {
            squeezed.view.folder: [
                row for row in targets_of(squeezed.view, targets) if row.kind != "nipple"
            ]
            for squeezed in of_side
        }
        if any(rows.values()):
            drawing = shift_arrows(rows, of_side[0].phantom.nipple_mm)
            drawings.append({"side": _SIDES[side], **drawing})
    return drawings


def _compression_rows(views: Sequence[ReportedView]) -> list[tuple[str, str, list[str]]]:
    """Label, unit and one text a view: the plates first, then the result's own measures."""
    rows = [
        ("Mechanical model", "", [view.squeezed.model for view in views]),
        ("Converged", "", [number(view.squeezed.converged) for view in views]),
        ("Compressed thickness", "mm", [number(view.squeezed.thickness_mm, 1) for view in views]),
    ]
    columns = [view.squeezed.measures for view in views]
    return rows + _measure_rows(columns)


def _measure_rows(columns: Sequence[Mapping[str, float]]) -> list[tuple[str, str, list[str]]]:
    """One row a key that any of the mappings has, in the order of first appearance."""
    keys = dict.fromkeys(key for column in columns for key in column)
    return [quantity(key, [column.get(key) for column in columns]) for key in keys]


def _convergence(views: Sequence[ReportedView]) -> list[tuple[str, int, Markup]]:
    """Name, number of rows and drawing of each view that has a history."""
    drawn = []
    for view in views:
        name = view.squeezed.view.folder
        svg = convergence_svg(view.squeezed.history, name)
        if svg:
            # Drawn by matplotlib from column names and numbers, which it escapes itself.
            drawn.append((name, len(view.squeezed.history), Markup(svg)))
    return drawn


def _exposure_rows(mammograms: Sequence[Mammogram]) -> list[tuple[str, str, list[str]]]:
    rows = [
        ("Anode / filter", "", [f"{m.target} / {m.filter} {m.filter_mm:g} mm" for m in mammograms]),
        ("Tube voltage", "kV", [number(m.kvp) for m in mammograms]),
        ("Tube load", "mAs", [number(m.mas, 1) for m in mammograms]),
        ("Half-value layer", "mm Al", [number(m.hvl_mm_al, 3) for m in mammograms]),
        ("Anti-scatter grid", "", [number(m.grid) for m in mammograms]),
        ("Incident air kerma", "mGy", [number(m.air_kerma_mgy, 2) for m in mammograms]),
        ("Mean glandular dose", "mGy", [number(m.dose_mgy, 2) for m in mammograms]),
    ]
    return rows + _measure_rows([m.measures for m in mammograms])


def _realism_rows(views: Sequence[ReportedView]) -> list[dict[str, Any]]:
    """One row a quantity, with what each exposed view has of it."""
    of_view = [realism(view.squeezed, view.mammogram) for view in views if view.mammogram]
    return [
        {"name": row[0].name, "unit": row[0].unit, "source": row[0].source, "findings": row}
        for row in zip(*of_view, strict=True)
    ]


def _appearance_rows(views: Sequence[ReportedView]) -> list[dict[str, Any]]:
    """One row a measure, with what each exposed view has of it; None where it has no range."""
    of_view = [
        appearance_findings(view.squeezed.view.name, view.mammogram)
        for view in views
        if view.mammogram
    ]
    return [
        {"name": measure.name, "unit": measure.unit, "findings": [f.get(key) for f in of_view]}
        for key, measure in MEASURES.items()
        if any(key in f for f in of_view)
    ]
