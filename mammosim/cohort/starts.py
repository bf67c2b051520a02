"""How often a patient was begun without getting any further: what cannot end is given up.

Dask counts the deaths of workers, but not a worker that its batch system ends in time: a patient
with a stage longer than the workers live would be begun for ever.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.export import write_json
from mammosim.pipeline import STAGES_FOLDER

STARTS = ".starts.json"
"""In the folder of a patient that is being made."""


def note_start(folder: Path, start: str, most: int) -> None:
    """Count a start of a patient that one start of its cohort makes.

    Parameters
    ----------
    folder : path
        The patient's own.
    start : str
        Name of the cohort's start; another one counts anew.
    most : int
        Allowed starts that find no other stages kept than the one before.

    Raises
    ------
    InputError
        If it was begun so often.
    """
    stages = sorted(stage.name for stage in (folder / STAGES_FOLDER).glob("*"))
    before = _read(folder / STARTS)
    same = before.get("start") == start and before.get("stages") == stages
    count: int = before["count"] if same else 0
    if count >= most:
        raise InputError(
            f"started {count} times without finishing another stage: its worker ended each time, "
            f"possibly because a wall time or lifetime is shorter than the stage, or for lack of "
            f"memory"
        )
    write_json(folder / STARTS, {"start": start, "stages": stages, "count": count + 1})


def _read(path: Path) -> dict[str, Any]:
    try:
        note = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError):
        return {}
    sound = isinstance(note, dict) and isinstance(note.get("count"), int)
    return note if sound else {}
