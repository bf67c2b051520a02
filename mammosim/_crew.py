"""Tasks that are worked on at the same time, as the views of a run, and share the kernels' threads.

The number of threads that a kernel runs on decides no bit of its result.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from mammosim._interruption import interruptions_wait

_of_thread = threading.local()


class Crew:
    """Threads that each work on a task; a kernel runs on the share of the task that calls it.

    Parameters
    ----------
    threads : int
        Threads that the kernels of all tasks have together.
    """

    def __init__(self, threads: int) -> None:
        self._threads, self._at_work, self._stopped = threads, 0, False
        self._counting = threading.Lock()

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """Count the calling thread, until its task is done."""
        with self._counting:
            self._at_work += 1
        _of_thread.crew, _of_thread.interrupted = self, False
        try:
            yield
        finally:
            _of_thread.crew = None
            with self._counting:
                self._at_work -= 1

    def stop(self) -> None:
        """Interrupt each task once, at the next kernel that it calls, as Ctrl-C does the main one.

        The kernels that it calls after that run, so that it can keep what it reached.
        """
        self._stopped = True

    def share(self) -> int:
        """Threads for a kernel that one of the tasks calls now.

        Raises
        ------
        KeyboardInterrupt
            Once in each thread, if the crew was told to stop and it need not wait.
        """
        if self._stopped and not _of_thread.interrupted and not interruptions_wait():
            _of_thread.interrupted = True
            raise KeyboardInterrupt
        return max(self._threads // max(self._at_work, 1), 1)


def crew_of_thread() -> Crew | None:
    """The crew that the calling thread is at work in."""
    crew: Crew | None = getattr(_of_thread, "crew", None)
    return crew
