"""Commands about cohorts: run, status."""

from __future__ import annotations

from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer

from mammosim._wording import counted
from mammosim.cli.signals import signals_interrupt
from mammosim.cli.terminal import (
    UNCONVERGED,
    app,
    check_output,
    err,
    exit_status,
    print_warnings,
    say,
    say_progress,
)
from mammosim.plausibility import patients_beyond

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mammosim.cohort import CohortStatus, Progress

SECONDS_PER_LINE = 10.0
"""Between two lines of progress where there is no terminal."""

MAX_REASONS = 20
"""Failures that are printed; `failures.csv` has all."""

cohort = typer.Typer(help="Many virtual patients from one file.", no_args_is_help=True)
app.add_typer(cohort, name="cohort")


@cohort.command("run")
def run(
    description: Annotated[
        Path, typer.Argument(metavar="COHORT", help="A run's configuration with distributions.")
    ],
    output: Annotated[
        Path | None, typer.Option(help="The cohort's folder; default runs/ and the file's name.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Address of a Dask scheduler; default: this machine."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Number of workers on this machine; default: as many as fit."),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.KEY=VALUE", help="Another value for a key."),
    ] = None,
    resume: Annotated[bool, typer.Option(help="Continue with what is in the folder.")] = False,
) -> None:
    """Simulate all patients of a cohort and write one table."""
    with exit_status():
        from mammosim.cohort import cohort_status, load_cohort, run_cohort

        described = load_cohort(description, change or ())
        folder = output or Path("runs") / described.title
        check_output(folder, resume, overwrite=False)
        with signals_interrupt(), _progress() as on_progress:
            done = run_cohort(
                described, folder, scheduler=scheduler, workers=workers, on_progress=on_progress
            )
        say(done.sentence(datetime.now()))
        say(f"results in {folder}; open {folder / 'summary.html'}")
        print_warnings(_warned(cohort_status(folder)))
        if done.failed:
            say_progress(f"{counted(done.failed, 'patient')} failed: see {folder / 'failures.csv'}")
            raise typer.Exit(UNCONVERGED)


@cohort.command("status")
def status(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A cohort's folder.")],
) -> None:
    """Show the state of a cohort's folder."""
    with exit_status(result_is_text=True):
        from mammosim.cohort import cohort_status

        found = cohort_status(folder)
        progress = found.progress
        if found.active:
            say(f"at work: {progress.sentence(datetime.now())}")
        else:
            rest = progress.waiting
            say(
                f"{progress.done} of {progress.patients} done, {progress.failed} failed, "
                f"{rest} not started" + ("; --resume continues" if rest or progress.failed else "")
            )
        for index, reason in list(found.failures.items())[:MAX_REASONS]:
            say(f"patient {index}: {reason}")
        print_warnings(_warned(found))


def _warned(found: CohortStatus) -> list[str]:
    """How many patients have a warning by each limit, and where all of them are."""
    if not found.warnings:
        return []
    counts = (f"{name}: {n}" for name, n in patients_beyond(found.warnings).items())
    warned = counted(len(found.warnings), "patient")
    return [f"{warned} with warnings, see warnings.csv ({', '.join(counts)})"]


@contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """One moving line on a terminal; elsewhere a line now and then, if something has changed.

    None at the end: the command's result says it, perhaps in the same file.
    """
    if err.is_terminal:
        with err.status("starting workers") as line:
            yield lambda progress: line.update(progress.sentence(datetime.now()))
        return
    last = monotonic() - SECONDS_PER_LINE
    said: tuple[int, ...] = ()

    def log(progress: Progress) -> None:
        nonlocal last, said
        counts = (progress.done, progress.failed, progress.running, progress.workers)
        due = counts != said and monotonic() - last >= SECONDS_PER_LINE
        if due and not progress.ended:
            last, said = monotonic(), counts
            say_progress(progress.sentence(datetime.now()))

    yield log
