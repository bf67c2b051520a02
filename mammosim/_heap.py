"""The heap of a run: memory that one array has left is taken by the next."""

from __future__ import annotations

import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # `M_TRIM_THRESHOLD`, ... of malloc.h

HEAP_BYTES = 1 << 26
"""Arrays up to this size are taken from the heap; glibc's own limit grows to half as much at most
(mallopt(3)). Larger ones, as labels, would leave holes in it."""

KEPT_BYTES = 1 << 29
"""So much free memory stays at the end of the heap, a third of what a run takes."""


def keep_freed_memory() -> bool:
    """Let this process keep memory that is freed; whether its C library can.

    The kernel clears every page that it hands out. Dask's nanny sets `MALLOC_TRIM_THRESHOLD_`, with
    which glibc maps every array above 128 KB anew and returns it as soon as it is freed: that took
    an eighth of a patient's processor time.
    """
    mallopt = _of_glibc("mallopt")
    if mallopt is None:
        return False
    return bool(mallopt(_MMAP_THRESHOLD, HEAP_BYTES) and mallopt(_TRIM_THRESHOLD, KEPT_BYTES))


def share_heap() -> None:
    """Let threads that start from here on take memory from the process's own heap.

    glibc gives each a heap of its own (mallopt(3), `M_ARENA_MAX`), of which it returns nothing that
    is free at the end.
    """
    mallopt = _of_glibc("mallopt")
    if mallopt is not None:
        mallopt(_ARENA_MAX, 1)


def return_freed_memory() -> None:
    """Give memory that is free back to the system, where the C library can."""
    trim = _of_glibc("malloc_trim")
    if trim is not None:
        trim(ctypes.c_size_t(0))


def _of_glibc(name: str) -> ctypes._NamedFuncPointer | None:
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), name, None)
