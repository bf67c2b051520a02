"""On a machine's first run, a process beside it that compiles the later stages' kernels."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from mammosim.cli.terminal import is_command

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mammosim.pipeline import Plan, RunConfig

REHEARSE = "from mammosim.pipeline.run.rehearsal import main; main()"

MEMORY_BYTES = 700_000_000
"""What that process takes, with what it compiles; measured 0.5 GB."""

PIPE_BYTES = 60_000
"""A configuration that is longer might not fit into the pipe, which holds 64 KiB on Linux."""

ENDS_WITHIN_S = 5.0
"""After its input is closed; it ends at once unless it is stopped."""


@contextmanager
def rehearsing(settings: RunConfig, plan: Plan) -> Iterator[None]:
    """Start that process when the run has to compile a kernel, and end it with the run.

    Where all kernels are kept already, where nothing can be kept, on a single core, with too little
    memory, or in another program than the command, it is not started.

    Parameters
    ----------
    settings : RunConfig
        Of the run.
    plan : Plan
        Of the run; for its memory.
    """
    from mammosim._jit import watch_compiling

    text = json.dumps(settings.model_dump(mode="json", exclude_none=True))
    process: subprocess.Popen[str] | None = None
    wanted = len(text) < PIPE_BYTES and _has_room(plan)

    def begin(kernel: str | None) -> None:
        nonlocal process, wanted
        if wanted and kernel is not None:
            wanted = False
            process = _started(text)

    with watch_compiling(begin):
        try:
            yield
        finally:
            if process is not None:
                _end(process)


def _has_room(plan: Plan) -> bool:
    """Whether another process can help this one."""
    from mammosim._kernel_cache import can_be_kept
    from mammosim.phantom import available_bytes

    if not is_command() or not can_be_kept() or _cores() < 2 or not sys.executable:
        return False
    available = available_bytes()
    return available is None or available > plan.memory_gb * 1e9 + MEMORY_BYTES


def _cores() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _started(text: str) -> subprocess.Popen[str] | None:
    """The process, with the same modules as this one; None where it cannot be started."""
    path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    surroundings = {"PYTHONPATH": path, "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", REHEARSE], stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, encoding="ascii",
            env={**os.environ, **surroundings}, start_new_session=True,
        )  # fmt: skip
        with suppress(OSError):  # it ended already
            assert process.stdin is not None
            process.stdin.write(text + "\n")
            process.stdin.flush()
        return process
    return None


def _end(process: subprocess.Popen[str]) -> None:
    """End the process; it ends itself when its input is closed, but not while it saves a kernel."""
    with suppress(OSError):
        assert process.stdin is not None
        process.stdin.close()
    try:
        process.wait(ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
