"""What a run's folder holds, for the page: views, pictures through a window, tables, files."""

from __future__ import annotations

import csv
import io
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mammosim.pipeline import STAGES_FOLDER, read_record

MAX_ROWS = 1600
"""Largest height of a picture on the page; the files hold every pixel."""

_PICTURE = "for_presentation.png"


@dataclass(frozen=True)
class Mark:
    """A target on a picture, in fractions of its width and height, and its name."""

    name: str
    x: float
    y: float


def runs_in(folder: Path) -> list[Path]:
    """Folders of runs, the latest first."""
    found = [path.parent for path in folder.glob("*/run.json")]
    return sorted(found, key=lambda run: (run / "run.json").stat().st_mtime, reverse=True)


def status_of(run: Path) -> str:
    """How a run ended, as its record says; read again only once the record has changed."""
    with suppress(OSError):
        return _status_at(run, (run / "run.json").stat().st_mtime_ns)
    return "unknown"


@lru_cache(maxsize=1024)
def _status_at(run: Path, written_ns: int) -> str:
    return str(read_record(run).get("status", "unknown"))


def views_of(run: Path) -> list[str]:
    """Views that have a picture."""
    return sorted(path.parent.name for path in run.glob(f"*/{_PICTURE}"))


def picture_jpeg(run: Path, view: str, level: float, width: float) -> bytes:
    """A view's For Presentation image through a window, as JPEG.

    Parameters
    ----------
    run : Path
    view : str
    level, width : float
        Centre and width of the window, as fractions of the image's own window.
    """
    with Image.open(run / view / _PICTURE) as opened:
        factor = _reduction(opened.height)
        grey = np.asarray(opened)[::factor, ::factor] / 65535.0
    shown = np.clip((grey - level) / max(width, 0.01) + 0.5, 0.0, 1.0)
    stream = io.BytesIO()
    Image.fromarray(np.rint(255.0 * shown).astype(np.uint8)).save(stream, "JPEG", quality=88)
    return stream.getvalue()


def lesion_rows(run: Path) -> list[dict[str, str]]:
    """Rows of `lesions.csv`; none where the run has no such table."""
    path = run / "lesions.csv"
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def marks_of(run: Path, view: str) -> list[Mark]:
    """Targets that lie in a view's picture."""
    columns, rows = _size(run, view)
    return [
        Mark(row["name"], (float(row["image_col_px"]) + 0.5) / columns,
             (float(row["image_row_px"]) + 0.5) / rows)
        for row in lesion_rows(run)
        if row["laterality"] + row["view"] == view and row["in_field"] == "true"
    ]  # fmt: skip


def marks_svg(marks: list[Mark], columns: int, rows: int) -> str:
    """Circles and names over a picture of that size."""
    size = rows / 40.0
    parts = []
    for mark in marks:
        x, y = mark.x * columns, mark.y * rows
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" fill="none" stroke="#ffd95a" '
            f'stroke-width="{size / 8:.1f}"/><text x="{x + 1.3 * size:.1f}" y="{y:.1f}" '
            f'fill="#ffd95a" font-size="{size:.1f}">{escape(mark.name)}</text>'
        )
    return "".join(parts)


def shown_size(run: Path, view: str) -> tuple[int, int]:
    """Columns and rows of the picture as the page shows it."""
    columns, rows = _size(run, view)
    factor = _reduction(rows)
    return -(-columns // factor), -(-rows // factor)


def _size(run: Path, view: str) -> tuple[int, int]:
    with Image.open(run / view / _PICTURE) as opened:
        return opened.size


def _reduction(rows: int) -> int:
    """Every how many pixels one is shown."""
    return max(1, -(-rows // MAX_ROWS))


def facts_of(run: Path) -> list[dict[str, Any]]:
    """Main numbers of each view, from the record."""
    views = read_record(run).get("views", {})
    keys = ("model", "converged", "thickness_mm", "force_n", "mas", "dose_mgy")
    return [
        {"view": name, **{key: _rounded(view.get(key)) for key in keys}}
        for name, view in views.items()
    ]


def _rounded(value: Any) -> Any:
    return round(value, 2) if isinstance(value, float) else value


def files_of(run: Path) -> list[str]:
    """Files to download, by their path in the run's folder."""
    return sorted(
        path.relative_to(run).as_posix()
        for path in run.rglob("*")
        if path.is_file() and STAGES_FOLDER not in path.parts and not path.name.startswith(".")
    )


def warnings_of(run: Path) -> list[str]:
    """The record's warnings."""
    found = read_record(run).get("warnings", [])
    return [str(one) for one in found] if isinstance(found, list) else []
