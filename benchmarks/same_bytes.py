"""Two checkouts make the same runs: which data files differ, and how long each checkout takes.

    python benchmarks/same_bytes.py BEFORE AFTER --victre p_1.mhd [--runs quickstart victre springs]
    python benchmarks/same_bytes.py BEFORE AFTER --time 9 [--cold] --runs small

BEFORE and AFTER are checkouts of mammosim. Each run is made by `python -m mammosim run` of either
checkout, both from BEFORE's configurations: the quickstart, FDA's VICTRE phantom, a `springs` run
with every file that can be asked for (tomosynthesis, biopsy, uncertainty, all exports), and on
request a small one for quick looks. Files that hold times (`run.json`, `report.html`) are not data;
of the record, run hash, settings, status and warnings must agree. The exit status is 1 where
anything differs.

With `--time N` each run is repeated N times by both checkouts in turn. Printed are the medians of
wall time and of processor time (user and system, all threads) and their ratios, AFTER over BEFORE;
the first run of each, which compiles, is not counted. With `--cold` every run has an empty cache of
compiled code. With `--folder` runs are kept, and those of BEFORE that are there are not repeated.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

NOT_DATA = ("run.json", "report.html", ".lock")
SAME_IN_RECORD = ("run_hash", "settings", "status", "warnings", "views", "tomosynthesis", "files")

EVERYTHING = {
    "compressed_formats": ["nrrd", "mha", "victre"],
    "matlab": True, "path_lengths": True, "glandular_thickness": True,
    "volumetric_density": True, "lesion_lengths": True,
}  # fmt: skip

LESIONS = [
    {"name": "mass", "kind": "mass", "diameter_mm": 14, "position_mm": [40, -24, -10]},
    {"name": "cluster", "kind": "calcification", "diameter_mm": 10},
    {"name": "clip", "kind": "clip"},
]

SPRINGS = {
    "phantom": {
        "generate": {"density": "heterogeneous", "volume_ml": 450, "voxel_mm": 0.8},
        "lesions": LESIONS, "landmarks": [{"name": "middle", "position_mm": [35, 0, 0]}],
    },
    "compression": {"model": "springs", "resolution_mm": 2.5},
    "projection": {"pixel_mm": 0.2},
    "targets": {"biopsy": {"view": "ML", "thickness_mm": 55}, "uncertainty": {"samples": 10}},
    "export": EVERYTHING,
    "views": [
        "CC", {"view": "MLO", "plate_edge_mm": 5, "mas": 80},
        {"dbt": {"view": "CC", "projections": 5}},
    ],
    "seed": 3,
}  # fmt: skip
"""Multigrid in three positions, a series of projections, both answers about biopsy, all files."""

SMALL = {
    **SPRINGS,
    "phantom": {"generate": {"volume_ml": 300, "voxel_mm": 2.0}, "lesions": [
        {"name": "mass", "kind": "mass", "diameter_mm": 14, "position_mm": [35, -10, 0]}]},
    "compression": {"model": "hyperelastic", "resolution_mm": 6, "thickness_mm": 50},
    "projection": {"pixel_mm": 0.5},
    "targets": {"biopsy": {"view": "none"}},
    "views": ["CC", {"view": "MLO", "model": "springs", "solver": "relaxation"},
              {"dbt": {"view": "ML", "projections": 3}}],
}  # fmt: skip
"""A few seconds: both models, both solvers."""

MADE_HERE = {"springs": SPRINGS, "small": SMALL}


class Spent(NamedTuple):
    """Seconds of one run."""

    wall: float
    processor: float


def main() -> int:
    """Compare, or time, the runs that the command line asks for."""
    options = _options()
    with contextlib.ExitStack() as stack:
        folder = options.folder
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        differ = False
        for name in options.runs:
            command = _command(name, options, folder)
            if command is None:
                print(f"{name}: skipped; give --victre PATH of p_1.mhd")
            elif options.time:
                _time_both(name, command, options, folder)
            else:
                differ |= _compare(name, command, options, folder)
    return int(differ)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--victre", type=Path, help="FDA's phantom p_1.mhd")
    parser.add_argument(
        "--runs", nargs="+", default=["quickstart", "victre", "springs"],
        choices=["quickstart", "victre", *MADE_HERE],
    )  # fmt: skip
    parser.add_argument("--folder", type=Path, help="keep the runs here")
    parser.add_argument("--time", type=int, default=0, metavar="N", help="repeat and time")
    parser.add_argument("--cold", action="store_true", help="compile anew in every timed run")
    options = parser.parse_args()
    options.before, options.after = options.before.resolve(), options.after.resolve()
    return options


def _command(name: str, options: argparse.Namespace, folder: Path) -> list[str] | None:
    """Arguments of `mammosim run` without the output; None where the phantom is missing."""
    if name in MADE_HERE:
        path = folder / f"{name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(MADE_HERE[name], indent=1))
        return [str(path.resolve())]
    path = options.before / "configs" / f"{name}.yaml"
    if name != "victre":
        return [str(path)]
    if options.victre is None:
        return None
    return [str(path), "--set", f"phantom.file={options.victre.resolve()}"]


def _run(checkout: Path, command: list[str], output: Path, compiled: Path | None) -> Spent:
    """One run by one checkout, into an empty folder."""
    shutil.rmtree(output, ignore_errors=True)
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    if compiled is not None:
        environment["NUMBA_CACHE_DIR"] = str(compiled)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "mammosim", "run", *command, "--output", str(output.resolve())],
        env=environment, cwd=tempfile.gettempdir(), capture_output=True, text=True,
    )  # fmt: skip
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3):  # 3: not converged, which must be the same in both
        sys.exit(f"{checkout}: mammosim run {' '.join(command)} failed\n{done.stdout}{done.stderr}")
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Spent(wall, spent)


def _compare(name: str, command: list[str], options: argparse.Namespace, folder: Path) -> bool:
    """Make a run by both checkouts and print what differs; whether anything does."""
    runs = {side: folder / side / name for side in ("before", "after")}
    for side, output in runs.items():
        if side == "after" or not (output / "run.json").is_file():
            _run(getattr(options, side), command, output, None)
    files = {side: _data_files(output) for side, output in runs.items()}
    lines = [f"only {side}: {path}" for side, other in (("before", "after"), ("after", "before"))
             for path in sorted(files[side] - files[other])]  # fmt: skip
    both = sorted(files["before"] & files["after"])
    lines += [
        f"differs: {path}" for path in both
        if (runs["before"] / path).read_bytes() != (runs["after"] / path).read_bytes()
    ]  # fmt: skip
    records = [_record(output) for output in runs.values()]
    lines += [f"differs: run.json, {key}" for key in SAME_IN_RECORD
              if records[0].get(key) != records[1].get(key)]  # fmt: skip
    print(f"{name}: {len(both)} data files compared, {len(lines)} differences", flush=True)
    for line in lines:
        print(f"  {line}")
    return bool(lines)


def _data_files(output: Path) -> set[Path]:
    """Paths of a run's data in its folder; hidden files are no part of it."""
    paths = {path.relative_to(output) for path in output.rglob("*") if path.is_file()}
    return {
        path for path in paths
        if path.name not in NOT_DATA and not any(part.startswith(".") for part in path.parts)
    }  # fmt: skip


def _record(output: Path) -> dict[str, Any]:
    record: dict[str, Any] = json.loads((output / "run.json").read_text())
    return record


def _time_both(name: str, command: list[str], options: argparse.Namespace, folder: Path) -> None:
    """Repeat a run by both checkouts in turn and print the medians."""
    spent: dict[str, list[Spent]] = {"before": [], "after": []}
    warm = {side: folder / f"compiled-{side}" for side in spent}
    for number in range(options.time + (0 if options.cold else 1)):
        for side in spent if number % 2 == 0 else reversed(spent):
            compiled = warm[side]
            if options.cold:
                shutil.rmtree(compiled, ignore_errors=True)
            output = folder / "timed" / side / name
            taken = _run(getattr(options, side), command, output, compiled)
            if options.cold or number > 0:
                spent[side].append(taken)
    state = "cold" if options.cold else "warm"
    for index, kind in enumerate(Spent._fields):
        before, after = (
            statistics.median(taken[index] for taken in spent[side]) for side in ("before", "after")
        )
        print(
            f"{name}, {state}, {kind} time, median of {options.time}: "
            f"{before:.2f} s before, {after:.2f} s after, ratio {after / before:.3f}", flush=True,
        )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
