"""Progress of a run: the stage, per cent and expected end; the solver's numbers where asked for."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager, nullcontext
from datetime import datetime
from math import isfinite
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.text import Text

from mammosim.cli.terminal import err, printable, say_progress

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mammosim.pipeline import Plan

SECONDS_PER_LINE = 30.0
"""Between two lines of a stage's progress where there is no terminal."""

SECONDS_PER_VIEW = 2.0
"""How long the stage of one view is shown before that of another made at the same time."""

SECONDS_PER_EVENT = 0.1
"""Between two rows of a solver's history that are reported to another program."""

COMPILING_S = {"phantom": 20, "compression": 30, "projection": 6, "acquisition": 6}
"""Seconds that a stage's kernels take to compile, all of them together: processor seconds measured
for the quickstart with little else running (20.4, 27.6, 5.3 and 5.6, and 5.2 shared by all)."""


@contextmanager
def progress(plan: Plan, verbose: bool = False) -> Iterator[Any]:
    """Show how far a run is: a moving line on a terminal, plain lines now and then elsewhere.

    Parameters
    ----------
    plan : Plan
        Of the run.
    verbose : bool
        Whether to show the solver's numbers too.
    """
    from mammosim._jit import watch_compiling  # here, as Numba takes a while to load
    from mammosim.pipeline import RunProgress

    with _moving_line() if err.is_terminal else nullcontext(_line_now_and_then()) as show:
        run = RunProgress(plan)
        shown, began = _ShownStage(), dict[str, float]()
        explained, compiling = False, _compiling_in_words("")

        def line() -> str:
            return f"{shown.text} ({run.sentence(datetime.now())})"

        def on_progress(view: str, stage: str, row: Any) -> None:
            nonlocal explained, compiling
            is_shown = shown.take(view, stage, row is None)
            if row is None:
                run.report(view, stage)
                began[view], explained = monotonic(), False
                compiling = _compiling_in_words(stage)
                show(line(), at_once=True)
            elif is_shown:
                seconds = monotonic() - began.get(view, monotonic())
                show(line() + (f", {row_text(row, seconds)}" if verbose else ""))

        def on_compiling(kernel: str | None) -> None:
            nonlocal explained
            if kernel is None:
                if err.is_terminal:
                    show(line())
            elif explained and not err.is_terminal:
                show(line() + (f", compiling {kernel}" if verbose else ""))
            else:
                named = f": {kernel}" if verbose else ""
                show(f"{shown.text}: {compiling}{named}", at_once=not explained)
                explained = True

        with watch_compiling(on_compiling):
            yield on_progress


class _ShownStage:
    """The stage that is shown, of views that may be made at the same time.

    It is the one that was reported last, but that of another view at once only where it begins.
    """

    def __init__(self) -> None:
        self.text = "starting"
        self._view, self._since = "", 0.0

    def take(self, view: str, stage: str, begins: bool) -> bool:
        """Note what is reported; whether it is shown."""
        from mammosim.pipeline import stage_in_words

        now = monotonic()
        if view != self._view:
            if not begins and now - self._since < SECONDS_PER_VIEW:
                return False
            self._view, self._since = view, now
        self.text = stage_in_words(view, stage)
        return True


def _compiling_in_words(stage: str) -> str:
    """What is compiled in a stage, and how long that takes in all."""
    seconds = COMPILING_S.get(stage)
    lasts = "a few seconds" if seconds is None else f"about {seconds} s in all"
    return f"compiling this stage's code, only in the first run on a machine, {lasts}"


@contextmanager
def event_lines(plan: Plan) -> Iterator[Any]:
    """Print progress as JSON, one line per event, for a program that follows the run.

    Each has `view`, `stage`, `text`, `share` (0 to 1) and `row`: the solver's numbers or null.
    """
    from mammosim.pipeline import RunProgress

    run, shown, last = RunProgress(plan), _ShownStage(), 0.0

    def on_progress(view: str, stage: str, row: Any) -> None:
        nonlocal last
        shown.take(view, stage, row is None)
        if row is None:
            run.report(view, stage)
        elif monotonic() - last < SECONDS_PER_EVENT:
            return
        else:
            last = monotonic()
        numbers = None if row is None else _numbers(row)
        text = f"{shown.text} ({run.sentence(datetime.now())})"
        event = {"view": view, "stage": stage, "text": text, "share": run.share, "row": numbers}
        sys.stdout.write(json.dumps(event) + "\n")
        sys.stdout.flush()

    yield on_progress


def _numbers(row: Any) -> dict[str, float]:
    """The finite numbers of a row of a solver's history."""
    found = {name: row[name] for name in row.dtype.names if row.dtype[name].kind in "fiu"}
    return {name: float(value) for name, value in found.items() if isfinite(value)}


@contextmanager
def _moving_line() -> Iterator[Callable[..., None]]:
    """Show a text in place of the one before."""
    with err.status("starting") as status:

        def show(text: str, at_once: bool = False) -> None:
            view, colon, stage = printable(text).partition(": ")
            status.update(Text.assemble((view, "bold"), colon, stage))

        yield show


def _line_now_and_then() -> Callable[..., None]:
    """Print a text at once, or if nothing was printed for a while."""
    last_line = monotonic()

    def show(text: str, at_once: bool = False) -> None:
        nonlocal last_line
        if at_once or monotonic() - last_line > SECONDS_PER_LINE:
            last_line = monotonic()
            say_progress(text)

    return show


def row_text(row: Any, seconds: float) -> str:
    """A row of a solver's history in a few words, `seconds` after the stage began."""
    if "sweep" in row.dtype.names:
        nodes = max(int(row["nodes_counted"]), 1)
        means = ", ".join(f"{axis} {row[f'sum_d{axis}_voxel'] / nodes:.1e}" for axis in "xyz")
        left = row["sweeps_left"] * seconds / row["sweep"]
        end = f", about {left / 60:.1f} min left" if isfinite(left) else ""
        return (
            f"sweep {row['sweep']}{end}, mean displacement {means} voxel, volume "
            f"{-row['volume_change_percent']:+.1f} %, {row['inverted_cells']} cells inverted"
        )
    if "element_mm" in row.dtype.names:
        return (
            f"{row['element_mm']:g} mm elements, gap {row['gap_mm']:.1f} mm: residual force "
            f"{row['out_of_balance']:.1e}, {row['force_n']:.1f} N, minimum J "
            f"{row['smallest_j']:.2f}"
        )
    return (
        f"{row['nodes']} nodes, {row['axis']}: error {row['error_estimate_voxel']:.1e} voxel, "
        f"{row['nodes_held']} held by the plates"
    )
