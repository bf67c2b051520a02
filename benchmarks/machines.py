"""What differs between machines: runs on two of them, or on this one made to look like others.

    python benchmarks/machines.py [OUT] [--only NAME ...]
    python benchmarks/machines.py --compare RUN_A RUN_B

The first makes the cases below as this machine would, and then with everything switched that rounds
otherwise elsewhere: the instructions that kernels are compiled for, those that NumPy, the C library
and BLAS choose when they start. A line of digests shows whether a switch changed how they round.

The second compares two finished runs of one configuration, made on two machines; status 1 says that
they differ by more than docs/explanation/reliability.md allows. Path lengths are compared where
both runs wrote them (`export.path_lengths: true`), the uncompressed labels where both kept them.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pydicom
import tifffile
from numpy._core._multiarray_umath import __cpu_dispatch__ as numpy_dispatched
from numpy.typing import ArrayLike, NDArray

from mammosim.config import write_yaml
from mammosim.export import load_path_lengths
from mammosim.phantom import generate_phantom
from mammosim.pipeline import SavedView, read_views

CASES = {
    "springs": (450, ["CC", "MLO"], {"resolution_mm": 1.5, "model": "springs"}),
    "hyperelastic": (300, ["CC"], {"resolution_mm": 4.0, "model": "hyperelastic"}),
}
"""Volume in mL, views, and the section `compression`."""

BREASTS, BREAST_VOXEL_MM, FIRST_SEED = 12, 3.0, 100  # only generated, of all density classes
SSE2_KERNELS = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
OLD_NUMPY = {"NPY_DISABLE_CPU_FEATURES": " ".join(numpy_dispatched)}
OLD_LIBRARY = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}
OLD_BLAS = {"OPENBLAS_CORETYPE": "Nehalem"}
VARIANTS: dict[str, dict[str, str]] = {
    "as it is": {},
    "kernels SSE2": SSE2_KERNELS,
    "kernels Haswell": {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": ""},
    "NumPy AVX2": {"NPY_DISABLE_CPU_FEATURES": " ".join(numpy_dispatched[1:])},
    "NumPy SSE4": OLD_NUMPY,
    "C library SSE2": OLD_LIBRARY,
    "BLAS Nehalem": OLD_BLAS,
    "all oldest": SSE2_KERNELS | OLD_NUMPY | OLD_LIBRARY | OLD_BLAS,
}
"""Processors that this one can be made to look like, by the environment."""

LABELS, CELLS, MOVED_LABELS = 1e-6, 2e-3, 1e-3
PATH_MM, PIXEL_COUNTS, NUMBERS, ROWS = 5e-3, 0.1, 1e-3, 1e-2
"""The tolerance that docs/explanation/reliability.md states and gives reasons for."""


@dataclass(frozen=True)
class Difference:
    """How far two runs lie apart in one quantity, and how far they may: at most, or on average."""

    where: str
    quantity: str
    largest: float
    mean: float
    allowed: float
    on_average: bool = False

    @property
    def beyond(self) -> bool:
        """Whether that is more than the tolerance; NaN is."""
        return not (self.mean if self.on_average else self.largest) <= self.allowed

    def __str__(self) -> str:
        told = f"{self.where:5s}{self.quantity:38s}{self.largest:10.1e}{self.mean:10.1e}"
        told += f"{self.allowed:10.1e}{' on average' if self.on_average else ''}"
        return told + (" BEYOND" if self.beyond else "")


HEAD = f"{'':43s}{'largest':>10s}{'mean':>10s}{'allowed':>10s}"


def main() -> None:
    """Run and compare, or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("machines"))
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), default=list(VARIANTS))
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("RUN_A", "RUN_B"))
    parser.add_argument("--breasts", type=Path, help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    if wanted.breasts:
        make_breasts(wanted.breasts)
    elif wanted.compare:
        differences = list(compare(*wanted.compare))
        print(HEAD, *differences, sep="\n")
        sys.exit(any(difference.beyond for difference in differences))
    else:
        run_variants(wanted.out, list(dict.fromkeys(["as it is", *wanted.only])))


def run_variants(out: Path, names: list[str]) -> None:
    """Make all cases in each variant's environment, and compare them with the first's."""
    first = out / names[0]
    for name in names:
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(out / "numba"), **VARIANTS[name]}
        # Numba keeps code of each instruction set apart, so that one folder serves all.
        digests = _python(environment, __file__, "--breasts", folder / "breasts.npz")
        print(f"\n{name}: {digests.strip()}")
        for case in CASES:
            write_yaml(configuration(*CASES[case]), out / f"{case}.yaml")
            _python(environment, "-m", "mammosim", "run", out / f"{case}.yaml",
                    "--output", folder / case, "--resume")  # fmt: skip
        if folder != first:
            with np.load(first / "breasts.npz") as a, np.load(folder / "breasts.npz") as b:
                same = sum(np.array_equal(a[name], b[name]) for name in a.files)
            print(f"{same} of {BREASTS} generated breasts are the same in every voxel")
            for case in CASES:
                print(case, HEAD[len(case) + 1 :], *compare(first / case, folder / case), sep="\n")


def _python(environment: dict[str, str], *words: object) -> str:
    command = [sys.executable, *map(str, words)]
    return subprocess.check_output(command, env=environment, text=True)


