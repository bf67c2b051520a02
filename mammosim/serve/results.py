"""What a run's folder holds, for the page: views, pictures through a window, tables, files."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mammosim.config import read_text
from mammosim.export import read_geometry, read_lesions
from mammosim.pipeline import STAGES_FOLDER, read_record
from mammosim.report import SavedImage, number, planes_page, targets_of
from mammosim.targets import Target

MAX_ROWS = 3000
"""Largest height of a picture on the page; the files hold every pixel."""

_PICTURE = "for_presentation.png"
_BLOCK_BYTES = 1 << 20
"""Bytes of a file that are put into an archive at a time."""


def runs_in(folder: Path) -> list[Path]:
    """Folders of runs, the latest first."""
    found = [path.parent for path in folder.glob("*/run.json")]
    return sorted(found, key=lambda run: (run / "run.json").stat().st_mtime, reverse=True)


def record_of(run: Path) -> dict[str, Any]:
    """The run's record; read again only once it has changed; empty where there is none."""
    with suppress(OSError):
        return _record_at(run, (run / "run.json").stat().st_mtime_ns)
    return {}


@lru_cache(maxsize=256)
def _record_at(run: Path, written_ns: int) -> dict[str, Any]:
    return read_record(run)


def status_of(run: Path) -> str:
    """How a run ended, as its record says."""
    return str(record_of(run).get("status", "unknown"))


def views_of(run: Path) -> list[str]:
    """Views that have a picture."""
    return sorted(path.parent.name for path in run.glob(f"*/{_PICTURE}"))


def images_of(run: Path) -> dict[str, SavedImage]:
    """The pictures with their targets and geometry, by view.

    Raises
    ------
    InputError
        If the table of lesions or a view's geometry cannot be read.
    """
    targets = targets_in(run)
    facts = record_of(run).get("views", {})
    found = {}
    for view in views_of(run):
        gantry = read_geometry(run / view / "geometry.json")
        found[view] = SavedImage(
            gantry, _pixels(run, view), targets_of(gantry.view, targets),
            _technique(facts.get(view, {})), f"/picture/{run.name}/{view}",
        )  # fmt: skip
    return found


def _technique(facts: dict[str, Any]) -> str:
    units = (("thickness_mm", "mm"), ("force_n", "N"), ("dose_mgy", "mGy"))
    return " · ".join(
        f"{number(facts[key], 2 if key == 'dose_mgy' else 1)} {unit}"
        for key, unit in units
        if facts.get(key) is not None
    )


def _pixels(run: Path, view: str) -> NDArray[np.uint16]:
    path = run / view / _PICTURE
    return _pixels_at(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _pixels_at(path: Path, written_ns: int) -> NDArray[np.uint16]:
    with Image.open(path) as opened:
        return np.asarray(opened).astype(np.uint16)


def picture_jpeg(run: Path, view: str, level: float, width: float) -> bytes:
    """A view's For Presentation image through a window, as JPEG.

    Parameters
    ----------
    run : Path
    view : str
    level, width : float
        Centre and width of the window, as fractions of the image's own window.
    """
    stored = _pixels(run, view)
    factor = max(1, -(-len(stored) // MAX_ROWS))  # every how many pixels one is shown
    grey = np.arange(65536) / 65535.0
    shown = np.clip((grey - level) / max(width, 0.01) + 0.5, 0.0, 1.0)
    window = np.rint(255.0 * shown).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(window[stored[::factor, ::factor]]).save(stream, "JPEG", quality=88)
    return stream.getvalue()


def targets_in(run: Path) -> list[Target]:
    """Rows of `lesions.csv`; none where the run has no such table."""
    path = run / "lesions.csv"
    return read_lesions(path) if path.is_file() else []


def histories_of(run: Path) -> dict[str, list[dict[str, Any]]]:
    """Rows of each view's `convergence.csv`, by view, with the numbers that are known."""
    found = {}
    for path in sorted(run.glob("*/convergence.csv")):
        rows = csv.DictReader(io.StringIO(read_text(path)))
        found[path.parent.name] = [
            {key: value for key, cell in row.items() if (value := _known(cell)) is not None}
            for row in rows
        ]
    return found


def _known(cell: str | None) -> float | None:
    with suppress(ValueError):
        return float(cell) if cell else None
    return None


def planes_of(run: Path) -> str:
    """The slider from uncompressed to compressed, as a page; empty where it was not reported."""
    path = run / "report.html"
    return planes_page(read_text(path)) if path.is_file() else ""


def files_of(run: Path) -> list[str]:
    """Files to download, by their path in the run's folder."""
    return sorted(
        path.relative_to(run).as_posix()
        for path in run.rglob("*")
        if path.is_file() and STAGES_FOLDER not in path.parts and not path.name.startswith(".")
    )


def zip_of(run: Path) -> Iterator[bytes]:
    """All files of a run as one ZIP archive, in pieces; most are compressed already."""
    sink = _Sink()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_STORED) as archive:
        for name in files_of(run):
            entry = zipfile.ZipInfo.from_file(run / name, f"{run.name}/{name}")
            with (run / name).open("rb") as source, archive.open(entry, "w") as target:
                while block := source.read(_BLOCK_BYTES):
                    target.write(block)
                    yield sink.taken()
            yield sink.taken()
    yield sink.taken()


class _Sink(io.RawIOBase):
    """What is written to it, to be taken away piece by piece."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._parts.append(bytes(data))
        return len(self._parts[-1])

    def taken(self) -> bytes:
        whole = b"".join(self._parts)
        self._parts.clear()
        return whole


def warnings_of(run: Path) -> list[str]:
    """The record's warnings."""
    found = record_of(run).get("warnings", [])
    return [str(one) for one in found] if isinstance(found, list) else []
