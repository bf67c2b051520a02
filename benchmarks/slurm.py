"""The how-to page's script on a SLURM cluster of three nodes, disturbed; every byte compared.

    python benchmarks/slurm.py [--patients 16] [--cancel 5]

Needs dask-jobqueue, root and Debian's packages, see `slurm_site.py`, which makes the cluster. The
script is taken from the page; only its sizes are others.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
from distributed import Client
from nothing_lost import COHORT, data_of, finished, pid_in
from slurm_site import MAX_SECONDS, NODES, Site, enter, job_of, network_of, shell, wait

from mammosim.config import write_yaml

PAGE = Path(__file__).parent.parent / "docs" / "how-to" / "slurm.md"
SMALL = {
    "phantom": {
        **COHORT["phantom"],
        "generate": {**COHORT["phantom"]["generate"], "voxel_mm": 2.0},
    },
    "compression": {"model": "springs", "resolution_mm": 4},
    "projection": {"pixel_mm": 0.5},
    "views": ["CC", "MLO"],
}

LONGEST_PAUSE_S = 15.0
"""Between two jobs cancelled: workers need some seconds to start, and a patient takes ten."""


def main() -> None:
    """Enter namespaces of our own, and try."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patients", type=int, default=16)
    parser.add_argument("--cancel", type=int, default=5, help="jobs that are cancelled")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    if wanted.folder is None:
        sys.exit(enter(*sys.argv[1:]))
    site = Site(wanted.folder)
    site.start()
    try_all(site, wanted.patients, wanted.cancel)


def try_all(site: Site, patients: int, cancel: int) -> None:
    """A cohort in peace on this machine, then on the cluster in every way."""
    values = {**COHORT, **SMALL, "cohort": {"patients": patients, "dataset": {}}}
    write_yaml(values, site.folder / "cohort.yaml")
    begun = time.monotonic()
    expected = data_of(in_peace(site.folder))
    size = sum(map(len, expected.values())) / 1e6
    say(f"in peace: {patients} patients, {len(expected)} files, {size:.0f} MB", begun)
    trials: tuple[Callable[[Site, Path, int], str], ...] = (
        late_workers, cancelled_jobs, lost_node, ended_lifetimes, wall_time, script_as_job,
        killed_script,
    )  # fmt: skip
    for trial in trials:
        begun, output = time.monotonic(), site.folder / trial.__name__
        told = trial(site, output, cancel)
        site.wait_for_jobs()
        found = data_of(output)
        same = "every byte the same" if found == expected else "DIFFERENT"
        jobs = site.jobs(place_of(output))
        say(f"{trial.__name__.replace('_', ' ')}: {told}; jobs {jobs}; {same}", begun)
        if found != expected:
            names = expected.keys() | found.keys()
            sys.exit(str([n for n in sorted(names) if expected.get(n) != found.get(n)]))
    begun = time.monotonic()
    say(f"small jobs: {small_jobs(site.folder / 'small_jobs')}", begun)


def in_peace(folder: Path) -> Path:
    """The cohort with one local worker."""
    words = [sys.executable, "-m", "mammosim", "cohort", "run", "cohort.yaml", "--workers", "1"]
    with (folder / "peace.log").open("wb") as log:
        words += ["--output", "peace"]
        subprocess.run(words, cwd=folder, check=True, stdout=log, stderr=log)
    return folder / "peace"


def late_workers(site: Site, output: Path, cancel: int) -> str:
    """Two nodes come when a patient is done; what the page's options do is looked at."""
    shell("scontrol update nodename=n[2-3] state=drain reason=later")
    script = start(output, cores=2, jobs=3)
    wait(lambda: finished(output) >= 1, "no patient was made")
    words = psutil.Process(script.pid).children()[0].cmdline()
    with Client(words[words.index("--scheduler") + 1], set_as_default=False) as client:
        before = len(client.nthreads())
        shell("scontrol update nodename=n[2-3] state=resume")
        wait(lambda: len(client.nthreads()) == len(NODES), "no worker came later")
        found = list(client.run(options).values())
    status = script.wait(MAX_SECONDS)
    kernels = len(list((site.folder / "tmp" / "numba").rglob("*.nbc")))
    return (
        f"{before} worker, then {len(found)}, the first with {found[0]}; {kernels} kernels kept; "
        f"exit status {status}"
    )


def options(dask_worker: Any) -> dict[str, Any]:
    """What a worker made of the page's options."""
    import numba

    memory = dask_worker.memory_manager
    return {
        "nthreads": dask_worker.state.nthreads, "kernel threads": numba.config.NUMBA_NUM_THREADS,
        "memory": memory.memory_limit, "pause": memory.memory_pause_fraction,
        "spill": memory.memory_spill_fraction,
    }  # fmt: skip


