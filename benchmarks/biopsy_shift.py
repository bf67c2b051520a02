"""Where lesions go in many generated breasts, beside published clip migration and the thesis.

    python benchmarks/biopsy_shift.py OUT [--breasts 24] [--lesions 3] [--voxel-mm 1.5]
        [--elements 6] [--model hyperelastic]
    python benchmarks/biopsy_shift.py OUT --samples 50 [--view MLO] [--model springs]

Each breast is drawn by its seed (density class in turn, volume, side), gets lesions of 8 mm at
random places in gland, and is compressed in CC and MLO to the population's thickness, by elements
with the plates' edge 15 (CC) and 10 mm (MLO) in front of the wall, or by springs as they are by
default. Written are `shifts.csv`, one line per lesion and view, as soon as a breast is done (a
second start computes only what is missing), `summary.json` and the picture. `along_mm` is as in
lesions.csv, where both plates close on the middle of the breast; `from_support_mm` is the same seen
from the breast support, on which the lowest tissue in front of the plates' edge lies. With
`--samples` instead: the time of that many samples of `targets.uncertainty` for the quickstart's
breast in CC or MLO, compressed as there by elements of 3 mm, or by springs of 1 mm on a fixed wall
with the same moduli; its lesions' ellipsoids, also as seen from the nipple; and shifts.npy,
[sample, target, 3].
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast, CompressionSettings, Sampler, compress
from mammosim.phantom import BreastPhantom, PhantomSettings, as_held, make_phantom
from mammosim.pipeline import load_config
from mammosim.targets import (
    UncertaintySettings,
    UncompressedTarget,
    draw_samples,
    sampled_shifts,
    target_origins,
    uncertainties,
)
from mammosim.targets.biopsy import miss_mm
from mammosim.targets.origins import mean_shift_mm

DENSITIES = ("fatty", "scattered", "heterogeneous", "dense")
CLIPS: dict[str, tuple[str, list[float], list[float]]] = {
    "Kass et al. 2002": ("k^", [9.5, 20.0], [50.0, 78.5]),
    "Uematsu et al. 2012": ("ks", [5.0, 20.0], [58.0, 84.0]),
    "Wang et al. 2020": ("kD", [20.0], [91.5]),
}
"""Marker, mm, and per cent of clips below: Am J Surg 184:325 (93 clips; mean 13.5 mm, up to 78 mm),
Breast Cancer 19:30 (204), Eur Radiol 30:6080 (176)."""

QUICKSTART = Path(__file__).parents[1] / "configs" / "quickstart.yaml"

THESIS_MM = (8.0, 13.0)
"""How far abnormalities moved under the highest compression of the source thesis."""


EDGES_MM = {"CC": 15.0, "MLO": 10.0}
"""Place of the plates' edge in front of the wall with elements, as in the examples."""


def shifts_of(
    seed: int, lesions: int, voxel_mm: float, model: str, elements_mm: float
) -> list[dict[str, float | str]]:
    """One row per lesion and view of one drawn breast."""
    density = DENSITIES[seed % len(DENSITIES)]
    settings = PhantomSettings.model_validate(
        {
            "generate": {"density": density, "voxel_mm": voxel_mm},
            "lesions": [
                {"name": f"mass {n}", "kind": "mass", "diameter_mm": 8} for n in range(lesions)
            ],
        }
    )
    breast = make_phantom(settings, "LR"[seed % 2], seed)
    origins = target_origins(breast)
    rows = []
    for view in ("CC", "MLO"):
        keys: dict[str, Any] = {"resolution_mm": 1.0}
        if model == "hyperelastic":
            keys = {"resolution_mm": elements_mm, "plate_edge_mm": EDGES_MM[view]}
        compressed = compress(breast, view=view, model=model, **keys)
        moved = [mean_shift_mm(compressed.field, origin) for origin in origins]
        nothing = np.zeros(3)
        raised = compressed.support_z_mm - lowest_mm(breast, compressed)
        for origin, shift in zip(origins[:-1], moved[:-1], strict=True):
            across_x, across_y, along = compressed.view.rotation @ shift
            missed = miss_mm(shift, moved[-1], nothing, nothing)
            normal = compressed.view.rotation[2]
            needle = missed - (missed @ normal) * normal
            rows.append(
                {
                    "seed": seed, "density": density, "view": view, "lesion": origin.name,
                    "volume_ml": compressed.measures["volume_before_ml"],
                    "thickness_mm": compressed.thickness_mm,
                    "shift_mm": float(np.linalg.norm(shift)), "along_mm": float(along),
                    "from_support_mm": float(along - raised),
                    "across_mm": float(np.hypot(across_x, across_y)),
                    "miss_mm": float(np.linalg.norm(missed)),
                    "needle_miss_mm": float(np.linalg.norm(needle)),
                }
            )  # fmt: skip
    return rows


