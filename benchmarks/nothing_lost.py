"""Nothing is lost: a cohort disturbed in every way, compared byte by byte with one left in peace.

    python benchmarks/nothing_lost.py [--patients 20] [--kills 20] [--model hyperelastic]

In turn: workers killed (SIGKILL) at random moments, the command itself killed and resumed,
schedulers killed, a second run on the same folder, and (where a small file system may be mounted) a
disk that is full until it is made larger. Patients are small; what is tested is not their physics.
A traceback in what a command printed is a failure too.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import psutil

from mammosim.config import write_yaml

COHORT = {
    "cohort": {"patients": 20, "dataset": {}},
    "phantom": {
        "generate": {
            "voxel_mm": 4.0, "volume_ml": {"uniform": [160, 260]},
            "density": {"choice": ["fatty", "scattered", "heterogeneous", "dense"]},
        },
        "lesions": [
            {"name": "mass", "kind": "mass", "diameter_mm": {"normal": [9, 2], "within": [6, 14]}}
        ],
    },
    "compression": {"model": "springs", "resolution_mm": 6},
    "projection": {"pixel_mm": 1.5},
    "views": ["CC"],
    "report": {"html": False},
    "laterality": {"choice": ["L", "R"]},
    "seed": 7,
}  # fmt: skip
TIMES = {"run.json", "report.html", "failure.json"}
MAX_SECONDS = 1800.0
LONGEST_PAUSE_S = 8.0
"""Between two kills: workers need some seconds to start, and a patient takes one or two."""


def main() -> None:
    """Disturb cohorts and compare them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patients", type=int, default=20)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--model", choices=["springs", "hyperelastic"], default="springs")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        values = {**COHORT, "cohort": {**COHORT["cohort"], "patients": wanted.patients},
                  "compression": {**COHORT["compression"], "model": wanted.model}}  # fmt: skip
        write_yaml(values, folder / "cohort.yaml")
        peace = folder / "peace"
        start = time.monotonic()
        run(folder, peace, "--workers", "1").wait()
        expected = data_of(peace)
        print(
            f"in peace: {wanted.patients} patients, {len(expected)} files, "
            f"{sum(map(len, expected.values())) / 1e6:.0f} MB, {time.monotonic() - start:.0f} s"
        )
        for disturb in (killed_workers, killed_command, killed_scheduler, two_runs, full_disk):
            start = time.monotonic()
            told, output = disturb(folder, wanted.kills)
            found = data_of(output) if output else expected
            same = "every byte the same" if found == expected else "DIFFERENT"
            print(
                f"{disturb.__name__.replace('_', ' ')}: {told}; {same}; "
                f"{time.monotonic() - start:.0f} s",
                flush=True,
            )
            if found != expected:
                names = expected.keys() | found.keys()
                print([n for n in sorted(names) if expected.get(n) != found.get(n)])
                sys.exit(1)
            if "Traceback" in (printed := (folder / f"{output.name}.log").read_text()):
                print(printed)
                sys.exit(1)


def killed_workers(folder: Path, kills: int) -> tuple[str, Path]:
    """SIGKILL to a worker that is at work, at random moments."""
    output, rng, done, starts = folder / "workers", random.Random(1), 0, 1
    command = run(folder, output, "--workers", "2")
    moments = []
    while done < kills:
        if command.poll() is not None:  # all done before enough were killed: some once more
            undo(output, kills - done)
            starts += 1
            command = run(folder, output, "--workers", "2", "--resume")
        time.sleep(rng.uniform(0.0, LONGEST_PAUSE_S))
        owners = [owner for lock in output.glob("patients/*/.lock") if (owner := pid_in(lock))]
        if owners and kill(rng.choice(owners)):
            done += 1
            moments.append(finished(output))
    command.wait(MAX_SECONDS)
    status = command.returncode
    if status != 0:
        starts += 1
        run(folder, output, "--workers", "2", "--resume").wait(MAX_SECONDS)
    return f"{done} workers killed in {starts} starts, with {moments} patients done", output


def killed_command(folder: Path, kills: int) -> tuple[str, Path]:
    """SIGKILL to the command itself, and --resume."""
    output, rng, done = folder / "command", random.Random(2), 0
    while done < 5:
        command = run(folder, output, "--workers", "2", "--resume")
        before = finished(output)
        while command.poll() is None and finished(output) <= before:
            time.sleep(0.1)
        time.sleep(rng.uniform(0.0, 1.0))
        if command.poll() is not None:
            break
        command.send_signal(signal.SIGKILL)
        command.wait()
        done += 1
    run(folder, output, "--workers", "2", "--resume").wait(MAX_SECONDS)
    return f"the command killed {done} times and resumed", output


