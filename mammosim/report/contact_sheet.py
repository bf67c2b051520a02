"""Small pictures of a cohort's first patients, each leading to its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from mammosim.report.figures import jpeg_data_uri

MAX_PATIENTS = 24
"""Patients that are shown: about a quarter of a megabyte."""

ROWS = 200
"""Height of a picture, pixels."""


@dataclass(frozen=True)
class Thumbnails:
    """A patient's pictures.

    Parameters
    ----------
    patient : int
    link : str
        Path of the patient's report from the cohort's folder; empty where it has none.
    pictures : tuple of (str, str)
        Name of each view and its picture as a data URI.
    """

    patient: int
    link: str
    pictures: tuple[tuple[str, str], ...]


def contact_sheet(cohort: Path, patients: Sequence[tuple[int, Path]]) -> list[Thumbnails]:
    """Pictures of the first patients that have any.

    Parameters
    ----------
    cohort : Path
        The cohort's folder.
    patients : sequence of (int, Path)
        Number and folder of each finished patient.

    Returns
    -------
    list of Thumbnails
    """
    shown = []
    for number, folder in patients[:MAX_PATIENTS]:
        previews = sorted(folder.glob("*/preview.png"))
        if previews:
            report = folder / "report.html"
            link = report.relative_to(cohort).as_posix() if report.is_file() else ""
            pictures = tuple((path.parent.name, _small(path)) for path in previews)
            shown.append(Thumbnails(number, link, pictures))
    return shown


def _small(path: Path) -> str:
    with Image.open(path) as preview:
        width = max(1, round(ROWS * preview.width / preview.height))
        small = preview.convert("L").resize((width, ROWS), Image.Resampling.BOX, reducing_gap=2.0)
    return jpeg_data_uri(np.asarray(small))
