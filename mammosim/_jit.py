"""The one place where Numba's options are written.

`kernel` compiles a sequential function. A `parallel_kernel` runs on all threads: its first
parameter says which thread it is, and its outermost loop takes that thread's `share`. Both are
cached on disk, release the GIL, and divide as NumPy does (0/0 is NaN, no exception). Neither lets
the compiler reorder floating-point sums: the same input gives the same bits whatever the machine's
vector width and number of threads.

`contracting_kernel` and `contracting_parallel_kernel` also let the compiler fuse a multiplication
and the addition that follows it, which is twice as fast in stencils and keeps NaN and infinity as
they are. `inlined_kernel` and `merged_kernel` are for formulas and steps of such kernels,
`chosen_by_type` for families of formulas; `borrowing_kernel` is for steps that are called very
often with many arrays, `enclosed_kernel` for those of them that are called in one or two places;
`sized_kernel` stays on one thread where arrays are small; `alternating_kernel` is for turns of a
loop that write to their neighbours' elements.

Numba's own parallel loops are not used: each is compiled as a function of its own, three times over
and in the function around it, which made the first run on a machine twice as long.

To Numba each of Python's integers is a type of its own where it is written in a call: a function
called with six of them is compiled six times, and once with ``np.intp``. And a copy between parts
of arrays (``a[:n] = b[:n]``) brings two seconds of code that words its errors; a loop does not.

`one_blas_thread` is for stages that call BLAS: its sums depend on how many threads share them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache, cached_property, wraps
from typing import Any, ParamSpec, TypeVar

import llvmlite.binding
import numba
import numba.extending
import numpy as np
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.event import Event, Listener, install_listener
from numba.core.registry import CPUDispatcher
from threadpoolctl import threadpool_limits

from mammosim._crew import crew_of_thread
from mammosim._kernel_cache import kernel_cache

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

llvmlite.binding.set_option("mammosim", "--runtime-memory-check-threshold=100")
# A loop is made into vector instructions only if its arrays can be told apart before it runs. LLVM
# gives up beyond 8 comparisons; stencils of 3 x 3 blocks need 36, and are then twice as fast.

PARALLEL_BYTES = 2_000_000
"""Arrays that a `sized_kernel` is given must be larger than this together to be worth waking the
threads: a stencil passes through 2 MB in about 0.2 ms, and a loaded machine may take several
milliseconds to start a thread."""

_OPTIONS: dict[str, Any] = {
    "nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True,
}  # fmt: skip
"""Options of every kernel. None has an entry for callers in C, as there are none."""


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Compile a function at its first call, and keep the machine code on disk."""
    if numba.config.DISABLE_JIT:
        return function
    return _Kernel(function, {}, options)


class _Kernel(CPUDispatcher):
    """A kernel as Python calls it; kernels that call it are given its `part`.

    The part is the same function without an entry from Python. Code that unpacks a call from
    Python, with all fields of all arrays, takes as long to compile as a short formula: it was a
    quarter of what a first run compiled.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        local_types: dict[str, Any],
        options: dict[str, Any],
    ) -> None:
        # Numba unpickles it in another process by these three, in this order.
        super().__init__(function, local_types, {**_OPTIONS, **options})
        _keep_on_disk(self, kernel_cache(function))

    @cached_property
    def part(self) -> CPUDispatcher:
        """Made when a kernel that calls it is compiled."""
        options = {**self.targetoptions, "no_cpython_wrapper": True}
        made = CPUDispatcher(self.py_func, targetoptions=options)
        _keep_on_disk(made, kernel_cache(self.py_func, is_part=True))
        return made

    @property
    def _numba_type_(self) -> types.Dispatcher:
        return types.Dispatcher(self.part)


def _keep_on_disk(dispatcher: CPUDispatcher, cache: FunctionCache | None) -> None:
    if cache is not None:
        dispatcher._cache = cache


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a sequential kernel."""
    return _compile(function)


def borrowing_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a sequential kernel that does not count references to the arrays it is given.

    It makes no array of its own (views are allowed). Numba counts a reference to each array of a
    call, those in its NamedTuples included, with an atomic instruction, and again at its end; it
    leaves that out by itself in most functions with a single way out. In kernels that are called
    for each piece of a ray, or each collision of a photon, it takes a tenth to a sixth of the time.
    """
    return _compile(function, _nrt=False)


def enclosed_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a `borrowing_kernel` as a part of every kernel that calls it.

    A call passes each field of each array through memory; with ten of them, once for each piece of
    a ray, that is a twentieth of the time.
    """
    return _compile(function, _nrt=False, forceinline=True)


def parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that runs on all threads, each with its `share` of a loop."""
    return _threaded(kernel(function))


def contracting_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a sequential kernel with fused multiply-add."""
    return _compile(function, fastmath={"contract"})


def contracting_parallel_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel with fused multiply-add that runs on all threads."""
    return _threaded(contracting_kernel(function))


def alternating_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel like `contracting_parallel_kernel` whose turns write to the next one's, too.

    Even turns of its loop are worked on together, then odd ones, so that each sum has one order.
    """
    return _threaded(contracting_kernel(function), step=2)


