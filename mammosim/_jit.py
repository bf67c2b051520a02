"""The one place where Numba's options are written.

`kernel` compiles a sequential function, `parallel_kernel` one whose `numba.prange` loops use all
threads. Both are cached on disk, release the GIL, and divide as NumPy does (0/0 is NaN, no
exception). Neither lets the compiler reorder floating-point sums: the same input gives the same
bits whatever the machine's vector width and number of threads.

`contracting_kernel` and `contracting_parallel_kernel` also let the compiler fuse a multiplication
and the addition that follows it, which is twice as fast in stencils and keeps NaN and infinity as
they are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a sequential kernel."""
    return numba.njit(**_OPTIONS)(function)


def parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel whose `prange` loops run on all threads."""
    return numba.njit(parallel=True, **_OPTIONS)(function)


def contracting_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a sequential kernel with fused multiply-add."""
    return numba.njit(fastmath={"contract"}, **_OPTIONS)(function)


def contracting_parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a parallel kernel with fused multiply-add."""
    return numba.njit(parallel=True, fastmath={"contract"}, **_OPTIONS)(function)