def lowest_mm(breast: BreastPhantom, compressed: CompressedBreast) -> float:
    """Height of the lowest tissue in front of the plates' edge at rest, compression frame."""
    held = as_held(breast, compressed.view.rotation[1])
    places = held.origin_mm + np.argwhere(held.labels) * held.voxel_mm
    ahead = places[places[:, 0] > compressed.plate_edge_mm] @ compressed.view.rotation.T
    return float(ahead[:, 2].min() - 0.5 * held.voxel_mm[0])


def summary(rows: list[dict[str, float | str]]) -> dict[str, dict[str, float]]:
    """Quantiles of each length, for both views and each of them, and by thickness."""
    found = {}
    thin = np.median([float(row["thickness_mm"]) for row in rows])
    parts: dict[str, list[dict[str, float | str]]] = {
        "all": rows,
        "CC": [row for row in rows if row["view"] == "CC"],
        "MLO": [row for row in rows if row["view"] == "MLO"],
        "thinner half": [row for row in rows if float(row["thickness_mm"]) <= thin],
        "thicker half": [row for row in rows if float(row["thickness_mm"]) > thin],
    }
    for part, chosen in parts.items():
        for key in (
            "shift_mm", "along_mm", "from_support_mm", "across_mm", "miss_mm", "needle_miss_mm",
        ):  # fmt: skip
            values = np.abs([float(row[key]) for row in chosen])
            found[f"{part}: {key}"] = {
                "n": len(values), "mean": float(values.mean()), "median": float(np.median(values)),
                "p95": float(np.quantile(values, 0.95)), "largest": float(values.max()),
                "beyond_20_percent": float(100.0 * (values > 20.0).mean()),
            }  # fmt: skip
        along = np.abs([float(row["along_mm"]) for row in chosen])
        across = np.array([float(row["across_mm"]) for row in chosen])
        found[f"{part}: mostly along"] = {"percent": float(100.0 * (along > across).mean())}
    return found


def time_samples(count: int, view: str, model: str, out: Path) -> None:
    """Time samples of one breast, compiled code being there, and print its ellipsoids."""
    config = load_config(QUICKSTART)
    keys = {one.view: one.compression for one in config.resolved_views}
    given = keys[view].model_dump(exclude_unset=True)
    if model == "springs":
        given |= {"model": "springs", "resolution_mm": 1.0, "chest_wall": "fixed"}
    breast = make_phantom(config.phantom, config.laterality, config.seed)
    compressed = compress(breast, view=view, **given)
    origins = target_origins(breast)
    sampler = Sampler(compressed, CompressionSettings(**given))
    ratio = CompressionSettings(**given).fibres.ratio if sampler.has_fibres else None
    wanted = UncertaintySettings(samples=count)
    samples = draw_samples(wanted, sampler.groups, f"L{view}", config.seed, ratio)
    start, start_cpu = time.perf_counter(), time.process_time()
    shifts = sampled_shifts(sampler, origins, samples)
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    nodes = int(np.count_nonzero(compressed.field.tissue))
    print(f"{count} samples of {nodes} nodes: {seconds:.1f} s, {cpu:.1f} s of processor time")
    for number in np.flatnonzero(np.isnan(shifts).any(axis=(1, 2))):
        print(f"not converged: {number + 1} ({samples[number]})")
    np.save(out / "shifts.npy", shifts)
    for origin in origins:
        print(f"{origin.name}: nominal {mean_shift_mm(compressed.field, origin).round(1)} mm")
    print_ellipsoids(origins, view, shifts)
    print("as seen from the nipple:")
    print_ellipsoids(origins[:-1], view, shifts[:, :-1] - shifts[:, -1:])