def inlined_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a formula with fused multiply-add into every kernel that uses it.

    A loop over contiguous elements is made into vector instructions only where all that it calls
    is part of it.
    """
    return _compile(function, forceinline=True, fastmath={"contract"})


def merged_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make a step with fused multiply-add part of a kernel's own source.

    It is compiled once with the kernel instead of by itself and again in every caller; for steps
    that are called in one or two places.
    """
    return _compile(function, inline="always", fastmath={"contract"})


def sized_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel with fused multiply-add that runs on all threads where it pays.

    Coarse levels call kernels thousands of times on arrays of a few kilobytes. Results do not
    depend on the number of threads.
    """
    return _threaded(contracting_kernel(function), smallest_bytes=PARALLEL_BYTES)


def chosen_by_type(function: Callable[..., Any]) -> Any:
    """Make a formula stand for a family of them, one for each type of its first argument.

    That argument is a NamedTuple of numbers: the parameters of a law, or of a solid.
    ``@name.of(Kind)`` above a plain function makes it the formula for arguments of the class
    `Kind`. Kernels are compiled for the classes that they are called with and no others, and each
    formula becomes part of them as that of an `inlined_kernel` does: another member costs the rest
    nothing.
    """
    formulas: dict[type, Callable[..., Any]] = {}

    @wraps(function)
    def chosen(first: Any, *others: Any) -> Any:
        return formulas[type(first)](first, *others)

    def of(kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        def add(formula: Callable[..., Any]) -> Callable[..., Any]:
            formulas[kind] = formula
            return formula

        return add

    options = {"forceinline": True, "fastmath": {"contract"}, "error_model": "numpy"}

    @numba.extending.overload(chosen, jit_options=options, strict=False)
    def _compiled(first: Any, *others: Any) -> Callable[..., Any] | None:
        return formulas.get(getattr(first, "instance_class", type(None)))

    chosen.of = of  # type: ignore[attr-defined]
    return chosen


Thread = tuple[int, int, int, int]
"""A thread's number, how many there are, the first turn of a loop that is due, and the step."""


@inlined_kernel
def share(thread: Thread, first: int, last: int) -> range:
    """The part of ``range(first, last)`` that is a thread's; in a kernel's outermost loop."""
    number, threads, due, step = thread
    turns = max(last - first - due + step - 1, 0) // step
    low, high = turns * number // threads, turns * (number + 1) // threads
    return range(first + due + step * low, first + due + step * high, step)


def _threaded(
    compiled: Callable[..., Any], smallest_bytes: int = -1, step: int = 1
) -> Callable[..., list[Any]]:
    """Call a kernel, whose first parameter is its `Thread`, on all threads.

    Every `step`-th turn of its loop is worked on together, then those after them. What the kernel
    returned on each thread is returned. It is called from Python only, not from other kernels.
    """

    @wraps(compiled)
    def run(*arguments: Any, **named: Any) -> list[Any]:
        # Asking for the number of threads takes longer than a kernel does on a small array.
        alone = numba.config.DISABLE_JIT or numba.config.NUMBA_NUM_THREADS == 1
        small = smallest_bytes > 0 and _bytes_of(arguments, named) <= smallest_bytes
        threads = 1 if alone or small else kernel_threads()
        if threads == 1:
            return [compiled((0, 1, due, step), *arguments, **named) for due in range(step)]
        returned: list[Any] = []
        for due in range(step):
            others = [
                _threads().submit(compiled, (number, threads, due, step), *arguments, **named)
                for number in range(1, threads)
            ]
            try:
                returned.append(compiled((0, threads, due, step), *arguments, **named))
            finally:
                wait(others)
            returned.extend(other.result() for other in others)
        return returned

    return run


def kernel_threads() -> int:
    """Threads that a kernel runs on which the calling thread calls now."""
    crew = crew_of_thread()
    return numba.get_num_threads() if crew is None else crew.share()


def _bytes_of(arguments: tuple[Any, ...], named: dict[str, Any]) -> int:
    total = 0
    for part in (*arguments, *named.values()):
        if isinstance(part, np.ndarray):
            total += part.nbytes
    return total


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(numba.config.NUMBA_NUM_THREADS, "kernel")


if hasattr(os, "register_at_fork"):  # a fork has none of its parent's threads
    os.register_at_fork(after_in_child=_threads.cache_clear)


@contextmanager
def watch_compiling(on_progress: Callable[[str | None], None]) -> Iterator[None]:
    """Tell of every kernel that has to be compiled: its name, and None when it is there.

    What is loaded from the cache on disk, and what is compiled as a part of another kernel, is not
    told of. Kernels are compiled one at a time, on whichever thread comes first.
    """
    with install_listener("numba:compile", _Watch(on_progress)):
        yield


class _Watch(Listener):
    def __init__(self, on_progress: Callable[[str | None], None]) -> None:
        self._on_progress, self._depth = on_progress, 0

    def on_start(self, event: Event) -> None:
        if self._depth == 0:
            self._on_progress(event.data["dispatcher"].py_func.__name__)
        self._depth += 1

    def on_end(self, event: Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._on_progress(None)


def use_threads(count: int) -> None:
    """Let kernels run on so many threads, or on as many as there are, from here on."""
    numba.config.reload_config()  # a worker may get its variables after a script's own imports
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))


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
