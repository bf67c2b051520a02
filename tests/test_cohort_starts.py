"""A patient whose worker always ends before a stage is done is given up, and no other is."""

from __future__ import annotations

import pytest
from test_cohort_run import describe, task

from mammosim.cohort.patient import make_patient
from mammosim.cohort.starts import STARTS, note_start
from mammosim.errors import InputError


class Ended(BaseException):
    """A worker that ends in the middle of its work."""


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """Makes patient 0 until the worker ends, with some stages kept by then."""
    description = describe(tmp_path)
    kept = []

    def simulate(config, run):
        stages = run.path / ".stages"
        stages.mkdir(exist_ok=True)
        for name in kept:
            (stages / name).write_bytes(b"")
        raise Ended

    monkeypatch.setattr("mammosim.cohort.patient.simulate", simulate)

    def work(*more: str, **changes):
        kept.extend(more)
        return make_patient(task(description, tmp_path, 0, **({"starts": 2} | changes)))

    return work


def test_a_stage_that_never_ends_is_given_up(worker, tmp_path):
    for _ in range(2):
        with pytest.raises(Ended):
            worker()
    outcome = worker()
    assert outcome.failed
    assert outcome.reason.startswith("started 2 times without finishing another stage")
    assert (tmp_path / "patients/000000/failure.json").exists()
    assert not (tmp_path / "patients/000000" / STARTS).exists()


def test_each_stage_that_was_kept_counts_anew(worker):
    for stage in ("breast", "LCC", "LMLO"):
        with pytest.raises(Ended):
            worker(stage)
        with pytest.raises(Ended):
            worker()
    with pytest.raises(Ended):  # the first that finds the last stage
        worker()
    assert worker().failed


def test_another_start_of_the_cohort_counts_anew(worker):
    for start in ("first", "first", "second", "second", "third"):
        with pytest.raises(Ended):
            worker(start=start)


@pytest.mark.parametrize("text", ["", "[]", '{"count": "2", "start": "s", "stages": []}', "\xff"])
def test_a_note_that_is_harmed_counts_anew(tmp_path, text):
    (tmp_path / STARTS).write_text(text, encoding="latin-1")
    note_start(tmp_path, "s", 1)
    with pytest.raises(InputError, match=r"started 1 times without"):
        note_start(tmp_path, "s", 1)
