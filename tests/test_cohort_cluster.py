"""What each worker of a cluster may take: its share of a host's processors, its own memory."""

from __future__ import annotations

import gc
import re
from unittest.mock import Mock

import pytest
from distributed import CancelledError, Client, LocalCluster
from distributed.comm import CommClosedError
from test_cohort_run import describe, task

from mammosim.cohort import load_cohort
from mammosim.cohort.cluster import own_memory_gb, remote_client, shares
from mammosim.cohort.dispatch import _Work
from mammosim.cohort.patient import Outcome, make_patient
from mammosim.errors import InputError, Interrupted


def test_a_worker_knows_its_own_memory():
    assert own_memory_gb() == float("inf")
    for limit, known in (("750MB", 0.75), (0, float("inf"))):
        here = {"processes": False, "n_workers": 1, "dashboard_address": None}
        with LocalCluster(**here, memory_limit=limit) as cluster, Client(cluster) as client:
            assert client.submit(own_memory_gb).result() == pytest.approx(known)


def test_a_worker_that_came_late_has_less_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("mammosim.cohort.patient.own_memory_gb", lambda: 0.25)
    outcome = make_patient(task(describe(tmp_path), tmp_path, 0, memory_gb=8.0))
    assert re.search(
        r"needs about \d\.\d\d+ GB of memory, but a worker has 0\.25 GB", outcome.reason
    )


@pytest.mark.parametrize(
    ("processors", "threads"),
    [
        ([range(16), range(16)], 8),  # nothing binds them: they share their host
        ([range(4), range(4, 8)], 4),  # a batch system gave each its own
        ([range(4), range(4, 8), range(8, 10)], 2),
    ],
)
def test_the_processors_of_a_host_are_shared_out(processors, threads):
    here = {str(i): {"host": "a", "memory_limit": (i + 1) * 10**9} for i in range(len(processors))}

    class Given:
        def scheduler_info(self, n_workers):
            return {"workers": here}

        def run(self, function, on_error):
            gone = {"gone": (1, frozenset([0]))}  # a worker that ended meanwhile
            return gone | {str(i): (len(p), frozenset(p)) for i, p in enumerate(processors)}

    assert shares(Given()) == (threads, 1.0)


def test_a_scheduler_that_goes_while_its_workers_are_asked():
    client = Mock()
    client.scheduler_info.return_value = {"workers": {}}
    client.run.side_effect = OSError("connection lost")
    with pytest.raises(Interrupted, match=r"no longer answers \(connection lost\)"):
        shares(client)


def test_what_a_lost_worker_had_is_not_running(tmp_path):
    client = Mock(status="running", cluster=None)
    client.submit.side_effect = lambda *_, **__: Mock()
    work = _Work(load_cohort(describe(tmp_path)), tmp_path, client, 1, 8.0, lambda _: None)
    for workers in ({"a": 1, "b": 1}, {"b": 1}, {}):
        client.nthreads.return_value = workers
        work._submit()
        there = len(workers)
        assert (work.progress.running, work.progress.waiting) == (there, 5 - there)
    assert client.submit.call_count == 2


class Lost:
    """A future whose outcome is there, and is lost while it is fetched."""

    def __init__(self, loss: type[Exception], then: str) -> None:
        self.status, self._loss, self._then = "finished", loss, then

    def result(self, timeout: float | None = None) -> None:
        self.status = self._then
        raise self._loss

    def add_done_callback(self, call) -> None: ...


@pytest.mark.parametrize(
    ("loss", "then"),
    [(CommClosedError, "cancelled"), (CancelledError, "cancelled"), (TimeoutError, "lost")],
)
def test_an_outcome_lost_on_its_way_is_asked_for_again(tmp_path, loss, then):
    cohort = load_cohort(describe(tmp_path))
    client = Mock(status="running", cluster=None)
    client.nthreads.return_value = {"a": 1}
    begun = []

    def submit(make, patient, **_):
        begun.append(patient.index)
        if begun == [0, 1, 2]:
            return Lost(loss, then)
        return Mock(status="finished", **{"result.return_value": Outcome(patient.index)})

    client.submit.side_effect = submit
    work = _Work(cohort, tmp_path, client, 1, 8.0, lambda _: None)
    assert [outcome.index for outcome in work.through()] == [0, 1, 2, 3, 4]
    assert begun == [0, 1, 2, 2, 3, 4]


def test_an_outcome_lost_with_its_scheduler_ends_the_cohort(tmp_path):
    client = Mock(status="running", cluster=None)
    client.nthreads.return_value = {"a": 1}
    client.submit.side_effect = lambda *_, **__: Lost(CommClosedError, "cancelled")
    work = _Work(load_cohort(describe(tmp_path)), tmp_path, client, 1, 8.0, lambda _: None)
    work._submit()
    client.status = "closed"
    with pytest.raises(Interrupted, match=r"no longer answers; 0 of 5 patients are done"):
        work.through()


def open_clients() -> set[int]:
    return {
        id(here) for here in gc.get_objects() if type(here) is Client and here.status != "closed"
    }


@pytest.mark.parametrize(
    ("address", "reason"), [("nonsense://x", "unknown address scheme"), ("x", "missing port")]
)
def test_what_is_no_address_leaves_no_client_behind(address, reason):
    """Its end in the garbage, while another client starts, would wait for itself for ever."""
    before = open_clients()
    with pytest.raises(InputError, match=reason), remote_client(address):
        pass
    assert open_clients() <= before
