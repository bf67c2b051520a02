"""Tables of one run, and of several side by side, as HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from mammosim.report import key_in_words, number, number_table_html, quantity, text_table_html
from mammosim.serve.form import as_text
from mammosim.serve.results import record_of, targets_in
from mammosim.targets import Target

MAIN_KEYS = (
    "thickness_mm", "force_n", "pressure_kpa", "contact_area_mm2", "volume_change_percent",
    "inverted_cells", "smallest_j", "kvp", "mas", "dose_mgy", "dose_of_all_projections_mgy",
    "scatter_to_primary_ratio", "volumetric_density_percent",
)  # fmt: skip
"""Numbers of a view that the page shows; the report has all."""

LESION_KEYS = ("shift_mm", "image_nipple_distance_mm", "sdnr")
"""Numbers of a lesion in a view that runs are compared by."""

MISSING = "not set"
"""In place of a setting that one of the runs does not have."""


def views_table(run: Path) -> str:
    """Main numbers of each view."""
    views = record_of(run).get("views", {})
    return number_table_html("Views", list(views), _main_rows(list(views.values())))


def lesions_table(run: Path) -> str:
    """Where each target was and how far it moved, one row for each view."""
    columns = ("Name", "No.", "Kind", "View", "Shift, mm", "x, mm", "y, mm", "z, mm",
               "From nipple, mm", "Under skin, mm", "In the picture")  # fmt: skip
    rows = [
        (t.name, "N" if t.kind == "nipple" else str(t.target_id), t.kind, t.laterality + t.view,
         *(number(value, 1) for value in (t.shift_mm, t.x_mm, t.y_mm, t.z_mm,
                                          t.nipple_distance_mm, t.skin_depth_mm)),
         number(t.in_field))
        for t in targets_in(run)
    ]  # fmt: skip
    caption = (
        "Where each lesion was, and how far it moved. Before compression, breast frame: "
        "x anterior, y to the patient's left, z superior."
    )
    return text_table_html(caption, columns, rows) if rows else ""


def compared_settings(runs: Sequence[Path]) -> str:
    """Settings in which runs differ, as they were resolved; empty where they are the same."""
    settings = [dict(_flat(record_of(run).get("settings", {}), "")) for run in runs]
    keys = dict.fromkeys(key for one in settings for key in one)
    rows = []
    for key in keys:
        texts = [as_text(one[key]) if key in one else MISSING for one in settings]
        if len(set(texts)) > 1:
            rows.append((f"{key_in_words(key)} ({key})", *texts))
    names = ("Setting", *(run.name for run in runs))
    return text_table_html("Settings in which the runs differ", names, rows) if rows else ""


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every setting by its path, as messages write it."""
    if isinstance(value, Mapping) and value:
        parts: Iterator[tuple[Any, Any]] = iter(value.items())
    elif isinstance(value, list) and any(isinstance(one, dict | list) for one in value):
        parts = iter(enumerate(value))
    else:
        yield path, value
        return
    for key, inner in parts:
        yield from _flat(inner, f"{path}.{key}" if path else str(key))


def compared_views(runs: Sequence[Path]) -> dict[str, str]:
    """A table of main numbers for each view, with one column per run."""
    of_run = [record_of(run).get("views", {}) for run in runs]
    names = [run.name for run in runs]
    return {
        view: number_table_html(view, names, _main_rows([one.get(view, {}) for one in of_run]))
        for view in dict.fromkeys(view for one in of_run for view in one)
    }


def compared_lesions(runs: Sequence[Path]) -> str:
    """Shift, place and visibility of each lesion, with one column per run."""
    of_run = [
        {(t.laterality + t.view, t.name): t for t in targets_in(run) if t.is_lesion} for run in runs
    ]
    rows = []
    for view, name in dict.fromkeys(place for one in of_run for place in one):
        for key in LESION_KEYS:
            words, unit, values = quantity(key, [_number(one.get((view, name)), key)
                                                 for one in of_run])  # fmt: skip
            rows.append((f"{name}, {view}: {_LESION_WORDS.get(key, words)}", unit, values))
    return number_table_html("Lesions", [run.name for run in runs], rows) if rows else ""


_LESION_WORDS = {
    "shift_mm": "shift",
    "image_nipple_distance_mm": "from nipple on the picture",
    "sdnr": "signal difference to noise",
}


def _number(target: Target | None, key: str) -> float | None:
    return None if target is None else float(getattr(target, key))


def _main_rows(views: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, list[str]]]:
    rows = [
        quantity(key, [view.get(key) for view in views])
        for key in MAIN_KEYS
        if any(view.get(key) is not None for view in views)
    ]
    told = [("Model", "model"), ("Converged", "converged")]
    return [(words, "", [number(view.get(key)) for view in views]) for words, key in told] + rows
