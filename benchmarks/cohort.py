"""Cohorts: patients an hour for 1 and 2 workers, Dask's overhead a patient, bytes a patient.

    python benchmarks/cohort.py [--patients 6] [--empty 400] [--set section.key=value ...]

The cohort is that of `configs/cohort.yaml`. Patients an hour are measured without the start of the
workers, which is told apart. The overhead is that of patients which are there already, so that a
worker only looks at them and answers.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from mammosim.cohort import Progress, load_cohort, run_cohort
from mammosim.cohort.cluster import Workers, local_client
from mammosim.cohort.patient import Outcome

CONFIG = Path(__file__).parents[1] / "configs" / "cohort.yaml"

SMALL = ["cohort.patients=1", "phantom.generate.voxel_mm=1.5", "compression.resolution_mm=3"]


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--patients", type=int, default=6)
    parser.add_argument("--empty", type=int, default=400)
    parser.add_argument("--set", action="append", default=[], dest="changes")
    wanted = parser.parse_args()
    overhead(wanted.empty)
    with tempfile.TemporaryDirectory() as folder:  # so that everything is compiled
        run_cohort(load_cohort(CONFIG, SMALL), folder, workers=1)
    cohort = load_cohort(CONFIG, [f"cohort.patients={wanted.patients}", *wanted.changes])
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            first = time.perf_counter()
            begun: list[float] = []

            def on_progress(progress: Progress, begun: list[float] = begun) -> None:
                begun.append(time.perf_counter())

            run_cohort(cohort, folder, workers=workers, on_progress=on_progress)
            seconds = begun[-1] - begun[0]
            sizes = {
                part: sum(
                    path.stat().st_size
                    for path in Path(folder, "patients").rglob("*")
                    if path.is_file() and (".stages" in path.parts) == (part == "stages")
                )
                for part in ("files", "stages")
            }
        each = {part: size / wanted.patients / 1e6 for part, size in sizes.items()}
        print(
            f"{workers} workers: {wanted.patients} patients in {seconds:.0f} s, "
            f"{3600 * wanted.patients / seconds:.0f} patients an hour; workers started in "
            f"{begun[0] - first:.1f} s; {each['files']:.1f} MB a patient, "
            f"{each['stages']:.1f} MB of kept stages",
            flush=True,
        )


def overhead(count: int) -> None:
    """Time from handing out to answer, of tasks that do nothing."""
    with local_client(Workers(1, 1, 2.0)) as client:
        client.submit(Outcome, 0).result()
        start = time.perf_counter()
        for index in range(1, count + 1):
            client.submit(Outcome, index, pure=False).result()
        seconds = time.perf_counter() - start
    print(f"Dask: {1e3 * seconds / count:.1f} ms a task", flush=True)


if __name__ == "__main__":
    main()
