"""A whole cohort: patients handed to workers, one each, until all are done or have failed."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from distributed import CancelledError, Client, Future, KilledWorker

from mammosim.cohort.cluster import (
    local_client,
    remote_client,
    share_machine,
    shares,
    wait_for_worker,
)
from mammosim.cohort.cohort_progress import Progress
from mammosim.cohort.dataset import FOLDER as DATASET
from mammosim.cohort.dataset import write_manifest
from mammosim.cohort.description import Cohort
from mammosim.cohort.patient import Outcome, Patient, make_patient, note_failure, worker_gb
from mammosim.cohort.patients_table import write_tables
from mammosim.cohort.plan import first_plans
from mammosim.cohort.status import PROGRESS, RECORD, patient_folder
from mammosim.errors import InputError, Interrupted
from mammosim.export import write_json
from mammosim.pipeline import writing

OnProgress = Callable[[Progress], None]

POLL_S = 0.5
"""Between two looks at what has been finished, s."""

MEND_S = 10.0
"""Between two looks for local workers that are gone, s."""

FETCH_S = 10.0
"""For an outcome that is there to detector_input, s; its worker may be gone by then."""

DASK_TRIES = 4
"""Workers that a patient may kill before Dask gives it up: its `allowed-failures` and one more."""

NOTE_S = 5.0
"""Between two notes of the progress in the cohort's folder, s."""


def run_cohort(
    cohort: Cohort,
    folder: str | os.PathLike[str],
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    on_progress: OnProgress | None = None,
) -> Progress:
    """Make all patients of a cohort that are not there yet, and the tables of all.

    Parameters
    ----------
    cohort : Cohort
        From `load_cohort`.
    folder : path
        The cohort's folder; a patient that is finished there, with every file unharmed, is kept.
    scheduler : str, optional
        Address of a Dask scheduler; left out: workers are started on this machine.
    workers : int, optional
        Number of local workers; left out: one a processor, as far as memory goes.
    on_progress : callable, optional
        Told of progress.

    Returns
    -------
    Progress
        At the end; patients that failed are in `failures.csv`.

    Raises
    ------
    InputError
        If no patient can be made, or the folder cannot be written or is in use.
    Interrupted
        If the scheduler is lost. What was finished is kept, and the next start goes on.
    """
    path = Path(folder)
    largest_gb = _largest_gb(cohort)
    with writing(path):
        write_json(path / RECORD, {
            "title": cohort.title, "folder": str(cohort.folder),
            "cohort_of": {**cohort.values, "seed": cohort.seed,
                          "cohort": cohort.settings.model_dump(mode="json", exclude_none=True)},
        })  # fmt: skip
        on_progress = on_progress or (lambda progress: None)
        with _client(cohort, scheduler, workers, largest_gb, on_progress) as (
            client,
            threads,
            memory_gb,
        ):
            work = _Work(cohort, path, client, threads, memory_gb, on_progress)
            outcomes = work.through()
        _write_results(cohort, path, outcomes)
        write_json(path / PROGRESS, asdict(work.progress))
    return work.progress


def _largest_gb(cohort: Cohort) -> float:
    """Memory of the largest of the first patients, GB; one that is faulty fails when it comes."""
    plans, problems = first_plans(cohort)
    if not plans:
        raise InputError(problems)
    return max(map(worker_gb, plans))


@contextmanager
def _client(
    cohort: Cohort,
    scheduler: str | None,
    workers: int | None,
    largest_gb: float,
    on_progress: OnProgress,
) -> Iterator[tuple[Client, int, float]]:
    """A client, and the threads and memory (GB) of each of its workers."""
    if scheduler is not None:
        with remote_client(scheduler) as client:
            on_progress(Progress(cohort.patients))
            wait_for_worker(client)  # before one is there, nobody knows what it has
            yield (client, *shares(client))
        return
    share = share_machine(largest_gb, cohort.patients, workers, cohort.settings.memory_gb)
    with local_client(share) as client:
        yield client, share.threads, share.memory_gb


