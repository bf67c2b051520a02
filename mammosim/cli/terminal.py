"""The command `mammosim` itself: its options, what it prints to, and its exit status."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from unicodedata import category

import typer
from rich.console import Console
from rich.text import Text

from mammosim.cli.streams import (
    WatchedStream,
    hold_standard_streams,
    in_utf8_mode,
    restart_in_utf8_mode,
)
from mammosim.errors import InputError, Interrupted, MammosimError, NotConverged

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

BAD_INPUT, UNCONVERGED, INTERRUPTED = 2, 3, 130
"""Exit statuses: 2 as of wrong usage in other programs, 130 as of Ctrl-C in a shell, 3 our own."""

STEERING = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode's categories of control and formatting characters, surrogates and line ends."""

app = typer.Typer(
    help="Synthetic mammograms from labelled voxel breasts, and where each lesion went.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
# Names of lesions and files may look like markup or an emoji's name: nothing is interpreted.
out = Console(soft_wrap=True, markup=False, emoji=False, highlight=False)
err = Console(stderr=True, soft_wrap=True, markup=False, emoji=False, highlight=False)
_debug = False
_result_is_text = True
_is_command = False


def main() -> None:
    """Entry point of the command `mammosim`."""
    global _is_command
    _is_command = True
    hold_standard_streams()
    if not in_utf8_mode():
        restart_in_utf8_mode()
    output, errors = WatchedStream(sys.stdout), WatchedStream(sys.stderr)
    sys.stdout, sys.stderr = output, errors
    status: int | str | None = 0
    try:
        _refuse_odd_arguments(sys.argv[1:])
        app(prog_name="mammosim")  # so that completion works however it was started
    except SystemExit as end:
        status = end.code
    output.flush()
    if output.failed is not None and not output.is_gone:
        say_error(f"standard output: cannot be written ({output.failed.strerror})")
        status = status or (BAD_INPUT if _result_is_text else 0)
    elif output.is_gone and status == 1:
        status = 0  # Click's own status where the reader has gone
    errors.flush()
    sys.exit(status)


def is_command() -> bool:
    """Whether this process is the command itself, and not a program that calls its functions."""
    return _is_command


def _refuse_odd_arguments(arguments: list[str]) -> None:
    """Refuse what is not UTF-8: no record could name it."""
    for argument in arguments:
        if any("\ud800" <= letter <= "\udfff" for letter in argument):
            say_error(f"found {argument!a:.200}, which is not UTF-8; rename the file or folder")
            sys.exit(BAD_INPUT)


def _print_version(wanted: bool) -> None:
    if wanted:
        from mammosim._version import VERSION

        say(VERSION)
        raise typer.Exit


@app.callback()
def _options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of errors.")] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version and stop."
        ),
    ] = False,
) -> None:
    global _debug
    _debug = debug


@contextmanager
def exit_status(result_is_text: bool = False) -> Iterator[None]:
    """Turn the package's errors into plain lines and the exit status that belongs to them.

    Parameters
    ----------
    result_is_text : bool
        Whether what the command prints is its result, so that it has failed where that cannot be
        written; else its result is on the disk.
    """
    global _result_is_text
    _result_is_text = result_is_text
    try:
        yield
    except (MammosimError, MemoryError) as error:
        if _debug:
            raise
        for line in _lines_of(error):
            say_error(line)
        kinds: dict[type, int] = {NotConverged: UNCONVERGED, Interrupted: INTERRUPTED}
        raise typer.Exit(kinds.get(type(error), BAD_INPUT)) from None
    except OSError as error:  # of a folder: a file's is an InputError with the key that names it
        if _debug:
            raise
        place = f"{error.filename}: " if error.filename is not None else ""
        say_error(f"{place}cannot be used ({error.strerror or error})")
        raise typer.Exit(BAD_INPUT) from None
    except KeyboardInterrupt:
        err.print(Text("interrupted", style="bold red"))
        raise typer.Exit(INTERRUPTED) from None


def print_warnings(notes: Iterable[str]) -> None:
    """Print what the author of a result should know, one line each, repeated ones once."""
    for note in dict.fromkeys(notes):
        err.print(Text.assemble(("warning:", "bold yellow"), " ", printable(note)))


def _lines_of(error: BaseException) -> tuple[str, ...]:
    if isinstance(error, InputError):
        return error.problems
    if isinstance(error, MemoryError):
        return (f"not enough memory{f' ({error})' if str(error) else ''}; see mammosim check",)
    return tuple(str(error).splitlines())


def say(text: str) -> None:
    """Print a line unchanged on standard output."""
    out.print(Text(printable(text)))


def say_error(text: str) -> None:
    """Print a line unchanged on standard error, marked as an error."""
    err.print(Text.assemble(("error:", "bold red"), " ", printable(text)))


def say_progress(text: str) -> None:
    """Print a line unchanged on standard error."""
    err.print(Text(printable(text)))


def printable(text: str) -> str:
    r"""Text without characters that steer a terminal: those become escapes.

    Examples
    --------
    >>> printable("mass\x1b[2J")
    'mass\\x1b[2J'
    """
    return "".join(
        ascii(letter)[1:-1] if category(letter) in STEERING else letter for letter in text
    )


def check_output(path: Path, resume: bool, overwrite: bool) -> None:
    """Refuse a folder that holds something, unless it is to be resumed or overwritten.

    Raises
    ------
    InputError
        If the folder is not empty, or is no folder.
    """
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is not a folder, so it cannot be a run's output")
    if path.is_dir() and any(path.iterdir()) and not (resume or overwrite):
        raise InputError(
            f"{path}: exists and is not empty; give --resume, --overwrite, or another --output"
        )
