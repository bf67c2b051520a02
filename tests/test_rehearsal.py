"""Another process compiles the later stages' kernels while a first run compiles the breast's."""

import os
import subprocess
import sys
import time

import numba
import pytest
from make_run import FEW_PHOTONS

from mammosim._jit import kernel
from mammosim.cli import rehearsing as beside
from mammosim.config import to_settings
from mammosim.pipeline import Plan, RunConfig

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")

PLAN = Plan((), 0.1, ())

COARSE = {
    "phantom": {
        "generate": {"density": "fatty", "volume_ml": 250, "voxel_mm": 2.5},
        "lesions": [{"name": "mass", "kind": "mass", "diameter_mm": 14}],
    },
    "compression": {"model": "hyperelastic", "resolution_mm": 8, "chest_wall": "fascia"},
    "projection": {"pixel_mm": 1.0},
    "acquisition": FEW_PHOTONS,
    "views": ["CC"],
    "laterality": "L",
}


@pytest.fixture
def settings():
    return to_settings(RunConfig, COARSE, "", ())


@pytest.fixture
def started(monkeypatch):
    """The processes that are started, on a machine where one helps."""
    found = []
    start = beside._started

    def remember(text):
        found.append(start(text))
        return found[-1]

    monkeypatch.setattr(beside, "_has_room", lambda plan: True)
    monkeypatch.setattr(beside, "_started", remember)
    return found


def fresh():
    """A kernel that is not kept: compiled anew each time."""

    def plus_one(x):
        return x + 1

    compiled = kernel(plus_one)
    compiled._cache.flush()
    return compiled


LISTS_NEW_KERNELS = """
import gc, sys
from numba.core.dispatcher import Dispatcher
from mammosim.pipeline import RunConfig, simulate
from mammosim.pipeline.run import rehearsal

def variants():
    return {
        (each.py_func.__module__, each.py_func.__name__, str(one))
        for each in gc.get_objects() if isinstance(each, Dispatcher) for one in each.signatures
    }

config = RunConfig.model_validate_json(sys.stdin.read())
rehearsal.rehearse(config)
rehearsed = variants()
study = simulate(config)
assert study.views
for room, name, _ in variants() - rehearsed:
    if room.startswith("mammosim.") and not room.startswith("mammosim.phantom."):
        print(name)
"""


def test_what_is_rehearsed_is_what_the_run_needs(settings):
    """The same kernels, for the same types of arguments: only the breast's own are left."""
    run = subprocess.run(
        [sys.executable, "-c", LISTS_NEW_KERNELS], input=settings.model_dump_json(),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert run.stdout.split() == []


def test_it_begins_with_the_first_kernel_and_ends_with_the_run(settings, started, monkeypatch):
    monkeypatch.setattr(beside, "REHEARSE", "import sys; sys.stdin.read()")
    with beside.rehearsing(settings, PLAN):
        assert started == []
        assert fresh()(1) == 2
        (process,) = started
        assert process.poll() is None
        assert fresh()(1) == 2
        assert len(started) == 1, "one is enough"
    assert process.poll() == 0


def test_it_ends_with_the_process_that_started_it(settings, started, monkeypatch):
    """Whatever becomes of that one: its end closes the pipe."""
    waits = "from mammosim.pipeline.run import rehearsal as r; r.rehearse = lambda c: __import__"
    monkeypatch.setattr(beside, "REHEARSE", f"{waits}('time').sleep(60); r.main()")
    process = beside._started('{"phantom": {"generate": {}}}')
    time.sleep(0.2)
    assert process.poll() is None
    process.stdin.close()
    assert process.wait(300) == 0


def test_one_that_does_not_end_is_killed(settings, started, monkeypatch):
    monkeypatch.setattr(beside, "ENDS_WITHIN_S", 0.1)
    monkeypatch.setattr(beside, "REHEARSE", "import time; time.sleep(60)")

    def interrupted():
        fresh()(1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), beside.rehearsing(settings, PLAN):
        interrupted()
    assert started[0].poll() not in (None, 0)


def test_one_that_fails_costs_no_run(settings, started, monkeypatch):
    monkeypatch.setattr(beside, "REHEARSE", "raise SystemExit(1)")
    with beside.rehearsing(settings, PLAN):
        fresh()(1)
    monkeypatch.setattr(beside.sys, "executable", "/nowhere/python")
    with beside.rehearsing(settings, PLAN):
        fresh()(1)
    assert started[1] is None


@pytest.mark.parametrize(
    ("cores", "megabytes", "kept"), [(1, 64_000, True), (2, 700, True), (2, 64_000, False)]
)
def test_it_is_not_started_where_it_cannot_help(cores, megabytes, kept, monkeypatch):
    monkeypatch.setattr(beside, "is_command", lambda: True)
    monkeypatch.setattr(beside, "_cores", lambda: cores)
    monkeypatch.setattr("mammosim.phantom.available_bytes", lambda: megabytes * 1_000_000)
    monkeypatch.setattr("mammosim._kernel_cache.can_be_kept", lambda: kept)
    assert not beside._has_room(PLAN)


def test_it_is_started_where_it_helps(monkeypatch):
    assert not beside.is_command(), "these tests are another program"
    monkeypatch.setattr(beside, "is_command", lambda: True)
    monkeypatch.setattr(beside, "_cores", lambda: 2)
    monkeypatch.setattr("mammosim.phantom.available_bytes", lambda: None)
    monkeypatch.setattr("mammosim._kernel_cache.can_be_kept", lambda: True)
    assert beside._has_room(PLAN)
    if hasattr(os, "sched_setaffinity"):
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(before)})
        monkeypatch.undo()
        try:
            assert beside._cores() == 1
        finally:
            os.sched_setaffinity(0, before)
