"""What there is in a cohort's folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from mammosim.cohort.cohort_progress import Progress
from mammosim.cohort.description import load_cohort
from mammosim.cohort.patient import FAILURE
from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.pipeline import is_being_written, read_record

RECORD = "cohort.json"
"""The cohort as it was run; `cohort run` takes it in place of the YAML file."""

PROGRESS = "progress.json"
PATIENTS = "patients"


@dataclass(frozen=True)
class CohortStatus:
    """What there is of a cohort.

    Parameters
    ----------
    progress : Progress
        Patients as found on disk; rate and time as the run last noted them.
    active : bool
        Whether a run is at work in the folder now.
    failures : dict of int to str
        Reason of each patient that failed.
    warnings : dict of int to tuple of str
        Warnings of each patient that is done and has some.
    """

    progress: Progress
    active: bool
    failures: dict[int, str]
    warnings: dict[int, tuple[str, ...]]


def patient_folder(folder: Path, index: int) -> Path:
    """Folder of one patient."""
    return folder / PATIENTS / f"{index:06d}"


def cohort_status(folder: Path) -> CohortStatus:
    """Look at a cohort's folder, without changing anything.

    Raises
    ------
    InputError
        If it is none.
    """
    if not (folder / RECORD).is_file():
        raise InputError(f"{folder}: not the folder of a cohort, {RECORD} is missing")
    patients = load_cohort(folder / RECORD).patients
    active = is_being_written(folder)
    done, failures, warnings = 0, {}, {}
    for index in range(patients):
        place = patient_folder(folder, index)
        if not place.is_dir():
            continue
        reason = _failure(place)
        if reason is not None:
            failures[index] = reason
            continue
        record = read_record(place)
        if record.get("status") == "done":
            done += 1
            found = warnings_of(record)
            if found:
                warnings[index] = found
    noted = _noted(folder)
    made = min(int(noted.get("made", 0)), done)
    progress = Progress(
        patients, done - made, made, len(failures), int(noted.get("running", 0)) if active else 0,
        int(noted.get("workers", 0)) if active else 0, noted.get("seconds", 0.0),
    )  # fmt: skip
    return CohortStatus(progress, active, failures, warnings)


def warnings_of(record: Mapping[str, Any]) -> tuple[str, ...]:
    """Warnings in a run's record; none where it holds anything else."""
    found = record.get("warnings", ())
    return tuple(text for text in found if isinstance(text, str)) if found else ()


def _failure(folder: Path) -> str | None:
    try:
        note = json.loads(read_text(folder / FAILURE))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        return "its reason cannot be read"
    return str(note.get("reason")) if isinstance(note, dict) else "its reason cannot be read"


def _noted(folder: Path) -> dict[str, float]:
    """Numbers that the run last noted; empty where there are none."""
    try:
        values = json.loads(read_text(folder / PROGRESS))
    except (OSError, ValueError, RecursionError):
        return {}
    names = {part.name for part in fields(Progress)}
    if not isinstance(values, dict):
        return {}
    return {
        name: value for name, value in values.items()
        if name in names and type(value) in (int, float) and 0 <= value < 1e12
    }  # fmt: skip
