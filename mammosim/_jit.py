"""The one place where Numba's options are written.

`kernel` compiles a sequential function, `parallel_kernel` one whose `numba.prange` loops use all
threads. Both are cached on disk, release the GIL, and divide as NumPy does (0/0 is NaN, no
exception). Neither lets the compiler reorder floating-point sums: the same input gives the same
bits whatever the machine's vector width and number of threads.

`contracting_kernel` and `contracting_parallel_kernel` also let the compiler fuse a multiplication
and the addition that follows it, which is twice as fast in stencils and keeps NaN and infinity as
they are. `inlined_kernel` is for formulas that such kernels share; `sized_kernel` is the first two
of these in one: sequential for small arrays.

`one_blas_thread` is for stages that call BLAS: its sums depend on how many threads share them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

import llvmlite.binding
import numba
import numpy as np
from threadpoolctl import threadpool_limits

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

llvmlite.binding.set_option("mammosim", "--runtime-memory-check-threshold=100")
# A loop is made into vector instructions only if its arrays can be told apart before it runs. LLVM
# gives up beyond 8 comparisons; stencils of 3 x 3 blocks need 36, and are then twice as fast.

PARALLEL_BYTES = 2_000_000
"""Arrays that a `sized_kernel` is given must be larger than this together to be worth waking the
threads: a stencil passes through 2 MB in about 0.2 ms, and a loaded machine may take several
milliseconds to start a thread."""

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


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a formula with fused multiply-add into every kernel that uses it.

    A loop over contiguous elements is made into vector instructions only where all that it calls
    is part of it.
    """
    return numba.njit(forceinline=True, fastmath={"contract"}, **_OPTIONS)(function)


def sized_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel with fused multiply-add twice, and run it on all threads where it pays.

    Coarse levels call kernels thousands of times on arrays of a few kilobytes. Results do not
    depend on which of the two runs. It is called from Python only, not from other kernels.
    """
    parallel = contracting_parallel_kernel(function)
    sequential = contracting_kernel(_renamed(function, "_sequential"))

    @wraps(function)
    def run(*arguments: Any) -> Any:
        size = sum(part.nbytes for part in arguments if isinstance(part, np.ndarray))
        return (parallel if size > PARALLEL_BYTES else sequential)(*arguments)

    return run


def _renamed(function: Callable[..., Any], suffix: str) -> Callable[..., Any]:
    """A copy under another name, since Numba's cache on disk tells functions by their names."""
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__ + suffix,
        function.__defaults__, function.__closure__,
    )  # fmt: skip
    copy.__qualname__ = function.__qualname__ + suffix
    copy.__module__ = function.__module__
    return copy


def one_blas_thread(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let BLAS use one thread while a function runs, so that its bits do not depend on more.

    OpenBLAS splits a sum over its threads. What is left to BLAS is small (the multigrid's coarsest
    level), so that one thread costs no time that could be measured.
    """

    @wraps(function)
    def limited(*arguments: Arguments.args, **keys: Arguments.kwargs) -> Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*arguments, **keys)

    return limited
