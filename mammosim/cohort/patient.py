"""One patient, as a worker makes it: a run in a folder of its own, or why there is none."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mammosim._jit import use_threads
from mammosim.cohort.cluster import own_memory_gb
from mammosim.cohort.dataset import write_example
from mammosim.cohort.settings import DatasetSettings
from mammosim.cohort.starts import STARTS, note_start
from mammosim.errors import InputError, Interrupted, MammosimError
from mammosim.export import write_json
from mammosim.pipeline import (
    STAGES_FOLDER,
    Plan,
    RunFolder,
    config_of,
    is_finished,
    keep_freed_memory,
    make_plan,
    return_freed_memory,
    simulate,
    writing,
)

FAILURE = "failure.json"
"""In a patient's folder: why there is no finished run in it."""

WAIT_S = 120.0
"""For another worker that still writes the same patient, as after the scheduler was lost, s."""

DASK_GB = 0.2
"""Of a worker before it makes anything, beside what a run of its own takes; 0.15 was measured."""

_one_at_a_time = threading.Lock()


@dataclass(frozen=True)
class Patient:
    """What a worker is told of one patient.

    Parameters
    ----------
    index : int
    values : dict
        The patient's configuration as plain values.
    base : str
        Folder that paths in them are relative to.
    where : str
        The cohort's file, for messages.
    folder : str
        The patient's own.
    start : str
        Name of this start of the cohort.
    starts : int
        How often the patient may be begun in it without getting any further.
    threads : int
        Threads that its kernels may use.
    memory_gb : float
        Memory that the patient may take, GB.
    keep_stages : bool
    dataset : DatasetSettings or None
    dataset_folder : str
    """

    index: int
    values: dict[str, Any]
    base: str
    where: str
    folder: str
    start: str
    starts: int
    threads: int
    memory_gb: float
    keep_stages: bool
    dataset: DatasetSettings | None
    dataset_folder: str


@dataclass(frozen=True)
class Outcome:
    """How it went with one patient.

    Parameters
    ----------
    index : int
    reason : str
        Why it failed; empty if it did not.
    kind : str
        Kind of failure, the name of the error.
    seconds : float
        Wall time, s.
    found : bool
        Whether it was finished before.
    """

    index: int
    reason: str = ""
    kind: str = ""
    seconds: float = 0.0
    found: bool = False

    @property
    def failed(self) -> bool:
        """Whether there is no finished run."""
        return bool(self.kind)


def make_patient(patient: Patient) -> Outcome:
    """Make one patient, or say why it cannot be made.

    What is finished, with every file unharmed, is left as it is. A worker with several threads
    still makes one patient at a time.
    """
    with _one_at_a_time:
        start = time.perf_counter()
        folder = Path(patient.folder)
        try:
            with writing(folder, WAIT_S):
                found = _make(patient, folder)
                _unlink(folder / FAILURE)
                _unlink(folder / STARTS)
            return Outcome(patient.index, seconds=time.perf_counter() - start, found=found)
        except Interrupted:
            raise
        except MammosimError as error:
            seconds = time.perf_counter() - start
            failed = Outcome(patient.index, str(error), type(error).__name__, seconds)
            note_failure(folder, failed)
            with suppress(OSError):
                (folder / STARTS).unlink(missing_ok=True)
            return failed


def worker_gb(plan: Plan) -> float:
    """Memory that a worker takes with a patient, GB."""
    return plan.memory_gb + DASK_GB


def note_failure(folder: Path, outcome: Outcome) -> None:
    """Write why a patient failed into its folder, where that can be written."""
    note = {"kind": outcome.kind, "reason": outcome.reason, "seconds": round(outcome.seconds, 3)}
    try:
        write_json(folder / FAILURE, note)
    except MammosimError:
        return  # a full disk or a read-only folder: the reason is in the cohort's own list


def _make(patient: Patient, folder: Path) -> bool:
    """Make the patient; whether it was there before."""
    use_threads(patient.threads)
    keep_freed_memory()
    where = f"{patient.where}, patient {patient.index}"
    config = config_of(patient.values, Path(patient.base), where)
    found = is_finished(folder, config)
    if not found:
        needed = worker_gb(make_plan(config))
        room = min(patient.memory_gb, own_memory_gb())  # one that came late may have less
        if needed > room:
            raise InputError(
                f"{where}: needs about {needed:.3g} GB of memory, but a worker has {room:.3g} GB"
            )
        note_start(folder, patient.start, patient.starts)
        simulate(config, RunFolder(folder, config, title=folder.name))
        return_freed_memory()  # between patients, a worker is as small as when it started
    if not patient.keep_stages:
        for stage in (folder / STAGES_FOLDER).glob("*"):
            _unlink(stage)
    if patient.dataset is not None:
        write_example(folder, Path(patient.dataset_folder), patient.dataset)
    return found


def _unlink(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be removed ({error.strerror})") from None
