"""Views that are made at the same time: the same results, errors in order, no view goes astray."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from functools import partial

import numba
import numpy as np
import pytest
from make_run import FEW_PHOTONS

import mammosim
from mammosim import InputError, _side_by_side
from mammosim._crew import Crew, crew_of_thread
from mammosim._derived import Derived
from mammosim._jit import kernel_threads, parallel_kernel, share
from mammosim._side_by_side import both, dealt, run_side_by_side
from mammosim.compression.springs import relaxation
from mammosim.config import to_settings
from mammosim.errors import Interrupted
from mammosim.pipeline import RunConfig, RunFolder
from mammosim.pipeline.run import at_once, simulation
from mammosim.pipeline.run.at_once import views_at_once

SECTIONS = {
    "phantom": {"generate": {"volume_ml": 250, "voxel_mm": 3.0}},
    "compression": {"model": "hyperelastic", "resolution_mm": 8.0},
    "projection": {"pixel_mm": 1.0},
    "acquisition": FEW_PHOTONS,
    "report": {"html": False},
    "seed": 4,
}

WAIT_S = 120.0
"""After which a test has failed that waits for another thread, which may have to compile first."""


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return to_settings(RunConfig, SECTIONS, "test")


@parallel_kernel
def _fill(thread, out):
    for i in share(thread, 0, out.size):
        out[i] = i


@pytest.mark.usefixtures("breasts_are_made_once")
def test_two_views_at_once_are_those_made_in_turn(config, monkeypatch, tmp_path):
    monkeypatch.setattr(simulation, "views_at_once", lambda config: 2)
    both = mammosim.simulate(config, RunFolder(tmp_path / "both", config, "run"))
    monkeypatch.setattr(simulation, "views_at_once", lambda config: 1)
    turn = mammosim.simulate(config, RunFolder(tmp_path / "turn", config, "run"))
    assert list(both.views) == list(turn.views) == ["LCC", "LMLO"]
    assert both.notes == turn.notes
    for path in (tmp_path / "turn").rglob("*"):
        if path.is_file() and path.name != "run.json":
            name = path.relative_to(tmp_path / "turn")
            assert path.read_bytes() == (tmp_path / "both" / name).read_bytes(), name


def test_tasks_are_at_work_at_the_same_time_and_results_keep_their_order():
    met = threading.Barrier(2, timeout=WAIT_S)

    def task(number):
        if number < 2:
            met.wait()
        return number, threading.current_thread() is threading.main_thread()

    tasks = [lambda number=number: task(number) for number in range(4)]
    assert run_side_by_side(tasks, 2) == [(number, False) for number in range(4)]
    met.reset()
    assert run_side_by_side(tasks[2:], 1) == [(2, True), (3, True)]


def test_tasks_share_the_threads_of_the_kernels_while_they_are_at_work():
    crew, seen = Crew(5), []
    assert crew_of_thread() is None
    with crew.at_work():
        seen.append(kernel_threads())
        other = threading.Thread(target=lambda: _note_share(crew, seen))
        other.start()
        other.join()
        seen.append(kernel_threads())
    assert seen == [5, 2, 5]
    assert crew_of_thread() is None


def _note_share(crew, seen):
    with crew.at_work():
        seen.append(kernel_threads())


def test_the_first_error_in_order_is_raised_and_what_has_begun_is_finished():
    failed, finished = threading.Event(), []

    def slow():
        assert failed.wait(WAIT_S)
        time.sleep(0.05)
        finished.append("slow")
        raise InputError("the first in order")

    def quick():
        failed.set()
        raise InputError("the first in time")

    tasks = [slow, quick, *[lambda: time.sleep(0.2) or finished.append("more")] * 5]
    with pytest.raises(InputError, match="in order"):
        run_side_by_side(tasks, 2)
    assert finished[0] == "slow"
    assert len(finished) <= 2  # one may have begun before the error was seen


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS == 1, reason="kernels have one thread")
@pytest.mark.parametrize("stop", [KeyboardInterrupt, Interrupted("stopped", None)])
def test_an_interruption_of_one_task_stops_the_others_at_their_next_kernel(stop):
    begun, out = threading.Event(), np.zeros(10)

    def endless():
        until = time.monotonic() + WAIT_S
        begun.set()
        while time.monotonic() < until:
            _fill(out)
        return "went on"

    def interrupted():
        assert begun.wait(WAIT_S)
        raise stop

    with pytest.raises((KeyboardInterrupt, Interrupted)):
        run_side_by_side([interrupted, endless], 2)
    with pytest.raises(KeyboardInterrupt):
        run_side_by_side([endless, interrupted], 2)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS == 1, reason="kernels have one thread")
def test_a_task_that_is_stopped_may_still_keep_what_it_reached():
    """Its kernels are interrupted once, as by Ctrl-C, and not again while it tidies up."""
    begun, out, kept = threading.Event(), np.zeros(10), []

    def stopped():
        until = time.monotonic() + WAIT_S
        begun.set()
        try:
            while time.monotonic() < until:
                _fill(out)
        except KeyboardInterrupt:
            out[:] = 0.0
            _fill(out)
            kept.append(out.copy())
            raise

    def interrupted():
        assert begun.wait(WAIT_S)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_side_by_side([interrupted, stopped], 2)
    np.testing.assert_array_equal(kept, [np.arange(10.0)])


@pytest.mark.usefixtures("breasts_are_made_once")
@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS == 1, reason="kernels have one thread")
def test_views_that_are_interrupted_keep_what_they_reached(tmp_path, monkeypatch):
    """Both in their third sweep: one is interrupted there, the other by that."""
    sweep, visits, both = relaxation.sweep, Counter(), threading.Barrier(2, timeout=WAIT_S)
    stop, told = Crew.stop, threading.Event()

    def stopped(*arguments):
        visits[threading.get_ident()] += 1
        if visits[threading.get_ident()] == 3:
            if both.wait() == 0:
                raise KeyboardInterrupt
            assert told.wait(WAIT_S)
        sweep(*arguments)

    def telling(crew):
        stop(crew)
        told.set()

    monkeypatch.setattr(Crew, "stop", telling)
    monkeypatch.setattr(relaxation, "sweep", stopped)
    springs = {"model": "springs", "resolution_mm": 6.0, "solver": "relaxation"}
    config = to_settings(RunConfig, SECTIONS | {"compression": springs}, "test")
    with pytest.raises((KeyboardInterrupt, Interrupted)):
        mammosim.simulate(config, RunFolder(tmp_path / "out", config, "run"))
    for view in ("LCC", "LMLO"):
        assert (tmp_path / "out" / view / "displacement.nii.gz").exists()


@pytest.mark.parametrize("threads", [1, 2])
def test_both_of_two_results_come_in_their_order(threads, monkeypatch):
    monkeypatch.setattr(_side_by_side, "kernel_threads", lambda: threads)
    assert both(lambda: "first", lambda: 2) == ("first", 2)


@pytest.mark.parametrize("turns", [1, 16, 41])
def test_neighbouring_turns_are_dealt_to_different_threads(turns):
    order = dealt(turns)
    assert sorted(order) == list(range(turns))
    parts = np.array_split(order, 2)
    assert all(np.abs(np.diff(np.sort(part))).max(initial=2) <= 3 for part in parts)
    assert abs(sum(parts[0]) - sum(parts[1])) <= turns


def test_ctrl_c_stops_all(monkeypatch):
    """Python interrupts the main thread, which waits for the others."""
    crews = []

    def interrupted_wait(futures, return_when):
        while len(crews) < 2:
            time.sleep(0.001)
        raise KeyboardInterrupt("SIGINT")

    def task():
        crews.append(crew_of_thread())
        while True:
            crew_of_thread().share()

    monkeypatch.setattr(_side_by_side, "wait", interrupted_wait)
    with pytest.raises(KeyboardInterrupt, match="SIGINT"):
        run_side_by_side([task, task], 2)
    assert len(crews) == 2


def test_views_are_made_in_turn_where_threads_or_memory_do_not_suffice(config, monkeypatch):
    monkeypatch.setattr(at_once, "kernel_threads", lambda: 8)
    assert views_at_once(config) == 2
    monkeypatch.setattr(at_once, "available_bytes", lambda: None)
    assert views_at_once(config) == 2
    monkeypatch.setattr(at_once, "available_bytes", lambda: 10_000_000)
    assert views_at_once(config) == 1
    monkeypatch.setattr(at_once, "available_bytes", lambda: 10**12)
    monkeypatch.setattr(at_once, "kernel_threads", lambda: 1)
    assert views_at_once(config) == 1


def test_what_is_made_of_an_object_is_made_once_and_kept_as_long_as_the_object():
    kept, made = Derived(), []
    first, second = threading.Event(), threading.Event()  # any objects

    def make(name):
        made.append(name)
        time.sleep(0.02)
        return [name]

    asked = [threading.Thread(target=kept.of, args=(first, partial(make, "first"))) for _ in "123"]
    for thread in asked:
        thread.start()
    for thread in asked:
        thread.join()
    assert kept.of(second, lambda: make("second")) == ["second"]
    assert kept.of(first, lambda: make("again")) is kept.of(first, lambda: make("again"))
    assert made == ["first", "second"]
    del first, asked, thread
    gc.collect()
    assert len(kept._places) == 1


def test_what_could_not_be_made_is_made_for_the_next_that_asks():
    kept, source = Derived(), threading.Event()

    def refuse():
        raise InputError("no")

    with pytest.raises(InputError):
        kept.of(source, refuse)
    assert kept.of(source, lambda: 3) == 3
