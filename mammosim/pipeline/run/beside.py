"""What is written beside the stages that follow, on a thread of its own."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import partial
from threading import Lock
from typing import Any

from mammosim._jit import use_threads

NICENESS = 10
"""Of the thread that writes: nine tenths of a core that a view wants too go to the view, since what
comes of that can be written only when it is done."""

MAX_WAITING = 12
"""Results of a view that may wait to be written: all that one has. They are in memory until the run
ends anyway; what is made only to be written, as a compressed breast's labels, is made when its turn
comes."""


class WritingThread:
    """Writes results while the run goes on, in the order in which they are handed over.

    At `finish` the last are written first, beside the others: none may need another to be written
    before, and no two may write the same file.

    What cannot be written is raised where the run hands over its next result, or at `finish`; what
    has not begun by then is not written. Views that are made at the same time share it.

    Parameters
    ----------
    views : int
        How many views are made at the same time; each may have `MAX_WAITING` results waiting.
    """

    def __init__(self, views: int = 1) -> None:
        self._most = MAX_WAITING * views
        self._thread = ThreadPoolExecutor(1, "writing", initializer=_give_way)
        self._waiting: deque[tuple[Future[None], Callable[[], None]]] = deque()
        self._handing_over = Lock()

    def hand_over(
        self,
        write: Callable[..., Any],
        *arguments: Any,
        note: Callable[[float], None] = lambda seconds: None,
    ) -> None:
        """Write as soon as what came before is written.

        Parameters
        ----------
        write : callable
        *arguments
            What it is called with.
        note : callable, optional
            Called with the time it took, s, once it is written.

        Raises
        ------
        InputError
            If something before could not be written.
        """
        with self._handing_over:
            self._let_wait(self._most)
            task = partial(_write, note, write, *arguments)
            self._waiting.append((self._thread.submit(task), task))

    def finish(self) -> None:
        """Write what is left, the last on this thread meanwhile, until all is written.

        Raises
        ------
        InputError
            If something could not be written.
        """
        with self._handing_over:
            while len(self._waiting) > 1 and self._waiting[-1][0].cancel():
                self._waiting.pop()[1]()
            self._let_wait(0)

    def close(self) -> None:
        """Give up what has not begun, and end the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _let_wait(self, most: int) -> None:
        """Wait until at most so many wait; raise what the others ended with."""
        while self._waiting and (len(self._waiting) > most or self._waiting[0][0].done()):
            first = self._waiting[0][0]
            wait([first])
            self._waiting.popleft()
            if first.exception() is not None:
                self._waiting = deque(task for task in self._waiting if not task[0].cancel())
            first.result()


def _give_way() -> None:
    """Leave kernels' threads and the processor to the stages, as far as they want them."""
    use_threads(1)
    if sys.platform == "linux":  # where each thread has a priority of its own
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


def _write(note: Callable[[float], None], write: Callable[..., Any], *arguments: Any) -> None:
    start = time.perf_counter()
    write(*arguments)
    note(time.perf_counter() - start)
