"""Compiled kernels on the disk: a disk that fails costs time, never a run."""

from __future__ import annotations

import errno
from pathlib import Path

import numba
import pytest
from numba.core.caching import FunctionCache, IndexDataCacheFile

from mammosim import _jit

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@pytest.fixture
def reasons(monkeypatch):
    """Why kernels were not saved, from here on."""
    found: list[str] = []
    monkeypatch.setattr(_jit, "_cache_problems", found)
    return found


def doubling():
    """A kernel that no other test has compiled, kept under this file's name."""

    def twice(number):
        return 2 * number

    return _jit.kernel(twice)


@pytest.mark.parametrize("part", ["_save_overload", "_load_overload"])
def test_a_disk_that_fails_costs_no_run(part, reasons, monkeypatch):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(FunctionCache, "_load_overload", lambda *arguments: None)
    monkeypatch.setattr(FunctionCache, part, full)
    assert doubling()(3) == 6
    assert "No space left on device" in _jit.cache_problem()


def test_nowhere_to_keep_kernels_costs_no_run(reasons, monkeypatch):
    def nowhere(self, function):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(FunctionCache, "__init__", nowhere)
    assert doubling()(3) == 6
    assert "neither the program's folder nor the home folder can be written" in _jit.cache_problem()


@pytest.mark.parametrize("content", [b"", b"\x80\x05garbage", b"\x80\x04N."])
def test_a_damaged_file_is_made_again(content, reasons):
    first = doubling()
    assert first(3) == 6
    index = Path(first._cache._cache_file._index_path)
    index.write_bytes(content)
    assert doubling()(3) == 6
    again = doubling()
    assert again(3) == 6
    assert sum(again.stats.cache_hits.values()) == 1, "the index was not made again"
    assert _jit.cache_problem() == ""
    assert isinstance(again._cache._cache_file, IndexDataCacheFile)