def configuration(volume_ml: int, views: list[str], compression: dict[str, object]) -> object:
    """A run's configuration: a small breast with two lesions, coarse pixels."""
    return {
        "phantom": {
            "generate": {"density": "scattered", "volume_ml": volume_ml, "voxel_mm": 1.0},
            "lesions": [
                {"name": "mass", "kind": "mass", "diameter_mm": 12, "margin": "spiculated"},
                {"name": "cluster", "kind": "calcification", "diameter_mm": 9},
            ],
        },
        "compression": compression, "projection": {"pixel_mm": 0.3}, "views": views, "seed": 3,
        "export": {"path_lengths": True}, "report": {"html": False},
    }  # fmt: skip


def make_breasts(path: Path) -> None:
    """Generate breasts, and tell how elementary functions and sums are rounded here."""
    x = np.random.default_rng(1).uniform(0.1, 20.0, 100_000)
    rounded = {
        "NumPy": np.exp(x),
        "C library": np.array([value**1.6 for value in x.tolist()]),
        "BLAS": np.array(x @ np.sqrt(x)),
    }
    for name, values in rounded.items():
        print(name, hashlib.sha256(values.tobytes()).hexdigest()[:6], end="  ")
    densities = ("fatty", "scattered", "heterogeneous", "dense")
    made = [
        generate_phantom(densities[n % 4], BREAST_VOXEL_MM, FIRST_SEED + n, "LR"[n % 2]).labels
        for n in range(BREASTS)
    ]
    np.savez_compressed(path, *made)


def compare(first: Path, second: Path) -> Iterator[Difference]:
    """Differences between two finished runs of one configuration."""
    runs = (first, second)
    records = [json.loads((run / "run.json").read_text(encoding="utf-8")) for run in runs]
    if records[0]["run_hash"] != records[1]["run_hash"]:
        sys.exit(f"{first}, {second}: runs of different configurations, inputs or versions")
    kept = [run / ".stages" / "phantom.npz" for run in runs]
    if all(path.exists() for path in kept):
        yield _share("", "labels of the breast, share", *map(_kept_labels, kept), LABELS)
    for name in sorted(records[0]["views"]):
        yield from _compare_compression(name, *(read_views(run, [name])[name] for run in runs))
        yield from _compare_images(name, *(run / name for run in runs))
        yield _compare_numbers(name, *(record["views"][name] for record in records))
    yield from _compare_tables(*(run / "lesions.csv" for run in runs))


def _kept_labels(path: Path) -> NDArray[np.uint8]:
    with np.load(path, allow_pickle=False) as archive:
        return next(part for part in map(archive.get, archive.files) if part.ndim == 3)


def _compare_compression(name: str, a: SavedView, b: SavedView) -> Iterator[Difference]:
    yield _share(name, "nodes in tissue, share", a.field.tissue, b.field.tissue, 0.0)
    gap = _gap(*(view.field.displacement_mm[view.field.tissue] for view in (a, b)))
    cells = np.linalg.norm(gap, axis=-1) / a.field.frame.spacing_mm[0]
    yield _spread(name, "displacement, lattice cells", cells, CELLS)
    if a.labels is not None and b.labels is not None:
        yield _share(name, "compressed labels, share", a.labels, b.labels, MOVED_LABELS)


def _compare_images(name: str, *folders: Path) -> Iterator[Difference]:
    if all((folder / "path_lengths.npz").exists() for folder in folders):
        gap = _gap(*(load_path_lengths(f / "path_lengths.npz").length_mm for f in folders))
        yield _spread(name, "path lengths, mm", gap, PATH_MM, on_average=True)
    gap = _gap(*(tifffile.imread(folder / "mammogram.tif").astype(float) for folder in folders))
    yield _spread(name, "pixels, counts", gap, PIXEL_COUNTS, on_average=True)
    files = (pydicom.dcmread(folder / "for_processing.dcm") for folder in folders)
    yield _share(name, "UID", *(np.array(file.SOPInstanceUID) for file in files), 0.0)


def _compare_numbers(name: str, a: dict[str, float], b: dict[str, float]) -> Difference:
    """Force, tube load, dose and what else the record says of a view."""
    gaps = [b[key] / a[key] - 1.0 for key in a if isinstance(a[key], float) and a[key]]
    return _spread(name, "force, mAs, dose, ..., relative", gaps, NUMBERS)


def _compare_tables(*paths: Path) -> Iterator[Difference]:
    """Columns in mm, in pixels, and others."""
    one, other = (list(csv.DictReader(path.open(encoding="utf-8"))) for path in paths)
    gaps: dict[str, list[float]] = {"mm": [], "px": [], "others": []}
    for row, twin in zip(one, other, strict=True):
        for key, text in row.items():
            unit = key.rsplit("_", 1)[-1]
            try:
                gap = float(text) - float(twin[key])
            except ValueError:  # names, hours, empty cells
                gap = 0.0 if text == twin[key] else np.inf
            gaps[unit if unit in gaps else "others"].append(gap)
    for unit, found in gaps.items():
        yield _spread("", f"lesions.csv, {unit}", found, ROWS)


def _share(where: str, quantity: str, a: ArrayLike, b: ArrayLike, allowed: float) -> Difference:
    """Share of elements that differ; all of them where shapes do."""
    share = float(np.mean(np.not_equal(a, b))) if np.shape(a) == np.shape(b) else 1.0
    return Difference(where, quantity, share, share, allowed)


def _gap(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.floating]:
    return a - b if a.shape == b.shape else np.array([np.inf])


def _spread(where: str, quantity: str, gap: ArrayLike, *allowed: float, **how: bool) -> Difference:
    size = np.abs(np.asarray(gap, dtype=float))
    return Difference(where, quantity, float(size.max()), float(size.mean()), *allowed, **how)


if __name__ == "__main__":
    main()