def print_ellipsoids(
    origins: Sequence[UncompressedTarget], view: str, shifts: NDArray[np.float64]
) -> None:
    """Mean and 95 % ellipsoid of each target's shifts, [sample, target, 3]."""
    for row in uncertainties(origins, {view: shifts}):
        axes = f"{row.long_mm:.1f}, {row.middle_mm:.1f}, {row.short_mm:.1f} mm"
        mean = f"{row.shift_x_mm:.1f}, {row.shift_y_mm:.1f}, {row.shift_z_mm:.1f} mm"
        print(f"{row.name}: {row.samples} samples, mean {mean}, ellipsoid {axes}")


def known_rows(path: Path) -> list[dict[str, float | str]]:
    """Lines of an earlier start."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [dict(row) for row in csv.DictReader(file)]


def draw(rows: list[dict[str, float | str]], path: Path) -> None:
    """Cumulative distributions of shift and miss, with what is published."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for key, label, colour in (
        ("shift_mm", "shift of a lesion, uncompressed to compressed", "#2f75b5"),
        ("from_support_mm", "... along the axis, from the support", "#6aaae4"),
        ("miss_mm", "miss of a needle aimed in the released breast", "#bb6a22"),
    ):
        values = np.sort(np.abs([float(row[key]) for row in rows]))
        share = np.arange(1, values.size + 1) / values.size
        axes.step(values, 100.0 * share, where="post", label=label, color=colour)
    for name, (marker, length_mm, percent) in CLIPS.items():
        axes.plot(length_mm, percent, marker, markersize=5, label=f"clip migration, {name}")
    axes.axvspan(*THESIS_MM, color="#888888", alpha=0.2, label="abnormalities of the thesis")
    axes.set_xlabel("mm")
    axes.set_ylabel("per cent of lesions below")
    axes.set_xlim(0.0, 60.0)
    axes.set_ylim(0.0, 100.0)
    axes.grid(alpha=0.2)
    axes.legend(frameon=False, fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run the breasts and write what they gave."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--breasts", type=int, default=24)
    parser.add_argument("--first", type=int, default=1, help="seed to begin with")
    parser.add_argument("--lesions", type=int, default=3)
    parser.add_argument("--voxel-mm", type=float, default=1.5)
    parser.add_argument("--elements", type=float, default=6.0)
    parser.add_argument("--samples", type=int, default=0)
    parser.add_argument("--view", choices=("CC", "MLO"), default="CC", help="of the samples")
    parser.add_argument("--model", choices=("hyperelastic", "springs"), default="hyperelastic")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.samples:
        time_samples(given.samples, given.view, given.model, given.out)
        return
    table = given.out / "shifts.csv"
    start, done = time.perf_counter(), {int(row["seed"]) for row in known_rows(table)}
    for seed in sorted(set(range(given.first, given.breasts + 1)) - done):
        rows = shifts_of(seed, given.lesions, given.voxel_mm, given.model, given.elements)
        new = not table.exists()
        with table.open("a", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            if new:
                writer.writeheader()
            writer.writerows(rows)
        print(f"{seed} of {given.breasts}: {time.perf_counter() - start:.0f} s", flush=True)
    rows = known_rows(table)
    found = summary(rows)
    (given.out / "summary.json").write_text(json.dumps(found, indent=2) + "\n")
    draw(rows, given.out / "biopsy-shift.png")
    for name, values in found.items():
        print(name, {key: round(value, 1) for key, value in values.items()})


if __name__ == "__main__":
    main()
