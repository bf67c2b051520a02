"""What a user sees while a run's stages go on, above all that kernels are being compiled."""

import re

import numba
import numpy as np
import pytest
from rich.console import Console

from mammosim._jit import watch_compiling
from mammosim.cli import cohorts
from mammosim.cli import progress as shown
from mammosim.cohort import Progress
from mammosim.pipeline import Plan, PlannedStage, RunProgress

END = re.compile(r"ends about [^)]*")

ROW = np.array(
    [(6.0, 12.5, 1e-2, 33.0, 0.4)],
    [(name, float) for name in ("element_mm", "gap_mm", "out_of_balance", "force_n", "smallest_j")],
)[0]


PLAN = Plan(
    (),
    1.0,
    (
        PlannedStage("", "phantom", 20.0),
        PlannedStage("CC", "compression", 40.0),
        PlannedStage("CC", "projection", 20.0),
        PlannedStage("MLO", "compression", 16.0),
        PlannedStage("", "export", 3.0),
        PlannedStage("", "report", 1.0),
    ),
)


@pytest.fixture
def fresh_kernel():
    """A kernel that nothing has compiled, with a step of its own."""

    @numba.njit
    def step(x):
        return x + 1

    @numba.njit
    def fresh(x):
        return 2 * step(x)

    return fresh


def test_a_kernel_is_told_of_when_it_begins_and_ends_and_only_once(fresh_kernel):
    told = []
    with watch_compiling(told.append):
        assert fresh_kernel(1) == 4
        assert fresh_kernel(2) == 6
    fresh_kernel(1.5)  # nobody watches
    assert told == ["fresh", None]


def test_a_kernel_that_fails_to_compile_ends_too(fresh_kernel):
    told = []
    with watch_compiling(told.append):
        with pytest.raises(numba.TypingError):
            fresh_kernel("text")
        fresh_kernel(1)
    assert told == ["fresh", None, "fresh", None]


def test_plain_lines_say_once_a_stage_that_kernels_are_compiled(fresh_kernel, capsys):
    with shown.progress(PLAN) as on_progress:
        on_progress("LCC", "compression", None)
        fresh_kernel(1)
        fresh_kernel(1.0)
        on_progress("LCC", "compression", ROW)
        on_progress("", "report", None)
    lines = [END.sub("ends", line) for line in capsys.readouterr().err.splitlines()]
    assert lines == [
        "LCC: compressing (20 %, ends)",
        "LCC: compressing: compiling this stage's code, only in the first run on a machine, "
        "about 30 s in all",
        "writing the report (99 %, ends)",
    ]


@pytest.mark.parametrize("verbose", [False, True])
def test_plain_lines_go_on_where_compiling_takes_long(fresh_kernel, capsys, monkeypatch, verbose):
    monkeypatch.setattr(shown, "SECONDS_PER_LINE", 0.0)
    with shown.progress(PLAN, verbose) as on_progress:
        on_progress("LCC", "compression", None)
        fresh_kernel(1)
        fresh_kernel(1.0)
        on_progress("LCC", "compression", ROW)
    lines = capsys.readouterr().err.splitlines()
    assert ["this stage's code" in line for line in lines] == [False, True, False, False]
    assert [line.endswith("fresh") for line in lines] == [False, verbose, verbose, False]
    assert END.sub("ends", lines[2]).startswith("LCC: compressing (20 %, ends)")
    assert ("12.5 mm" in lines[3]) == verbose


def test_a_terminal_shows_compiling_while_it_lasts(fresh_kernel, monkeypatch):
    console, texts = Console(stderr=True, force_terminal=True), []

    class Status:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def update(self, text):
            texts.append(text)

    monkeypatch.setattr(console, "status", lambda _: Status())
    monkeypatch.setattr(shown, "err", console)
    with shown.progress(PLAN, verbose=True) as on_progress:
        on_progress("LCC", "compression", None)
        fresh_kernel(1)
        on_progress("LCC", "compression", ROW)
    texts = [END.sub("ends", str(text)) for text in texts]
    assert texts[0] == texts[2] == "LCC: compressing (20 %, ends)"
    assert texts[1].startswith("LCC: compressing: compiling")
    assert texts[3].startswith("LCC: compressing (20 %, ends), 6 mm elements")


