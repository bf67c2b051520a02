"""Tasks that are worked on at the same time, on threads of their own."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mammosim._crew import Crew
from mammosim._jit import kernel_threads
from mammosim.errors import Interrupted

Result = TypeVar("Result")
First = TypeVar("First")
Second = TypeVar("Second")


@contextmanager
def signals_held() -> Iterator[None]:
    """Ignore SIGINT and SIGTERM for a while; only the main thread ever gets them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.signal(number, signal.SIG_IGN) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, handlers, strict=True):
            signal.signal(number, handler)


def dealt(turns: int) -> NDArray[np.int64]:
    """Order in which a kernel goes through the turns of a loop whose threads take parts of it.

    Two threads get every second turn each, four every fourth: neighbours cost about as much.
    """
    first_turns = np.arange(16).reshape(2, 2, 2, 2).T.ravel()  # 0, 8, 4, 12, ...
    return np.concatenate([np.arange(first, turns, 16) for first in first_turns])


def both(first: Callable[[], First], second: Callable[[], Second]) -> tuple[First, Second]:
    """Results of two functions, called at the same time where kernels may run on two threads."""
    results: list[Any] = run_side_by_side([first, second], min(2, kernel_threads()))
    return results[0], results[1]


def run_side_by_side(tasks: Sequence[Callable[[], Result]], at_once: int) -> list[Result]:
    """Run several tasks at the same time; the kernels that they call share the threads.

    Parameters
    ----------
    tasks : sequence of callable
    at_once : int
        How many are at work at the same time; with one, each runs on the calling thread.

    Returns
    -------
    list
        Their results, in their order.

    Raises
    ------
    Exception
        The first in the order of the tasks. After one, none begins, and those at work are finished.
    KeyboardInterrupt, Interrupted
        From the calling thread or a task; those at work stop at the next kernel that they call.
    """
    if at_once == 1:
        return [task() for task in tasks]
    crew = Crew(kernel_threads())

    def work(task: Callable[[], Result]) -> Result:
        with crew.at_work():
            return task()

    with ThreadPoolExecutor(at_once, "view") as threads:
        futures = [threads.submit(work, task) for task in tasks]
        try:
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            if any(map(_was_interrupted, done)):
                crew.stop()
            wait([future for future in futures if not future.cancel()])
        except KeyboardInterrupt:
            crew.stop()
            with signals_held():
                threads.shutdown(cancel_futures=True)
            raise
    return [future.result() for future in futures]


def _was_interrupted(future: Future[Result]) -> bool:
    return isinstance(future.exception(), KeyboardInterrupt | Interrupted)
