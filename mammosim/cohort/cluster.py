"""Workers of Dask: a cluster on this machine, or one that is there already."""

from __future__ import annotations

import logging
import os
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import dask
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, get_worker
from distributed.comm import resolve_address

from mammosim.errors import InputError, Interrupted
from mammosim.phantom import available_bytes

CONNECT_S = 20.0
"""For a scheduler to answer, or to come back, before it is given up, s."""

WORKER_POLL_S = 0.5
"""Between two looks for the first worker, s."""

THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS",
                    "OPENBLAS_NUM_THREADS")  # fmt: skip

LOAD_MODULES = """
from mammosim._loading import loading
with loading():
    import mammosim.cohort.patient
"""
"""What a worker of our own does first: it loads the modules that its first patient needs, without
garbage collections, which take 0.4 to 1 of about 3 s."""

WORKER_CONFIG = {
    "distributed.worker.preload": [LOAD_MODULES],
    # Dask would sample each worker's stack a hundred times a second.
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    # A worker that paused would never go on: what a finished patient leaves is freed late.
    "distributed.worker.memory.pause": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.deploy.lost-worker-timeout": "5s",
}
"""Of Dask's configuration, for workers of our own: they hold one patient and no data of Dask's."""


@dataclass(frozen=True)
class Workers:
    """Workers of a cohort, and each one's share of the machine.

    Parameters
    ----------
    count : int
        Local workers to start.
    threads : int
        Threads of each.
    memory_gb : float
        Memory of each, GB.
    """

    count: int
    threads: int
    memory_gb: float


def share_machine(
    patient_gb: float, patients: int, wanted: int | None, memory_gb: float | None
) -> Workers:
    """How many local workers there is room for, and what each may take.

    Parameters
    ----------
    patient_gb : float
        Memory that the largest patient takes, GB.
    patients : int
    wanted : int, optional
        Number of workers asked for; fewer are started where memory is short. Left out: one a
        processor.
    memory_gb : float, optional
        Memory of all together; left out: what is free.

    Raises
    ------
    InputError
        If not even one patient fits.
    """
    free = available_bytes()
    room_gb = min(memory_gb or float("inf"), free / 1e9 if free is not None else float("inf"))
    if patient_gb > room_gb:
        raise InputError(
            f"a patient takes about {patient_gb:.2g} GB of memory, but {room_gb:.2g} GB are "
            f"available: use larger voxels or pixels, a coarser lattice, or another machine"
        )
    fit = int(room_gb // patient_gb) if room_gb < float("inf") else CPU_COUNT
    count = max(1, min(wanted or CPU_COUNT, fit, patients))
    memory = room_gb / count if room_gb < float("inf") else float("inf")
    return Workers(count, max(1, CPU_COUNT // count), memory)


@contextmanager
def local_client(workers: Workers) -> Iterator[Client]:
    """A client of workers started on this machine, each a process that makes one patient.

    Raises
    ------
    Interrupted
        If they do not start, as when something kills them.
    """
    environment = dict.fromkeys(THREAD_VARIABLES, str(workers.threads))
    limit = 0 if workers.memory_gb == float("inf") else int(workers.memory_gb * 1e9)
    with dask.config.set(WORKER_CONFIG):
        try:
            cluster = LocalCluster(
                n_workers=workers.count, threads_per_worker=1, processes=True, memory_limit=limit,
                dashboard_address="127.0.0.1:0", env=environment, silence_logs=logging.CRITICAL,
            )  # fmt: skip
        except RuntimeError as error:
            raise Interrupted(f"the workers could not be started ({error})", None) from None
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def remote_client(address: str) -> Iterator[Client]:
    """A client of a scheduler that is there already.

    Raises
    ------
    InputError
        If nothing answers at the address.
    """
    try:
        # What is no address a client refuses, too, but then is left half open.
        with suppress(OSError):  # a name that is not known may be in a moment
            resolve_address(address)
        client = Client(address, timeout=CONNECT_S)
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{address}: no scheduler answers ({reason})") from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost is said by us
    with client:
        yield client


def wait_for_worker(client: Client) -> None:
    """Wait until a cluster has its first worker, which a batch system may take hours to start.

    Raises
    ------
    Interrupted
        If the scheduler is lost meanwhile.
    """
    while client.status != "closed":
        try:
            if client.status == "running" and client.nthreads():
                return
        except (OSError, TimeoutError):
            pass  # its state tells at the next turn
        time.sleep(WORKER_POLL_S)
    raise Interrupted("the scheduler no longer answers, and never had a worker", None)


def shares(client: Client) -> tuple[int, float]:
    """Threads and memory (GB) that every worker of a running cluster has for itself.

    Workers of a host that may use the same processors share them out; one that its batch system
    bound to processors of its own has them all. The smallest share holds for all.

    Raises
    ------
    Interrupted
        If the scheduler is lost meanwhile.
    """
    try:
        workers = client.scheduler_info(n_workers=-1)["workers"]
        found = client.run(_processors, on_error="ignore")
    except OSError as error:
        raise Interrupted(f"the scheduler no longer answers ({error})", None) from None
    bound = {(workers[name]["host"], name): found[name] for name in found if name in workers}
    sharing = Counter((host, which) for (host, _), (_, which) in bound.items())
    threads = [count // sharing[host, which] for (host, _), (count, which) in bound.items()]
    limits = [worker["memory_limit"] / 1e9 for worker in workers.values()]
    limits = [limit for limit in limits if limit > 0]
    return max(1, min(threads, default=1)), min(limits, default=float("inf"))


def _processors() -> tuple[int, frozenset[int]]:
    """How many processors a worker may keep busy, and which it may run on."""
    which = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(int(CPU_COUNT))
    return int(CPU_COUNT), frozenset(which)


def own_memory_gb() -> float:
    """Memory that Dask lets the worker have that this is called in, GB; infinite elsewhere."""
    try:
        limit = get_worker().memory_manager.memory_limit
    except ValueError:
        return float("inf")
    return limit / 1e9 if limit else float("inf")
