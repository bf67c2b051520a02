"""What a user sees while a run's stages go on, above all that kernels are being compiled."""

import numba
import numpy as np
import pytest
from rich.console import Console

from mammosim._jit import watch_compiling
from mammosim.cli import progress as shown

ROW = np.array(
    [(6.0, 12.5, 1e-2, 33.0, 0.4)],
    [(name, float) for name in ("element_mm", "gap_mm", "out_of_balance", "force_n", "smallest_j")],
)[0]


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
    with shown.progress() as tell:
        tell("LCC", "compression", None)
        fresh_kernel(1)
        fresh_kernel(1.0)
        tell("LCC", "compression", ROW)
        tell("", "report", None)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "LCC: compression",
        "LCC: compression: compiling, once on a machine, a minute in all: fresh",
        "report",
    ]


def test_plain_lines_go_on_where_compiling_takes_long(fresh_kernel, capsys, monkeypatch):
    monkeypatch.setattr(shown, "SECONDS_A_LINE", 0.0)
    with shown.progress() as tell:
        tell("LCC", "compression", None)
        fresh_kernel(1)
        fresh_kernel(1.0)
        tell("LCC", "compression", ROW)
    lines = capsys.readouterr().err.splitlines()
    assert [line.endswith("fresh") for line in lines] == [False, True, True, False]
    assert "12.5 mm" in lines[3]


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
    with shown.progress() as tell:
        tell("LCC", "compression", None)
        fresh_kernel(1)
        tell("LCC", "compression", ROW)
    assert str(texts[0]) == str(texts[2]) == "LCC: compression"
    assert str(texts[1]).startswith("LCC: compression: compiling")
    assert str(texts[3]).startswith("LCC: compression: 6 mm elements")
