"""Interruptions that wait until a result is kept: none costs a field that was solved."""

from __future__ import annotations

import json
import signal
import threading

import numba
import numpy as np
import pytest
from make_run import FEW_PHOTONS

from mammosim._crew import Crew, crew_of_thread
from mammosim._interruption import (
    hold_interruptions,
    interruptible,
    interruptions_wait,
    until_kept,
)
from mammosim._jit import kernel_threads
from mammosim.cli.signals import signals_interrupt
from mammosim.compression import hyperelastic_model, spring_model
from mammosim.config import to_settings
from mammosim.errors import Interrupted
from mammosim.export import read_displacement
from mammosim.pipeline import RunConfig, RunFolder, simulate
from mammosim.pipeline.run import simulation


def test_a_signal_waits_for_the_end_of_the_outermost_block():
    done = []

    def solve() -> None:
        with until_kept():
            with until_kept():
                hold_interruptions()
                signal.raise_signal(signal.SIGTERM)
                done.append("solved")
            done.append("kept")
        done.append("went on")

    with signals_interrupt():
        with pytest.raises(KeyboardInterrupt, match="SIGTERM"):
            solve()
        assert done == ["solved", "kept"]
        assert not interruptions_wait()


def test_a_signal_is_not_held_where_nobody_keeps_a_result():
    before = signal.getsignal(signal.SIGINT)
    hold_interruptions()
    assert not interruptions_wait()
    assert signal.getsignal(signal.SIGINT) is before


def test_a_step_that_gives_back_what_it_reached_is_interrupted_at_once():
    reached = []

    def solve() -> None:
        hold_interruptions()
        for number in range(3):
            try:
                with interruptible():
                    reached.append(number)
                    signal.raise_signal(signal.SIGINT)
                    reached.append("never")
            except KeyboardInterrupt:
                return

    with until_kept():
        solve()
    assert reached == [0]


def test_a_signal_that_waits_interrupts_the_next_such_step():
    reached = []

    def solve() -> None:
        hold_interruptions()
        signal.raise_signal(signal.SIGINT)
        reached.append("force")
        with interruptible():
            reached.append("step")

    def whole() -> None:
        with until_kept():
            solve()

    with pytest.raises(KeyboardInterrupt):
        whole()
    assert reached == ["force"]
    assert not interruptions_wait()


def test_kernels_of_a_crew_that_is_stopped_run_until_the_result_is_kept():
    crew, seen = Crew(2), []

    def work() -> None:
        with crew.at_work():
            with until_kept():
                hold_interruptions()
                crew.stop()
                seen.append(kernel_threads())
            try:
                kernel_threads()
            except KeyboardInterrupt:
                seen.append("stopped")

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [2, "stopped"]


@pytest.mark.parametrize(
    "at_once",
    [
        1,
        pytest.param(
            2,
            marks=pytest.mark.skipif(
                numba.config.NUMBA_NUM_THREADS == 1, reason="views are made in turn"
            ),
        ),
    ],
)
@pytest.mark.usefixtures("breasts_are_made_once")
@pytest.mark.parametrize("model", ["hyperelastic", "springs"])
def test_a_run_stopped_between_solution_and_file_keeps_the_field(
    model, at_once, tmp_path, monkeypatch
):
    """A signal comes, or the other view is stopped, when the solver has just ended."""
    module = {"hyperelastic": hyperelastic_model, "springs": spring_model}[model]
    result = module._result

    def stopped(breast, view, *others):
        crew = crew_of_thread()
        if crew is None:
            signal.raise_signal(signal.SIGTERM)
        elif view.name == "CC":
            crew.stop()
        return result(breast, view, *others)

    monkeypatch.setattr(module, "_result", stopped)
    monkeypatch.setattr(simulation, "views_at_once", lambda config: at_once)
    sections = {
        "phantom": {"generate": {"volume_ml": 250, "voxel_mm": 3.0}},
        "compression": {"model": model, "resolution_mm": 8.0},
        "projection": {"pixel_mm": 1.0},
        "acquisition": FEW_PHOTONS,
        "report": {"html": False},
        "views": ["CC"] if at_once == 1 else ["CC", "MLO"],
    }
    config = to_settings(RunConfig, sections, "test")
    output = tmp_path / "run"
    with signals_interrupt(), pytest.raises(Interrupted) as caught:
        simulate(config, RunFolder(output, config))
    assert json.loads((output / "run.json").read_text())["status"] == "interrupted"
    assert not (output / "LCC" / "mammogram.tif").exists()
    reached = caught.value.reached.views["LCC"].compressed
    assert reached.converged
    found = read_displacement(
        output / "LCC" / "displacement.nii.gz", output / "LCC" / "lattice.nii.gz", reached.view
    )
    np.testing.assert_allclose(found.displacement_mm, reached.field.displacement_mm, atol=1e-4)
