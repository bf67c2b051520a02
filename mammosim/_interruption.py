"""Interruptions that wait until a result is kept: a stop must not cost what was just solved.

A solver takes minutes, and what follows it (forces, the field, files) an instant. `until_kept` is
put around both; within it, the solver calls `hold_interruptions` once there is something to lose.
From there on an interruption comes only in those steps that are `interruptible`, which give back
what they reached, or else when `until_kept` ends.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""What ends a run: Ctrl-C, and what batch systems send."""


class _Wait(threading.local):
    """What a thread waits for: how many `until_kept` it is in, and whether interruptions wait."""

    depth = 0
    held = False
    let_through = False

    def __init__(self) -> None:
        self.handlers: dict[int, Any] = {}
        self.came: list[int] = []


_wait = _Wait()


def interruptions_wait() -> bool:
    """Whether an interruption of the calling thread has to wait now."""
    return _wait.held and not _wait.let_through


@contextmanager
def until_kept() -> Iterator[None]:
    """Around the computation of a result and what keeps it; the outermost of several counts."""
    _wait.depth += 1
    try:
        yield
    finally:
        _wait.depth -= 1
        if _wait.depth == 0:
            _release()


def hold_interruptions() -> None:
    """Let interruptions of the calling thread wait until the end of the outermost `until_kept`.

    Outside of one, nothing is held: nobody would keep the result.
    """
    if _wait.depth == 0 or _wait.held:
        return
    _wait.held = True
    if threading.current_thread() is threading.main_thread():  # no other gets signals
        _wait.handlers = {number: signal.signal(number, _note) for number in SIGNALS}


@contextmanager
def interruptible() -> Iterator[None]:
    """Around a step of a solver that gives back what it reached when it is interrupted."""
    before, _wait.let_through = _wait.let_through, True
    try:
        _send_what_came()
        yield
    finally:
        _wait.let_through = before


def _release() -> None:
    _wait.held = False
    for number, handler in _wait.handlers.items():
        signal.signal(number, signal.SIG_DFL if handler is None else handler)
    _wait.handlers = {}
    _send_what_came()


def _send_what_came() -> None:
    """Interrupt the main thread now by the first signal that had to wait."""
    if _wait.came:
        number = _wait.came[0]
        _wait.came.clear()
        signal.raise_signal(number)


def _note(number: int, frame: FrameType | None) -> None:
    """Handle a signal: as the run would, or later."""
    handler = _wait.handlers.get(number)
    if _wait.let_through and callable(handler):
        handler(number, frame)
    else:
        _wait.came.append(number)
