"""What a run does to its folder: nothing before it begins, and never to what is not its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import wraps
from pathlib import Path

import pytest
from make_run import SMALL, invoke, save_breast, write
from numba.core.compiler_lock import global_compiler_lock
from pydantic import BaseModel, field_serializer

from mammosim import load_config, simulate
from mammosim.cli.signals import signals_interrupt
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.pipeline import RunFolder
from mammosim.pipeline.folder import run_folder
from mammosim.pipeline.run import observer

pytestmark = pytest.mark.usefixtures("breasts_are_made_once")

GENERATED = {
    **SMALL,
    "phantom": {"generate": {"volume_ml": 200, "voxel_mm": 3.0, "density": "fatty"}},
    "compression": {"model": "springs", "resolution_mm": 6.0},
    "projection": {"pixel_mm": 1.0},
    "views": ["CC"],
}


@pytest.fixture
def user(tmp_path) -> Path:
    return save_breast(tmp_path)


def status_of(folder: Path) -> str:
    return json.loads((folder / "run.json").read_text())["status"]


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize(
    "bad",
    [
        {"acquisition": {"composition": "misspelt.yaml"}},
        {"projection": {"pixel_mm": 1e-5}},
        {"compression": {"model": "springs", "resolution_mm": 6.0, "thickness_mm": 400}},
    ],
)
def test_a_refused_run_leaves_nothing_and_its_correction_runs(user, bad):
    output = user / "runs" / "a"
    result = invoke("run", write(user, **{**GENERATED, **bad}), "--output", output)
    assert result.exit_code == 2, result.output
    assert not output.exists()
    assert not output.parent.exists()
    assert invoke("run", write(user, **GENERATED), "--output", output).exit_code == 0


def test_files_of_others_stay_and_are_never_replaced(user):
    output = user / "mine"
    output.mkdir()
    (output / "notes.txt").write_text("mine")
    (output / "lesions.csv").write_text("mine, too")
    before = contents(output)
    result = invoke("run", write(user, **GENERATED), "--output", output, "--overwrite")
    assert result.exit_code == 2
    assert "lesions.csv: would be replaced, but" in result.output
    assert contents(output) == before
    (output / "lesions.csv").unlink()
    assert invoke("run", write(user, **GENERATED), "--output", output, "--overwrite").exit_code == 0
    assert (output / "notes.txt").read_text() == "mine"


def test_what_a_run_reads_is_never_replaced(user):
    (user / "out").mkdir()
    for file in user.glob("breast*"):
        shutil.copy(file, user / "out" / file.name)
    config = write(user, phantom={"file": "out/breast.npz"})
    before = contents(user / "out")
    result = invoke("run", config, "--output", user / "out", "--overwrite")
    assert result.exit_code == 2
    assert "phantom.file" in result.output
    assert "lies in the output folder" in result.output
    assert contents(user / "out") == before


def test_the_configuration_itself_is_never_replaced(user):
    output = user / "out"
    assert invoke("run", write(user, **GENERATED), "--output", output).exit_code == 0
    before = contents(output)
    result = invoke("run", output / "config.yaml", "--output", output, "--overwrite")
    assert result.exit_code == 2
    assert "is read by this run, which would replace it" in result.output
    assert contents(output) == before


@pytest.mark.parametrize("name", ["LCC", ".stages"])
def test_a_file_where_a_folder_is_made_is_refused_before_anything_is_computed(user, name):
    output = user / "out"
    output.mkdir()
    (output / name).write_text("mine")
    result = invoke("run", write(user, **GENERATED), "--output", output, "--overwrite")
    assert result.exit_code == 2
    assert "is a file where this run makes a folder" in result.output
    assert contents(output) == {name: b"mine"}


@pytest.mark.parametrize("target", ["elsewhere", "breast.npz", "nowhere"])
@pytest.mark.parametrize("name", ["LCC", ".stages"])
def test_links_in_the_folder_are_not_written_through(user, name, target):
    elsewhere, output = user / "elsewhere", user / "out"
    elsewhere.mkdir()
    output.mkdir()
    (output / name).symlink_to(user / target)
    for way in ("--overwrite", "--resume"):
        result = invoke("run", write(user, **GENERATED), "--output", output, way)
        assert result.exit_code == 2
        assert "does not write through links" in result.output
    assert list(elsewhere.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes into read-only folders")
def test_a_finished_run_is_resumed_in_a_read_only_folder(user):
    output = user / "out"
    config = write(user, **GENERATED)
    assert invoke("run", config, "--output", output).exit_code == 0
    output.chmod(0o555)
    try:
        assert invoke("run", config, "--output", output, "--resume").exit_code == 0
    finally:
        output.chmod(0o755)


def test_resuming_a_finished_run_writes_nothing(user, monkeypatch):
    """What a read-only folder asks for, also where the tests run as root."""
    output = user / "out"
    config = write(user, **GENERATED)
    assert invoke("run", config, "--output", output).exit_code == 0
    monkeypatch.setattr("mammosim.pipeline.writing", _refused)
    result = invoke("run", config, "--output", output, "--resume")
    assert result.exit_code == 0
    assert "already finished" in result.output


def _refused(*arguments, **keys):
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("stage", ["project", "find_targets"])
def test_a_folder_that_vanishes_is_an_error(user, monkeypatch, stage):
    output = user / "out"
    config = load_config(write(user, **GENERATED))
    from mammosim.pipeline.run import simulation

    original = getattr(simulation, stage)

    def vanish(*arguments, **keys):
        while not (output / "LCC" / "labels.ctbl").exists():  # the last that a thread writes beside
            time.sleep(0.01)
        shutil.rmtree(output)
        return original(*arguments, **keys)

    vanish.__name__ = stage
    monkeypatch.setattr(simulation, stage, vanish)
    with pytest.raises(InputError, match="was removed during the run"):
        simulate(config, RunFolder(output, config))
    assert not output.exists()  # it is noticed before anything more is written


def test_a_later_refusal_marks_what_was_reached(user, monkeypatch):
    from mammosim.pipeline.run import simulation

    def refuse(*arguments, **keys):
        raise InputError("projection.detector_mm: too small")

    refuse.__name__ = "project"
    monkeypatch.setattr(simulation, "project", refuse)
    output, config = user / "out", load_config(write(user, **GENERATED))
    with pytest.raises(InputError, match="too small"):
        simulate(config, RunFolder(output, config))
    assert status_of(output) == "refused"
    assert (output / "LCC" / "compression.json").exists()


def test_not_converged_counts_more_than_what_it_leads_to(user, monkeypatch):
    from mammosim.pipeline.run import simulation

    original = simulation.compress

    def stopped(*arguments, **keys):
        raise NotConverged("LCC: stopped too early", original(*arguments, **keys))

    def refuse(*arguments, **keys):
        raise InputError("projection.detector_mm: too small")

    stopped.__name__, refuse.__name__ = "compress", "project"
    monkeypatch.setattr(simulation, "compress", stopped)
    monkeypatch.setattr(simulation, "project", refuse)
    output, config = user / "out", load_config(write(user, **GENERATED))
    with pytest.raises(NotConverged, match="stopped too early"):
        simulate(config, RunFolder(output, config))
    assert status_of(output) == "not converged"


@pytest.mark.parametrize(
    "stage", ["make_phantom", "compress", "project", "expose", "find_targets", "exam_results"]
)
def test_an_interruption_at_any_stage_leaves_a_marked_record(user, monkeypatch, stage):
    from mammosim.pipeline.run import simulation

    def interrupted(*arguments, **keys):
        raise KeyboardInterrupt

    interrupted.__name__ = stage
    monkeypatch.setattr(simulation, stage, interrupted)
    output, config = user / "out", load_config(write(user, **GENERATED))
    with pytest.raises(Interrupted):
        simulate(config, RunFolder(output, config))
    assert status_of(output) == "interrupted"


def test_an_interruption_while_a_view_is_written_leaves_a_marked_record(user, monkeypatch):
    def interrupted(*arguments, **keys):
        raise KeyboardInterrupt

    monkeypatch.setattr(run_folder, "write_compressed", interrupted)
    output, config = user / "out", load_config(write(user, **GENERATED))
    with pytest.raises(Interrupted):
        simulate(config, RunFolder(output, config))
    assert status_of(output) == "interrupted"


def test_a_signal_while_settings_are_written_out_is_not_lost():
    class Model(BaseModel):
        value: int = 1

        @field_serializer("value")
        def send(self, value: int) -> int:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.001)
            return value

    def write_out() -> None:
        with signals_interrupt():
            Model().model_dump()
            time.sleep(5)

    with pytest.raises(KeyboardInterrupt, match="SIGTERM"):
        write_out()


def test_a_signal_that_comes_as_numba_takes_its_lock_does_not_leave_it_taken():
    """Another thread that loads a kernel would wait for it, and the run for that thread."""

    def trace(frame, event, _):
        if frame.f_code is not type(global_compiler_lock).acquire.__code__:
            return None
        if event == "return":
            sys.settrace(before)
            signal.getsignal(signal.SIGINT)(signal.SIGINT, frame)
        return trace

    def take_it() -> None:
        with ExitStack() as stack:
            stack.enter_context(global_compiler_lock)
            time.sleep(5)

    before = sys.gettrace()
    with signals_interrupt():
        sys.settrace(trace)
        with pytest.raises(KeyboardInterrupt, match="SIGINT"):
            take_it()

    def is_free() -> bool:
        taken = global_compiler_lock._lock.acquire(False)
        if taken:
            global_compiler_lock._lock.release()
        return taken

    with ThreadPoolExecutor(1) as other:
        assert other.submit(is_free).result()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_signal_that_was_lost_interrupts_at_the_next_step():
    """Python prints an exception in a destructor, and goes on."""

    class Last:
        def __del__(self) -> None:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.001)

    with signals_interrupt() as interrupt_if_one_came:
        interrupt_if_one_came()
        Last()
        with pytest.raises(KeyboardInterrupt, match="SIGINT"):
            interrupt_if_one_came()


def test_a_run_from_which_a_signal_was_lost_ends_at_its_next_stage(user, monkeypatch):
    from mammosim.pipeline.run import simulation

    make_phantom = simulation.make_phantom

    @wraps(make_phantom)
    def losing(*arguments, **keys):
        with suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(1.0)
        return make_phantom(*arguments, **keys)

    monkeypatch.setattr(simulation, "make_phantom", losing)
    output = user / "out"
    result = invoke("run", write(user, **GENERATED), "--output", output)
    assert result.exit_code == 130, result.output
    assert "SIGTERM" in result.output
    assert status_of(output) == "interrupted"
    assert not (output / "LCC").exists()


def test_an_interruption_in_the_report_leaves_a_marked_record(user, monkeypatch):
    from mammosim.pipeline.folder import run_folder

    def interrupted(*arguments, **keys):
        raise KeyboardInterrupt

    monkeypatch.setattr(run_folder, "render_report", interrupted)
    config = {**GENERATED, "report": {"html": True}}
    output, config = user / "out", load_config(write(user, **config))
    with pytest.raises(Interrupted) as stop:
        simulate(config, RunFolder(output, config))
    assert status_of(output) == "interrupted"
    assert list(stop.value.reached.views) == ["LCC"]
    assert (output / "lesions.csv").exists()


def test_signals_are_held_while_the_record_is_written():
    with observer.signals_held():
        os.kill(os.getpid(), signal.SIGTERM)  # would end this test
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("delay_s", [0.0, 0.3, 0.8])
def test_a_signal_ends_a_run_in_order(user, number, delay_s):
    """Also where it comes while a kernel is compiled or loaded."""
    output = user / "out"
    command = [sys.executable, "-m", "mammosim", "run", str(write(user, **GENERATED))]
    with subprocess.Popen(
        [*command, "--output", str(output)], stderr=subprocess.PIPE, text=True
    ) as run:
        for line in run.stderr:
            if "compressing" in line:
                break
        time.sleep(delay_s)
        run.send_signal(number)
        rest = run.stderr.read()
    assert run.returncode == 130, rest
    assert "Traceback" not in rest
    assert status_of(output) == "interrupted"