def cancelled_jobs(site: Site, output: Path, cancel: int) -> str:
    """`scancel` of jobs with a patient, at random moments."""
    script, rng, moments = start(output), random.Random(1), []
    while len(moments) < cancel and script.poll() is None:
        time.sleep(rng.uniform(2.0, LONGEST_PAUSE_S))
        jobs = sorted({job for pid in owners(output) if (job := job_of(pid))})
        if jobs:
            moments.append(finished(output))
            shell(f"scancel {rng.choice(jobs)}")
    status = script.wait(MAX_SECONDS)
    return f"{len(moments)} cancelled, with {moments} patients done, exit status {status}"


def lost_node(site: Site, output: Path, cancel: int) -> str:
    """A node that is silent and dead from one moment to the next."""
    script, node = start(output), network_of(site.nodes[1].pid)
    wait(lambda: node in map(network_of, owners(output)), "the node never worked")
    gone = site.stop_node(1)
    status = script.wait(MAX_SECONDS)
    site.start_node(1)
    site.wait_for_jobs()
    site.wait_for_nodes()
    return f"{gone} processes of a node gone at once, exit status {status}"


def ended_lifetimes(site: Site, output: Path, cancel: int) -> str:
    """Workers that end by themselves, most of them with a patient."""
    return f"exit status {start(output, lifetime='30s', stagger='5s').wait(MAX_SECONDS)}"


def wall_time(site: Site, output: Path, cancel: int) -> str:
    """Jobs that SLURM ends."""
    return f"exit status {start(output, walltime='00:01:00', jobs=1).wait(MAX_SECONDS)}"


def script_as_job(site: Site, output: Path, cancel: int) -> str:
    """The script submitted, too; nobody types anything."""
    place, words = prepare(output, 1, 3)
    job = ["sbatch", "--wait", "--mem=2G", f"--chdir={place}", "--wrap", shlex.join(words)]
    status = subprocess.run(job, stdout=subprocess.DEVNULL, timeout=MAX_SECONDS).returncode
    return f"exit status {status}"


def killed_script(site: Site, output: Path, cancel: int) -> str:
    """SIGKILL to the script, and with it the scheduler; then both again."""
    script = start(output)
    wait(lambda: finished(output) >= 2, "no patients were made")
    command, reached = psutil.Process(script.pid).children()[0], finished(output)
    script.kill()
    status = command.wait(MAX_SECONDS)  # its parent gone, it is a child of this process
    said = output.with_suffix(".log").read_text().strip().splitlines()[-1]
    site.wait_for_jobs()
    again = start(output).wait(MAX_SECONDS)
    return f"with {reached} done, exit status {status}, {said!r}; started again, {again}"


def small_jobs(output: Path) -> str:
    """Jobs too small for any patient."""
    status = start(output, memory="600MB").wait(MAX_SECONDS)
    with (output / "failures.csv").open(newline="") as lines:
        failures = list(csv.DictReader(lines))
    return f"{len(failures)} failures, the first {failures[0]['reason']!r}; exit status {status}"


def start(output: Path, cores: int = 1, jobs: int = 4, **sizes: str) -> subprocess.Popen[bytes]:
    """Start the page's script."""
    place, words = prepare(output, cores, jobs, **sizes)
    log = output.with_suffix(".log").open("ab")
    return subprocess.Popen(words, cwd=place, stdout=log, stderr=log)


def prepare(
    output: Path, cores: int, jobs: int, *, memory: str = "2GB", walltime: str = "08:00:00",
    lifetime: str = "470m", stagger: str = "5m",
) -> tuple[Path, list[str]]:  # fmt: skip
    """The page's script with other sizes; its folder, and how it is started."""
    found = re.search(r"```\{\.python[^\n]*\n(.*?)```", PAGE.read_text(), re.DOTALL)
    text = found.group(1) if found else ""
    for old, new in (
        ("cores=4", f"cores={cores}"), ("NUM_THREADS=4", f"NUM_THREADS={cores}"),
        ('memory="8GB"', f'memory="{memory}"'), ("08:00:00", walltime), ("470m", lifetime),
        ('"5m"', f'"{stagger}"'), ("minimum_jobs=100", f"minimum_jobs={jobs}"),
        ("maximum_jobs=100", f"maximum_jobs={jobs}"),
    ):  # fmt: skip
        if text.count(old) != 1:
            sys.exit(f"{PAGE}: expected {old} once in its script, found {text.count(old)}")
        text = text.replace(old, new)
    place = place_of(output)
    place.mkdir(exist_ok=True)
    (place / "on_slurm.py").write_text(text)
    words = [sys.executable, "on_slurm.py", "../cohort.yaml", "--output", str(output), "--resume"]
    return place, words


def place_of(output: Path) -> Path:
    """Folder that a cohort's script is started in, and its jobs are submitted from."""
    return output.with_suffix(".start")


def owners(output: Path) -> list[int]:
    """Processes that hold a patient's folder, or held it last."""
    return [pid for lock in output.glob("patients/*/.lock") if (pid := pid_in(lock))]


def say(line: str, begun: float) -> None:
    """Print at once."""
    print(f"{line}; {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
