"""What is written beside the stages that follow: in order, whole, and no error is lost."""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path

import pytest
from make_run import FEW_PHOTONS

from mammosim import simulate
from mammosim.config import to_settings
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, RunFolder
from mammosim.pipeline.folder import run_folder
from mammosim.pipeline.run import beside as module
from mammosim.pipeline.run import simulation
from mammosim.pipeline.run.beside import MAX_WAITING, WritingThread

SECTIONS = {
    "phantom": {"generate": {"volume_ml": 250, "voxel_mm": 3.0}},
    "compression": {"model": "springs", "resolution_mm": 8.0},
    "projection": {"pixel_mm": 1.0},
    "acquisition": FEW_PHOTONS,
    "report": {"html": False},
    "views": ["CC", "MLO"],
}

WAIT_S = 120.0
"""After which a test has failed whose threads wait for each other."""


@pytest.fixture
def beside():
    thread = WritingThread()
    yield thread
    thread.close()


def refuse() -> None:
    raise InputError("c.nii.gz: cannot be written (disk full)")


def test_results_are_written_in_order_and_timed(beside):
    written, seconds = [], []
    for number in range(5):
        beside.hand_over(written.append, number, note=seconds.append)
    beside.finish()
    assert sorted(written) == [0, 1, 2, 3, 4]
    assert len(seconds) == 5
    assert min(seconds) >= 0.0


def test_a_run_waits_where_too_much_waits(beside):
    gate, written = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    for number in range(MAX_WAITING):
        beside.hand_over(written.append, number)
    threading.Timer(0.05, gate.set).start()
    beside.hand_over(written.append, MAX_WAITING)  # only now may the first be gone
    assert gate.is_set()
    beside.finish()
    assert sorted(written) == list(range(MAX_WAITING + 1))


def test_the_run_helps_at_its_end(beside):
    """The last is written on the run's own thread while the other is still busy."""
    gate, threads = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)

    def last() -> None:
        threads.append(threading.current_thread())
        gate.set()

    beside.hand_over(last)
    beside.finish()
    assert threads == [threading.current_thread()]


def test_an_error_is_raised_and_nothing_more_is_written(beside):
    gate, written = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    beside.hand_over(refuse)
    beside.hand_over(written.append, 1)
    gate.set()
    with pytest.raises(InputError, match="disk full"):
        beside.finish()
    beside.finish()
    assert len(written) <= 2  # by this thread, before it heard of the error


def test_an_error_is_raised_where_the_next_result_is_handed_over(beside):
    beside.hand_over(refuse)
    while not beside._waiting[0][0].done():
        time.sleep(0.001)
    with pytest.raises(InputError, match="disk full"):
        beside.hand_over(refuse)


def test_an_error_of_the_last_is_raised_at_the_end(beside):
    beside.hand_over(refuse)
    with pytest.raises(InputError, match="disk full"):
        beside.finish()
    beside.finish()


def test_closing_gives_up_what_has_not_begun():
    beside, gate, written = WritingThread(), threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    beside.hand_over(written.append, 1)
    threading.Timer(0.05, gate.set).start()
    beside.close()
    assert written == []


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return to_settings(RunConfig, SECTIONS, "test")


@pytest.fixture(scope="module")
def usual(config, tmp_path_factory) -> Path:
    """The folder of a run that nothing holds up."""
    folder = tmp_path_factory.mktemp("usual") / "run"
    simulate(config, RunFolder(folder, config))
    return folder


@pytest.fixture
def hold(monkeypatch):
    """Has a thread stop in the middle of a file until the run has nothing left to do but wait."""

    def hold(path: Path) -> None:
        half_written, go_on = threading.Event(), threading.Event()
        replace, wait = os.replace, module.wait
        finish, close = WritingThread.finish, WritingThread.close

        def held(part, target):
            if Path(target) == path and threading.current_thread() is not threading.main_thread():
                half_written.set()
                assert go_on.wait(WAIT_S)
            replace(part, target)

        def waiting(futures):
            go_on.set()
            return wait(futures)

        def finishing(self):
            assert half_written.wait(WAIT_S)
            monkeypatch.setattr(module, "wait", waiting)
            finish(self)

        def closing(self):
            go_on.set()
            close(self)

        monkeypatch.setattr(os, "replace", held)
        monkeypatch.setattr(WritingThread, "finish", finishing)
        monkeypatch.setattr(WritingThread, "close", closing)
        monkeypatch.setattr(simulation, "views_at_once", lambda config: 1)

    return hold


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "run.json"
    }


@pytest.mark.parametrize(
    "name",
    [".stages/phantom.npz", ".stages/LCC.compression.npz", "uncompressed.nii.gz", "labels.json"],
)
@pytest.mark.usefixtures("breasts_are_made_once")
def test_a_thread_that_is_held_up_in_any_file_makes_no_difference(
    name, config, usual, hold, tmp_path
):
    """The run writes all the rest meanwhile, and begins with what was to be written last."""
    output = tmp_path / "run"
    hold(output / name)
    simulate(config, RunFolder(output, config))
    assert files_of(output) == files_of(usual)


@pytest.mark.usefixtures("breasts_are_made_once")
def test_the_record_of_a_run_that_stops_has_what_a_thread_was_writing(
    config, hold, tmp_path, monkeypatch
):
    """Images of neither view can be written: the run stops, and fails again as it tidies up."""
    monkeypatch.setattr(run_folder, "write_images", lambda *arguments: refuse())
    output = tmp_path / "run"
    hold(output / "LCC" / "compressed.nii.gz")
    with pytest.raises(InputError, match="disk full"):
        simulate(config, RunFolder(output, config))
    record = json.loads((output / "run.json").read_text())
    assert record["status"] == "refused"
    assert "LCC/compressed.nii.gz" in record["files"]
