"""Signals that end a command: Ctrl-C, and SIGTERM, by which SLURM and Kubernetes end a job."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

RETRY_S = 0.05
"""After which a signal that came at a bad moment is sent again, s."""

NOT_WITHIN = ("llvmlite", "pydantic")
"""Packages whose compiled code swallows an exception: the first while a kernel is compiled, after
which it crashes, the second while settings are checked or written out."""

NOT_IN = ("numba.core.compiler_lock", "contextlib")
"""Modules in whose functions a lock of Numba's may just have been taken, or be about to be given
back: an exception there would leave it taken, and every thread that loads a kernel waiting."""


@contextmanager
def signals_interrupt() -> Iterator[Callable[[], None]]:
    """Let SIGTERM interrupt as Ctrl-C does, and neither of them in the middle of compiling.

    Where an exception would do harm, the signal is sent again a moment later.

    Yields
    ------
    callable
        Interrupts if a signal came before; called between steps of the work. An exception is lost
        where Python calls code that nobody waits for, as when an object is deleted: the work would
        go on as if nobody had stopped it.
    """
    came: list[str] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        if _is_within(frame, NOT_WITHIN) or _module(frame) in NOT_IN:
            threading.Timer(RETRY_S, os.kill, (os.getpid(), number)).start()
            return
        came.append(f"the run was interrupted by {signal.Signals(number).name}")
        raise KeyboardInterrupt(came[0])

    def interrupt_if_one_came() -> None:
        if came:
            raise KeyboardInterrupt(came[0])

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield interrupt_if_one_came
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _is_within(frame: FrameType | None, packages: tuple[str, ...]) -> bool:
    """Whether any function on the stack belongs to one of some packages."""
    while frame is not None:
        if _module(frame).partition(".")[0] in packages:
            return True
        frame = frame.f_back
    return False


def _module(frame: FrameType | None) -> str:
    """Name of the module that a function belongs to; empty without one."""
    return str(frame.f_globals.get("__name__", "")) if frame is not None else ""
