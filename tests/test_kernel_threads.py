"""Kernels whose loop all threads share: each turn is taken once, in one order for any number."""

import multiprocessing
import sys

import numba
import numpy as np
import pytest

from mammosim._jit import alternating_kernel, parallel_kernel, share, sized_kernel


@pytest.fixture(params=(1, 2, 3, 5))
def threads(request):
    """Number of threads, as a machine of that many processors would have."""
    usual = numba.get_num_threads()
    count = min(request.param, numba.config.NUMBA_NUM_THREADS)
    numba.set_num_threads(count)
    yield count
    numba.set_num_threads(usual)


@parallel_kernel
def _count_turns(thread, first, last, out):
    """Add 1 for each turn, and return how many were a thread's."""
    turns = 0
    for i in share(thread, first, last):
        out[i] += 1
        turns += 1
    return turns


@sized_kernel
def _double(thread, a, out):
    for i in share(thread, 0, a.size):
        out[i] = 2.0 * a[i]


@alternating_kernel
def _spread(thread, a, out):
    """Add each element to its place and the next, so that the sum's order matters."""
    for i in share(thread, 0, a.size):
        out[i] += a[i]
        out[i + 1] += a[i]


@pytest.mark.parametrize(("first", "last"), [(0, 0), (0, 1), (1, 12), (3, 2), (5, 300)])
@pytest.mark.parametrize("step", [1, 2, 3])
def test_shares_of_all_threads_are_every_turn_once(first, last, step):
    for count in (1, 2, 3, 7, 64):
        for due in range(step):
            shares = [share.py_func((n, count, due, step), first, last) for n in range(count)]
            assert [i for part in shares for i in part] == list(range(first + due, last, step))


def test_a_kernel_runs_on_all_threads_and_returns_what_each_did(threads):
    out = np.zeros(20, np.int64)
    turns = _count_turns(2, 19, out)
    assert len(turns) == threads
    assert sum(turns) == 17
    assert (out[2:19] == 1).all()
    assert out[[0, 1, 19]].sum() == 0


@pytest.mark.parametrize("size", [10, 500_000])
def test_a_sized_kernel_gives_the_same_for_small_and_large_arrays(threads, size):
    a, out = np.arange(size, dtype=float), np.empty(size)
    _double(a, out)
    assert (out == 2.0 * a).all()


def test_turns_that_write_to_the_next_one_have_one_order(threads):
    a = np.random.default_rng(0).normal(size=4001) * 10.0 ** np.arange(4001).clip(max=9)
    out = np.zeros(a.size + 1)
    _spread(a, out)
    expected = np.zeros(a.size + 1)
    for due in range(2):
        for i in range(due, a.size, 2):
            expected[i] += a[i]
            expected[i + 1] += a[i]
    assert (out == expected).all()


def test_a_kernel_that_cannot_be_compiled_says_so(threads):
    @parallel_kernel
    def broken(thread, a):
        for i in share(thread, 0, 1):
            a[i].no_such_method()

    with pytest.raises(numba.TypingError, match="no_such_method"):
        broken(np.zeros(3))


def _turns_in_a_fork(answer):
    answer.put(sum(_count_turns(0, 8, np.zeros(8, np.int64))))


@pytest.mark.skipif(sys.platform != "linux", reason="forks are taken on Linux only")
def test_a_forked_process_has_threads_of_its_own():
    _count_turns(0, 8, np.zeros(8, np.int64))  # the parent's threads are there
    context = multiprocessing.get_context("fork")
    answer = context.Queue()
    child = context.Process(target=_turns_in_a_fork, args=(answer,))
    child.start()
    try:
        assert answer.get(timeout=600) == 8
    finally:
        child.kill()
