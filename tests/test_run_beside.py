"""What is written beside the stages that follow: in order, whole, and no error is lost."""

from __future__ import annotations

import threading
import time

import pytest

from mammosim.errors import InputError
from mammosim.pipeline.run.beside import MAX_WAITING, WritingThread


@pytest.fixture
def beside():
    thread = WritingThread()
    yield thread
    thread.close()


def refuse() -> None:
    raise InputError("c.nii.gz: cannot be written (disk full)")


def test_results_are_written_in_order_and_timed(beside):
    written, seconds = [], []
    for number in range(5):
        beside.hand_over(written.append, number, note=seconds.append)
    beside.finish()
    assert sorted(written) == [0, 1, 2, 3, 4]
    assert len(seconds) == 5
    assert min(seconds) >= 0.0


def test_a_run_waits_where_too_much_waits(beside):
    gate, written = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    for number in range(MAX_WAITING):
        beside.hand_over(written.append, number)
    threading.Timer(0.05, gate.set).start()
    beside.hand_over(written.append, MAX_WAITING)  # only now may the first be gone
    assert gate.is_set()
    beside.finish()
    assert sorted(written) == list(range(MAX_WAITING + 1))


def test_the_run_helps_at_its_end(beside):
    """The last is written on the run's own thread while the other is still busy."""
    gate, threads = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)

    def last() -> None:
        threads.append(threading.current_thread())
        gate.set()

    beside.hand_over(last)
    beside.finish()
    assert threads == [threading.current_thread()]


def test_an_error_is_raised_and_nothing_more_is_written(beside):
    gate, written = threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    beside.hand_over(refuse)
    beside.hand_over(written.append, 1)
    gate.set()
    with pytest.raises(InputError, match="disk full"):
        beside.finish()
    beside.finish()
    assert len(written) <= 2  # by this thread, before it heard of the error


def test_an_error_is_raised_where_the_next_result_is_handed_over(beside):
    beside.hand_over(refuse)
    while not beside._waiting[0][0].done():
        time.sleep(0.001)
    with pytest.raises(InputError, match="disk full"):
        beside.hand_over(refuse)


def test_an_error_of_the_last_is_raised_at_the_end(beside):
    beside.hand_over(refuse)
    with pytest.raises(InputError, match="disk full"):
        beside.finish()
    beside.finish()


def test_closing_gives_up_what_has_not_begun():
    beside, gate, written = WritingThread(), threading.Event(), []
    beside.hand_over(gate.wait, 30.0)
    beside.hand_over(written.append, 1)
    threading.Timer(0.05, gate.set).start()
    beside.close()
    assert written == []