def test_solver_numbers_are_shown_only_where_they_are_asked_for(capsys, monkeypatch):
    monkeypatch.setattr(shown, "SECONDS_PER_LINE", -1.0)
    for verbose in (False, True):
        with shown.progress(PLAN, verbose) as on_progress:
            on_progress("LCC", "compression", None)
            on_progress("LCC", "compression", ROW)
        assert ("33.0 N" in capsys.readouterr().err) == verbose


class Clock:
    """Seconds that a test sets."""

    now = 0.0

    def __call__(self):
        return self.now


def test_the_share_follows_the_plan_and_the_end_the_pace():
    clock = Clock()
    run = RunProgress(PLAN, clock)
    assert (run.share, run.seconds_left) == (0.0, 100.0)  # nothing known but the plan
    run.report("", "phantom")
    clock.now = 40.0  # twice as long as planned
    run.report("LCC", "compression")
    assert run.share == pytest.approx(0.2)
    assert run.seconds_left == pytest.approx(160.0)
    clock.now = 60.0
    assert run.share == pytest.approx(0.4)
    clock.now = 600.0  # however long it takes, a stage is not done before the next begins
    assert run.share == pytest.approx(0.2 + 0.95 * 0.4)
    run.report("LCC", "volumes")  # not planned: what was going on is done
    assert run.share == pytest.approx(0.6)
    run.report("LCC", "projection")
    run.report("LCC", "targets")
    run.report("LMLO", "compression")
    assert run.share == pytest.approx(0.8)
    run.report("", "lesion shift")  # not planned
    assert run.share == pytest.approx(0.96)
    run.report("", "export")
    run.report("", "report")
    assert run.share == pytest.approx(0.99)  # what is written last counts too
    clock.now += 100.0
    assert run.share == pytest.approx(0.99 + 0.95 * 0.01)


def test_views_that_are_made_at_the_same_time_add_up():
    clock = Clock()
    run = RunProgress(PLAN, clock)
    run.report("", "phantom")
    run.report("LCC", "compression")
    run.report("LMLO", "compression")
    clock.now = 10.0
    assert run.share == pytest.approx(0.2 + 0.1 + 0.1)
    run.report("LMLO", "projection")  # not planned
    assert run.share == pytest.approx(0.2 + 0.1 + 0.16)
    run.report("LCC", "projection")
    assert run.share == pytest.approx(0.2 + 0.4 + 0.16)


def test_both_breasts_have_their_own_part_of_the_plan():
    both = (PlannedStage("CC", "compression", 10.0), PlannedStage("CC", "compression", 30.0))
    run = RunProgress(Plan((), 1.0, both), Clock())
    run.report("LCC", "compression")
    run.report("RCC", "compression")
    run.report("RCC", "targets")
    assert run.share == pytest.approx(0.75)


def test_a_stage_of_the_run_passes_over_what_was_not_reported():
    run = RunProgress(Plan((), 1.0, (*PLAN.stages, PlannedStage("", "biopsy", 100.0))), Clock())
    run.report("LCC", "compression")
    run.report("", "biopsy")
    assert run.share == pytest.approx(0.5)


def test_the_numbers_of_another_view_are_shown_after_a_while(capsys, monkeypatch):
    monkeypatch.setattr(shown, "SECONDS_PER_LINE", -1.0)
    with shown.progress(PLAN, verbose=True) as on_progress:
        on_progress("LCC", "compression", None)
        on_progress("LMLO", "compression", None)
        on_progress("LCC", "compression", ROW)  # too soon
        on_progress("LMLO", "compression", ROW)
        monkeypatch.setattr(shown, "SECONDS_PER_VIEW", -1.0)
        on_progress("LCC", "compression", ROW)
    lines = capsys.readouterr().err.splitlines()
    assert [(line.split(":")[0], "33.0 N" in line) for line in lines] == [
        ("LCC", False), ("LMLO", False), ("LMLO", True), ("LCC", True),
    ]  # fmt: skip


def test_a_cohort_says_nothing_twice(capsys, monkeypatch):
    monkeypatch.setattr(cohorts, "SECONDS_PER_LINE", 0.0)
    with cohorts._progress() as on_progress:
        for seconds in (10.0, 20.0):
            on_progress(Progress(3, made=1, running=2, workers=2, seconds=seconds))
        on_progress(Progress(3, made=2, running=1, workers=2, seconds=30.0))
        on_progress(Progress(3, made=3, workers=2, seconds=40.0))  # the result says it
    lines = capsys.readouterr().err.splitlines()
    assert [line[:11] for line in lines] == ["1 of 3 done", "2 of 3 done"]
