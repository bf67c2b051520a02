"""A data set for machine learning: a picture and a mask a view, and a manifest of all."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from mammosim.cohort.description import Cohort, part_of
from mammosim.cohort.settings import DatasetSettings
from mammosim.config import open_file
from mammosim.errors import InputError
from mammosim.export import write_learning_pair, write_text
from mammosim.pipeline import RunConfig, read_record

FOLDER = "dataset"
MANIFEST = "manifest.csv"
COLUMNS = ("patient", "split", "view", "laterality", "image", "mask", "lesions")


def check_exports(config: RunConfig, dataset: DatasetSettings | None, where: str) -> None:
    """Refuse a data set of files that the runs do not write.

    Raises
    ------
    InputError
        Naming the key.
    """
    if dataset is None:
        return
    if not config.export.tiff:
        raise InputError(f"{where}: export.tiff: found false, but cohort.dataset needs its masks")
    if dataset.pictures == "presentation" and not config.export.dicom:
        raise InputError(
            f"{where}: export.dicom: found false, but cohort.dataset takes its images from it; or "
            f"use cohort.dataset.pictures: processing"
        )


def write_example(patient: Path, dataset: Path, settings: DatasetSettings) -> None:
    """Write picture and mask of each view of a finished patient.

    Parameters
    ----------
    patient : Path
        The patient's folder, named by its number.
    dataset : Path
        Folder of the data set.
    settings : DatasetSettings
    """
    for view in _pictures(patient):
        name = f"{patient.name}_{view}.png"
        write_learning_pair(
            patient / view, settings.pictures, dataset / "images" / name, dataset / "masks" / name
        )


def write_manifest(cohort: Cohort, dataset: Path, finished: Iterable[tuple[int, Path]]) -> None:
    """Write the list of all pictures, one line each, with the part its patient is in.

    Parameters
    ----------
    cohort : Cohort
    dataset : Path
    finished : iterable of (int, Path)
        Number and folder of each patient that is there.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for index, folder in finished:
        part = part_of(cohort, index)
        for view, record in _pictures(folder).items():
            name = f"{folder.name}_{view}.png"
            writer.writerow(
                [index, part, record["view"], record["laterality"], f"images/{name}",
                 f"masks/{name}", _lesions(folder, record)]
            )  # fmt: skip
    write_text(dataset / MANIFEST, stream.getvalue())


def _pictures(patient: Path) -> dict[str, Any]:
    """What is recorded of each view that is one picture; a series of projections is none."""
    views = read_record(patient).get("views", {})
    return {name: view for name, view in views.items() if not view["view"].endswith("_DBT")}


def _lesions(folder: Path, view: Mapping[str, Any]) -> str:
    """Numbers of the lesions in a view's picture: the values in its mask."""
    with TextIOWrapper(open_file(folder / "lesions.csv"), "utf-8", newline="") as stream:
        seen = [
            row["target_id"]
            for row in csv.DictReader(stream)
            if (row["view"], row["laterality"]) == (view["view"], view["laterality"])
            and row["kind"] not in ("landmark", "nipple")
            and row["in_field"] == "true"
        ]
    return " ".join(seen)
