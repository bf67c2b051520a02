"""The command `mammosim` itself: its options, what it prints to, and its exit status."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from mammosim.errors import InputError, Interrupted, MammosimError, NotConverged

if TYPE_CHECKING:
    from collections.abc import Iterator

BAD_INPUT, UNCONVERGED, INTERRUPTED = 2, 3, 130

app = typer.Typer(
    help="Synthetic mammograms from labelled voxel breasts, and where each lesion went.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
out, err = Console(soft_wrap=True), Console(stderr=True, soft_wrap=True)
_debug = False


def main() -> None:
    """Entry point of the command `mammosim`."""
    app()


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option(help="Show tracebacks of errors.")] = False,
    version: Annotated[bool, typer.Option(help="Print the version and stop.")] = False,
) -> None:
    global _debug
    _debug = debug
    if version:
        from mammosim._version import VERSION

        out.print(VERSION)
        raise typer.Exit


@contextmanager
def exit_status() -> Iterator[None]:
    """Turn the package's errors into plain lines and the exit status that belongs to them."""
    try:
        yield
    except MammosimError as error:
        if _debug:
            raise
        for line in getattr(error, "problems", None) or str(error).splitlines():
            err.print(f"[bold red]error:[/] {plain(line)}", highlight=False)
        kinds = {InputError: BAD_INPUT, NotConverged: UNCONVERGED, Interrupted: INTERRUPTED}
        raise typer.Exit(kinds.get(type(error), 1)) from None
    except KeyboardInterrupt:
        err.print("[bold red]interrupted[/]")
        raise typer.Exit(INTERRUPTED) from None


def plain(text: str) -> str:
    """Text that Rich prints as it is."""
    return text.replace("[", r"\[")


def check_output(path: Path, resume: bool, overwrite: bool) -> None:
    """Refuse a folder that holds something, unless it is to be resumed or overwritten.

    Raises
    ------
    InputError
        If the folder is not empty, or is no folder.
    """
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is not a folder, cannot be a run's output")
    if path.is_dir() and any(path.iterdir()) and not (resume or overwrite):
        raise InputError(
            f"{path}: exists and is not empty; give --resume, --overwrite, or another --output"
        )
