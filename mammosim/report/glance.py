"""The page's first lists: lesion shift, thickness and dose, and uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from mammosim.report.facts import lesions_seen
from mammosim.report.hanging import ReportedView, dose_text
from mammosim.targets import LesionShiftResults, ShiftUncertainty, Target

MAX_LESIONS = 6
"""Lesions in the list; the table has all."""


@dataclass(frozen=True)
class Line:
    """One line of a list: a name and what is said about it."""

    name: str
    text: str


@dataclass(frozen=True)
class Glance:
    """Three lists beside the pictures.

    Parameters
    ----------
    moved, dose, sure : tuple of Line
    more : int
        Number of lesions that are not in `moved`.
    """

    moved: tuple[Line, ...]
    dose: tuple[Line, ...]
    sure: tuple[Line, ...]
    more: int


def glance(
    views: Sequence[ReportedView], targets: Sequence[Target], answers: LesionShiftResults
) -> Glance:
    """Gather the lists; views are in the page's order."""
    seen = [view.compressed.view for view in views]
    lesions = [entry for entry in lesions_seen(seen, targets) if entry["first"].is_lesion]
    moved = [_moved(entry) for entry in lesions[:MAX_LESIONS]]
    dose = [_dose(view) for view in views]
    sure = [_equilibrium(view) for view in views]
    sure += _spread(lesions, answers.uncertainty)
    return Glance(tuple(moved), tuple(dose), tuple(sure), max(0, len(lesions) - MAX_LESIONS))


def _moved(entry: dict[str, Any]) -> Line:
    parts = [
        f"{name} {target.shift_mm:.0f} mm" + ("" if target.in_field else " (not in the picture)")
        for name, target in entry["of_view"].items()
    ]
    return Line(f"{entry['number']} {entry['first'].name}", ", ".join(parts))


def _dose(view: ReportedView) -> Line:
    compressed, mammogram = view.compressed, view.mammogram
    parts = [f"{compressed.thickness_mm:.1f} mm thick"]
    force = compressed.measures.get("force_n", math.nan)
    if math.isfinite(force):
        parts.append(f"{force:.0f} N")
    parts.append(dose_text(mammogram) if mammogram else "no image was made")
    return Line(compressed.view.folder, ", ".join(parts))


def _equilibrium(view: ReportedView) -> Line:
    compressed = view.compressed
    if not compressed.converged:
        return Line(compressed.view.folder, "did not converge: do not rely on it")
    largest = compressed.error_mm[1]
    text = "converged"
    if math.isfinite(largest):
        text = f"at most {max(largest, 0.01):.2f} mm from equilibrium"
    off = compressed.measures.get("height_error_mm", math.nan)
    if math.isfinite(off):
        distance = "less than 0.1" if off < 0.1 else f"about {off:.1f}"
        text += f"; plates {distance} mm off balance"
    return Line(compressed.view.folder, text)


def _spread(
    lesions: Sequence[dict[str, Any]], uncertainty: Sequence[ShiftUncertainty]
) -> list[Line]:
    """The longest semi-axis of each lesion's ellipsoid, or that it was not asked for."""
    if not uncertainty:
        return [
            Line("Spread of stiffness, thickness and plates",
                 "not computed; targets.uncertainty gives it in mm")
        ]  # fmt: skip
    shown = {entry["first"].target_id for entry in lesions[:MAX_LESIONS]}
    return [
        Line(f"{row.name}, {row.view}", f"within {row.long_mm:.0f} mm with 95 % probability")
        for row in uncertainty
        if row.target_id in shown
    ]
