"""Forty generated breasts, ten a density class, run to CC pictures; and the generator's speed.

    python benchmarks/generator.py [--breasts 10] [--voxel 0.5] [--output DIR]
    python benchmarks/generator.py speed 0.2 [--volume 620]

The first writes a table (breasts.csv), its summary to the terminal and, with matplotlib, the
histograms of docs/explanation/phantom.md. The second makes one breast in a process of its own and
prints time and peak memory.
"""

from __future__ import annotations

import argparse
import csv
import resource
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim.phantom import phantom_summary
from mammosim.phantom.anatomy import DENSITY_PERCENT
from mammosim.report.texture import power_law_exponent

PIXEL_MM = 0.2
"""Coarse, which leaves area and texture up to 0.7 / mm."""

COMPRESSION = {"model": "hyperelastic", "resolution_mm": 4.0, "chest_wall": "sliding",
               "stiffness": "krouskop", "plate_edge_mm": 15.0}  # fmt: skip
DETECTOR_EDGE_MM = 20.0
"""As CC of configs/cohort.yaml."""

COLUMNS = (
    "seed", "density", "target_percent", "percent", "projected_percent", "volume_ml",
    "thickness_mm", "area_cm2", "force_n", "pressure_kpa", "exponent", "seconds",
)  # fmt: skip

PUBLISHED = {
    "exponent": ("mammograms: 2.8, 1.5 to 3.5 (Burgess)", 2.8, (1.5, 3.5)),
    "area_cm2": ("CC: 146, 95 % within 58 to 298 (Boone 2000)", 146.0, (58.0, 298.0)),
    "thickness_mm": ("52, 95 % within 24 to 79 (Boone 2000)", 52.0, (24.0, 79.0)),
    "force_n": ("122, all within 49 to 186 (Sullivan 1991)", 122.5, (49.0, 186.0)),
}
"""Caption, middle and range of what is published of each column."""


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("speed", nargs="*", help="`speed` and a voxel size in mm")
    parser.add_argument("--breasts", type=int, default=10, help="breasts a density class")
    parser.add_argument("--voxel", type=float, default=0.5, help="voxel size, mm")
    parser.add_argument("--volume", type=float, help="volume for `speed`, mL")
    parser.add_argument("--output", type=Path, default=Path("generated"))
    chosen = parser.parse_args()
    if chosen.speed:
        measure_speed(float(chosen.speed[1]), chosen.volume)
        return
    chosen.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for number, density in enumerate(DENSITY_PERCENT):
        for seed in range(100 * number + 1, 100 * number + chosen.breasts + 1):
            try:
                rows.append(one_breast(density, seed, chosen.voxel))
            except mammosim.NotConverged as error:
                print(f"{density}, seed {seed}: {error}", flush=True)
    with (chosen.output / "breasts.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    summarise(rows)
    draw_histograms(rows, chosen.output / "histograms.png")


def one_breast(density: str, seed: int, voxel_mm: float) -> dict[str, float | str]:
    """Generate, compress to the population's thickness, project and expose one breast in CC."""
    start = time.perf_counter()
    breast = mammosim.generate_phantom(density, voxel_mm, seed)
    summary = phantom_summary(breast)
    compressed = mammosim.compress(breast, view="CC", **COMPRESSION)
    paths = mammosim.project(compressed, pixel_mm=PIXEL_MM, detector_edge_mm=DETECTOR_EDGE_MM)
    image = mammosim.expose(paths, seed=seed)
    row = {
        "seed": seed, "density": density, "target_percent": DENSITY_PERCENT[density],
        "percent": summary.fibroglandular_percent,
        "projected_percent": image.measures["volumetric_density_percent"],
        "volume_ml": summary.breast_ml, "thickness_mm": compressed.thickness_mm,
        "area_cm2": np.count_nonzero(paths.length_mm.sum(axis=0)) * PIXEL_MM**2 / 100.0,
        "force_n": compressed.force_n, "pressure_kpa": compressed.measures["pressure_kpa"],
        "exponent": power_law_exponent(image), "seconds": time.perf_counter() - start,
    }  # fmt: skip
    print(" ".join(f"{name} {value:.4g}" if not isinstance(value, str) else value
                   for name, value in row.items()), flush=True)  # fmt: skip
    return row


def column(rows: list[dict[str, float | str]], name: str) -> NDArray[np.float64]:
    """One column as numbers."""
    return np.array([float(row[name]) for row in rows])


def summarise(rows: list[dict[str, float | str]]) -> None:
    """Print how density meets its target, and the spread of everything else."""
    for density in DENSITY_PERCENT:
        mine = [row for row in rows if row["density"] == density]
        off = column(mine, "percent") - column(mine, "target_percent")
        print(f"{density}: density off its target by {np.abs(off).max():.2f} points at most, "
              f"exponent {column(mine, 'exponent').mean():.2f}")  # fmt: skip
    for name in ("volume_ml", "projected_percent", *PUBLISHED, "pressure_kpa"):
        values = column(rows, name)
        low, high = np.percentile(values, [2.5, 97.5])
        print(f"{name}: mean {values.mean():.4g}, median {np.median(values):.4g}, standard "
              f"deviation {values.std():.3g}, 95 % within {low:.4g} to {high:.4g}")  # fmt: skip
    inside = np.mean((column(rows, "exponent") >= 2.5) & (column(rows, "exponent") <= 3.3))
    print(f"exponent within 2.5 to 3.3: {100 * inside:.0f} % of breasts")


def draw_histograms(rows: list[dict[str, float | str]], path: Path) -> None:
    """Histograms beside what is published."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, len(PUBLISHED), figsize=(13, 2.8), layout="constrained")
    for panel, (name, (caption, middle, (low, high))) in zip(
        panels, PUBLISHED.items(), strict=True
    ):
        panel.axvspan(low, high, color="0.9")
        panel.axvline(middle, color="0.5", linestyle="--")
        panel.hist(column(rows, name), bins=12, color="tab:blue")
        panel.set_xlabel(name.replace("_", " "))
        panel.set_title(caption, fontsize=8)
    panels[0].set_ylabel("breasts")
    figure.savefig(path, dpi=80)


def measure_speed(voxel_mm: float, volume_ml: float | None) -> None:
    """Make one breast after the code is compiled, and print what it took."""
    mammosim.generate_phantom("scattered", 4.0, 1)
    start = time.perf_counter()
    breast = mammosim.generate_phantom("scattered", voxel_mm, 1, volume_ml=volume_ml)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"{breast.labels.size / 1e6:.0f} million voxels of {voxel_mm:g} mm: {seconds:.1f} s, "
          f"peak {peak:.2f} GB")  # fmt: skip


if __name__ == "__main__":
    main()