class _Work:
    """Patients on their way through the workers, as many at a time as there are workers."""

    def __init__(
        self, cohort: Cohort, folder: Path, client: Client, threads: int, memory_gb: float,
        on_progress: OnProgress,
    ) -> None:  # fmt: skip
        self.progress = Progress(cohort.patients)
        self._cohort, self._folder, self._client, self._on_progress = (
            cohort,
            folder,
            client,
            on_progress,
        )
        self._share = (threads, memory_gb)
        self._waiting = iter(range(cohort.patients))
        self._again: list[int] = []
        self._begun: dict[int, int] = {}
        self._running: dict[Future, int] = {}
        self._woken = threading.Event()
        self._name = f"{os.getpid()}-{time.time_ns()}"
        self._start, self._noted = time.monotonic(), 0.0
        self._local, self._mended = 0, time.monotonic()

    def through(self) -> list[Outcome]:
        """Work until every patient is done or has failed."""
        outcomes: list[Outcome] = []
        self._submit()
        while self._running or self.progress.waiting:
            for index, future in self._finished():
                outcome = self._outcome(index, future)
                if outcome is not None:
                    outcomes.append(outcome)
                    self._count(outcome)
            self._submit()
            self._say()
        self._say(last=True)
        return sorted(outcomes, key=lambda outcome: outcome.index)

    def _submit(self) -> None:
        """One patient to each worker that has none."""
        if self._client.status != "running":  # on its way back, or lost
            self._check_scheduler()
            return
        try:
            room = len(self._client.nthreads())
        except (OSError, TimeoutError):
            return  # its state tells at the next turn
        self._replace_workers(room)
        self.progress = replace(self.progress, workers=room)
        while len(self._running) < room:
            index = self._again.pop() if self._again else next(self._waiting, None)
            if index is None:
                break
            self._begun[index] = self._begun.get(index, 0) + 1
            key = f"patient-{index}-{self._begun[index]}-{self._name}"
            future = self._client.submit(make_patient, self._patient(index), key=key, pure=False)
            future.add_done_callback(lambda _: self._woken.set())
            self._running[future] = index
        running = min(len(self._running), room)  # what a lost worker had waits for the next
        self.progress = replace(self.progress, running=running)

    def _replace_workers(self, there: int) -> None:
        """Start local workers anew that are gone for good.

        A worker that dies at work is started again by itself; one that dies while it starts is not.
        """
        cluster = self._client.cluster
        if cluster is None:
            return
        self._local = max(self._local, there)
        if there < self._local and time.monotonic() - self._mended > MEND_S:
            self._mended = time.monotonic()
            cluster.scale(self._local)

    def _patient(self, index: int) -> Patient:
        cohort, (threads, memory_gb) = self._cohort, self._share
        return Patient(
            index, cohort.values_of(index), str(cohort.folder), cohort.where,
            str(patient_folder(self._folder, index).absolute()), self._name,
            DASK_TRIES * cohort.settings.attempts, threads, memory_gb,
            cohort.settings.keep_stages, cohort.settings.dataset,
            str((self._folder / DATASET).absolute()),
        )  # fmt: skip

    def _finished(self) -> list[tuple[int, Future]]:
        self._woken.wait(POLL_S)
        self._woken.clear()
        done = [future for future in self._running if future.status != "pending"]
        return [(self._running.pop(future), future) for future in done]

    def _outcome(self, index: int, future: Future) -> Outcome | None:
        """What came of a patient; None where that is not known, or it is begun again."""
        if future.status == "finished":
            try:
                outcome: Outcome = future.result(timeout=FETCH_S)
            except (OSError, CancelledError):  # lost on its way; its state tells at the next turn
                self._running[future] = index
                return None
            return outcome
        if future.status != "error":  # cancelled or lost with its scheduler
            self._again.append(index)
            self._check_scheduler()
            return None
        error = future.exception()
        if isinstance(error, KilledWorker):
            if self._begun[index] < self._cohort.settings.attempts:
                self._again.append(index)
                return None
            error = RuntimeError("its worker died each time, possibly for lack of memory")
        failed = Outcome(index, str(error) or type(error).__name__, type(error).__name__)
        note_failure(patient_folder(self._folder, index), failed)
        return failed

    def _check_scheduler(self) -> None:
        if self._client.status == "closed":
            raise Interrupted(
                f"the scheduler no longer answers; {self.progress.done} of "
                f"{self.progress.patients} patients are done; it can be resumed", self.progress
            )  # fmt: skip

    def _count(self, outcome: Outcome) -> None:
        key = "failed" if outcome.failed else "found" if outcome.found else "made"
        more = {key: getattr(self.progress, key) + 1}
        self.progress = replace(self.progress, **more, running=len(self._running))

    def _say(self, last: bool = False) -> None:
        now = time.monotonic()
        self.progress = replace(self.progress, seconds=now - self._start)
        self._on_progress(self.progress)
        if now - self._noted > NOTE_S and not last:
            self._noted = now
            write_json(self._folder / PROGRESS, asdict(self.progress))


def _write_results(cohort: Cohort, folder: Path, outcomes: list[Outcome]) -> None:
    """Tables, summary page and manifest, of what is there."""
    finished = [
        (outcome.index, patient_folder(folder, outcome.index))
        for outcome in outcomes
        if not outcome.failed
    ]
    write_tables(cohort, folder, finished, [outcome for outcome in outcomes if outcome.failed])
    if cohort.settings.dataset is not None:
        write_manifest(cohort, folder / DATASET, finished)
