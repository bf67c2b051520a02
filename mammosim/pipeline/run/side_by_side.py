"""Views of a run that are made at the same time."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

from mammosim._crew import Crew
from mammosim._jit import kernel_threads
from mammosim.errors import Interrupted
from mammosim.phantom import available_bytes
from mammosim.pipeline.configuration import RunConfig, make_plan

Result = TypeVar("Result")


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


def views_at_once(config: RunConfig) -> int:
    """How many views of a run are made at the same time.

    Parameters
    ----------
    config : RunConfig

    Returns
    -------
    int
        As many as its kernels may use threads, if memory suffices for all views; else one.

    Notes
    -----
    Half of a compression runs on one thread however many there are. What views keep until the run
    ends is most of their memory, so that `make_plan` counts all in any case.
    """
    views = sum(len(one.resolved_views) for one in config.sides)
    available = available_bytes()
    if available is not None and make_plan(config).memory_gb * 1e9 > available:
        return 1
    return max(min(views, kernel_threads()), 1)


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