def killed_scheduler(folder: Path, kills: int) -> tuple[str, Path]:
    """SIGKILL to schedulers that the cohort was given, about when a patient is done."""
    output, rng, statuses = folder / "scheduler", random.Random(3), Counter()
    for _ in range(kills):
        if finished(output) >= len(list(output.glob("patients/*"))):
            undo(output, 5)
        processes, address = start_cluster(folder)
        command = run(folder, output, "--scheduler", address, "--resume")
        before = finished(output)
        while command.poll() is None and finished(output) <= before:
            time.sleep(0.01)
        time.sleep(rng.choice([0.0, rng.uniform(0.0, 0.2), rng.uniform(0.0, 2.0)]))
        processes[0].kill()
        command.wait(MAX_SECONDS)
        statuses[command.returncode] += 1
        for process in processes:
            process.kill()
            process.wait()
    run(folder, output, "--resume").wait(MAX_SECONDS)
    return f"{kills} schedulers killed, exit statuses {dict(statuses)}", output


def start_cluster(folder: Path) -> tuple[list[subprocess.Popen[bytes]], str]:
    """A scheduler and two workers, and the scheduler's address."""
    note = folder / "scheduler.json"
    note.unlink(missing_ok=True)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    ends = ["--scheduler-file", str(note), "--no-dashboard"]
    scheduler = ["distributed.cli.dask_scheduler", "--port", "0", *ends]
    worker = ["distributed.cli.dask_worker", "--nthreads", "1", "--nworkers", "2",
              "--local-directory", str(folder), *ends]  # fmt: skip
    processes = [
        subprocess.Popen([sys.executable, "-m", *words], **quiet) for words in (scheduler, worker)
    ]
    while not note.exists():
        time.sleep(0.1)
    time.sleep(1.0)
    return processes, json.loads(note.read_text())["address"]


def undo(output: Path, count: int) -> None:
    """Patients that are done, made undone."""
    for record in sorted(output.glob("patients/*/run.json"))[:count]:
        record.unlink()


def two_runs(folder: Path, kills: int) -> tuple[str, Path]:
    """A second run on a folder while the first is at work."""
    output = folder / "twice"
    first = run(folder, output, "--workers", "2")
    while first.poll() is None and finished(output) < 1:
        time.sleep(0.1)
    second = run(folder, output, "--workers", "1", "--resume")
    second.wait(MAX_SECONDS)
    first.wait(MAX_SECONDS)
    return (
        f"the second run's exit status {second.returncode}, the first's {first.returncode}",
        output,
    )


def full_disk(folder: Path, kills: int) -> tuple[str, Path | None]:
    """A file system that is full with some patients done, and made larger."""
    disk = folder / "disk"
    disk.mkdir()
    size = int(sum(map(len, data_of(folder / "peace").values())) * 0.4)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        return "not tried, mounting is not allowed here", None
    try:
        output = disk / "out"
        command = run(folder, output, "--workers", "2")
        command.wait(MAX_SECONDS)
        told = f"{finished(output)} patients done on {size / 1e6:.0f} MB, exit status "
        told += f"{command.returncode}"
        parts = len(list(output.rglob(".part-*")))
        subprocess.run(["mount", "-o", "remount,size=2G", str(disk)], check=True)
        run(folder, output, "--workers", "2", "--resume").wait(MAX_SECONDS)
        kept = folder / output.name
        subprocess.run(["cp", "-a", str(output), str(kept)], check=True)
    finally:
        subprocess.run(["umount", str(disk)], check=False)
    return f"{told}, {parts} partial files", kept


def run(folder: Path, output: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start the command."""
    log = (folder / f"{output.name}.log").open("ab")
    words = [sys.executable, "-m", "mammosim", "cohort", "run", str(folder / "cohort.yaml"),
             "--output", str(output), *options]  # fmt: skip
    return subprocess.Popen(words, stdout=log, stderr=log)


def data_of(output: Path) -> dict[str, bytes]:
    """Every file that a rerun must repeat, stages too; the tables without their times."""
    found = {
        path.relative_to(output).as_posix(): path.read_bytes()
        for part in ("patients", "dataset")
        for path in (output / part).rglob("*")
        if path.is_file() and path.name not in TIMES
    }
    lines = (output / "table.csv").read_text().splitlines()
    found["table.csv"] = "\n".join(line.rsplit(",", 5)[0] for line in lines).encode()
    return found


def finished(output: Path) -> int:
    """Number of patients with a record."""
    return len(list(output.glob("patients/*/run.json")))


def pid_in(lock: Path) -> int | None:
    """Process that holds a patient's folder."""
    try:
        return int(lock.read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return None


def kill(pid: int) -> bool:
    """Kill a worker; False if it is no process of Python any more."""
    try:
        psutil.Process(pid).kill()
    except psutil.Error:
        return False
    return True


if __name__ == "__main__":
    main()
