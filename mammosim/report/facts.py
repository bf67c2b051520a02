"""Facts about a breast, its compression, its exposure and its lesions, as rows of tables.

The report's page and the notebook print the same rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.geometry import View
from mammosim.phantom import LESION_KINDS, BreastPhantom, PhantomSummary, phantom_summary
from mammosim.report.hanging import ReportedView, targets_of
from mammosim.report.quantities import number, quantity
from mammosim.targets import Target

Row = tuple[str, str, list[str]]
"""Label, unit, and one text per column."""


def breast_rows(phantom: BreastPhantom) -> list[Row]:
    """Rows about an uncompressed breast."""
    summary = phantom_summary(phantom)
    sizes = " × ".join(f"{high - low:.0f}" for low, high in summary.extent_mm)
    return [
        ("Side", "", [{"L": "left", "R": "right"}[summary.laterality]]),
        ("Size: anterior × across × height", "mm", [sizes]),
        ("Voxels", "", [" × ".join(str(count) for count in summary.shape)]),
        ("Voxel size", "mm", [" × ".join(number(float(step)) for step in summary.voxel_mm)]),
        ("Volume without muscle", "mL", [number(summary.breast_ml, 0)]),
        ("Gland in the volume within the skin", "%", [number(summary.fibroglandular_percent, 1)]),
        ("Lesions", "", [_lesion_names(summary)]),
        ("Source", "", [summary.source or "not known"]),
    ]


def _lesion_names(summary: PhantomSummary) -> str:
    names = [
        f"{lesion.name} ({LESION_KINDS[lesion.kind].title.lower()})" for lesion in summary.lesions
    ]
    return ", ".join(names) or "none"


def compression_rows(compressed: Sequence[CompressedBreast]) -> list[Row]:
    """One text per view: the plates first, then the result's own measures."""
    rows = [
        ("Mechanical model", "", [one.model for one in compressed]),
        ("Converged", "", [number(one.converged) for one in compressed]),
        ("Compressed thickness", "mm", [number(one.thickness_mm, 1) for one in compressed]),
    ]
    standing = [one.phantom.muscle_standing for one in compressed]
    if min(standing, default=1.0) < 1.0:
        rows.append(
            ("Muscle's distance from the chest wall", "", [_of_oblique(s) for s in standing])
        )
    return rows + _measure_rows([one.measures for one in compressed])


def _of_oblique(standing: float) -> str:
    """How far a view has the muscle stand off the chest wall."""
    return (
        "as in the phantom"
        if standing == 1.0
        else f"{standing:g} of that in oblique views (assumed)"
    )


def exposure_rows(mammograms: Sequence[Mammogram]) -> list[Row]:
    """One text per view: the technique, then what was measured on the image."""
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


def main_rows(views: Sequence[ReportedView]) -> list[Row]:
    """One text per view: the main numbers."""
    taken = [view.mammogram for view in views]
    forces = [view.compressed.measures.get("force_n") for view in views]
    return [
        ("Compressed thickness", "mm", [number(view.compressed.thickness_mm, 1) for view in views]),
        ("Force on the paddle", "N", [number(force, 1) for force in forces]),
        ("Tube load", "mAs", [number(m.mas if m else None, 1) for m in taken]),
        ("Mean glandular dose", "mGy", [number(m.dose_mgy if m else None, 2) for m in taken]),
    ]


def _measure_rows(columns: Sequence[Mapping[str, float]]) -> list[Row]:
    """One row per key of any of the mappings, in the order of first appearance."""
    keys = dict.fromkeys(key for column in columns for key in column)
    return [quantity(key, [column.get(key) for column in columns]) for key in keys]


def lesions_seen(seen: Sequence[View], targets: Sequence[Target]) -> list[dict[str, Any]]:
    """One entry per target of each breast: its number, its kind, and its row in each view."""
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
    """Of a ball of the lesion's volume; NaN for a group of calcifications."""
    clustered = target.is_lesion and LESION_KINDS[target.kind].clustered
    if clustered or not target.volume_mm3 > 0.0:
        return math.nan
    return (6.0 * target.volume_mm3 / math.pi) ** (1.0 / 3.0)
