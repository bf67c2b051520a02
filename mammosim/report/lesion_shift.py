"""What the page says about the lesions' shift: drawings, rules, biopsy, and how sure it is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from mammosim.phantom import Posture
from mammosim.report.hanging import ReportedView, targets_of
from mammosim.report.planes import FRAMES, Drawing, drawings
from mammosim.report.settings import ReportSettings
from mammosim.report.solid import plotly_gzip_base64, solid
from mammosim.targets import BiopsyResult, LesionShiftResults, RuleError, ShiftUncertainty, Target


@dataclass(frozen=True)
class PosturePlace:
    """Where a target lies when only weight holds the breast, and how sure that is.

    Parameters
    ----------
    row : BiopsyResult
    spread : ShiftUncertainty or None
        None where no samples were asked for.
    """

    row: BiopsyResult
    spread: ShiftUncertainty | None


@dataclass(frozen=True)
class ShiftSection:
    """The page's section on the shift.

    Parameters
    ----------
    drawings : dict of str to list of Drawing
        By the view's folder.
    data : dict
        What the page's script draws: the frames of the slider, and the 3-D view.
    library : str
        Packed plotly.js; empty without a 3-D view.
    rules : tuple of RuleError
    biopsy : tuple of BiopsyResult
    postures : tuple of PosturePlace
    uncertainty : tuple of ShiftUncertainty
    """

    drawings: dict[str, list[Drawing]]
    data: dict[str, Any]
    library: str
    rules: tuple[RuleError, ...]
    biopsy: tuple[BiopsyResult, ...]
    postures: tuple[PosturePlace, ...]
    uncertainty: tuple[ShiftUncertainty, ...]


def shift_section(
    views: Sequence[ReportedView],
    targets: Sequence[Target],
    answers: LesionShiftResults,
    settings: ReportSettings,
) -> ShiftSection:
    """Gather the section; views without rows in the table are drawn without targets."""
    drawn, data = {}, {}
    for view in views:
        here = targets_of(view.compressed.view, targets)
        name = view.compressed.view.folder
        drawn[name] = drawings(view.sections, here)
        data[name] = {
            "planes": [_frames(drawing) for drawing in drawn[name]],
            "solid": solid(view.skin, here) if settings.three_d else None,
        }
    library = plotly_gzip_base64() if settings.three_d and drawn else ""
    return ShiftSection(
        drawn, {"views": data, "last": FRAMES - 1}, library, answers.rules, answers.biopsy,
        posture_places(answers), answers.uncertainty,
    )  # fmt: skip


def posture_places(answers: LesionShiftResults) -> tuple[PosturePlace, ...]:
    """Targets of a biopsy or operation in a posture, each with the spread of its place."""
    spreads = {(row.target_id, row.view): row for row in answers.uncertainty}
    return tuple(
        PosturePlace(row, spreads.get((row.target_id, f"{row.view} {row.biopsy_view}")))
        for row in answers.biopsy
        if row.biopsy_view in get_args(Posture)
    )


def _frames(drawing: Drawing) -> dict[str, Any]:
    """Pictures of one drawing for the slider; the ends are in the page already."""
    return {
        "name": drawing.plane.name,
        "caption": drawing.plane.caption,
        "box": _rounded((drawing.left, drawing.top, drawing.width, drawing.height)),
        "dot": round(drawing.dot_mm, 2),
        "frames": list(drawing.frames),
        "targets": [
            [
                t.label.text,
                t.name,
                t.kind,
                *_rounded((t.x, t.y, t.to_x, t.to_y)),
                _rounded((t.label.x, t.label.y, t.label.size)),
                _rounded(t.label.lead),
            ]
            for t in drawing.targets
        ],
    }


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(value, 2) for value in values]
