"""Effect of each part of the model: skin, fascia, fibres, weight, tilt, friction.

    python benchmarks/structure.py STRUCTURE.csv [--elements 5] [--breasts 1 2 3]
        [--picture OUT.png]

Compresses three generated breasts (200, 500 and 1000 mL) in CC to the thickness of the population
fit, with one part changed at a time, and compares with the defaults: force, contact area, how far
the nipple moves forward, and the distance of tissue from its place with the defaults. Each
compression is a row of the file; those that have a row are not run again. The picture shows them
all.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import mammosim
from mammosim.compression import CompressedBreast

BREASTS = (("scattered", 200.0), ("heterogeneous", 500.0), ("fatty", 1000.0))

CHANGES: dict[str, dict[str, Any]] = {
    "default": {},
    "skin does not stiffen": {"skin": {"stiffening": 0.0}},
    "skin of 5.6 kPa": {"skin": {"young_kpa": 5.63}},
    "skin of 344 kPa": {"skin": {"young_kpa": 344.0}},
    "fascia 0.1 kPa/mm": {"fascia_kpa_per_mm": 0.1},
    "fascia 10 kPa/mm": {"fascia_kpa_per_mm": 10.0},
    "wall fixed": {"chest_wall": "fixed"},
    "fibres, ratio 3": {"fibres": {"ratio": 3.0}},
    "weight, standing": {"gravity": True},
    "tilted by 3 degrees": {"paddle": {"tilt": {"angle_deg": 3.0}}},
    "friction 0.2": {"friction": 0.2},
    "friction 0.5": {"friction": 0.5},
}


def compressed(breast: mammosim.BreastPhantom, elements: float, **keys: Any) -> CompressedBreast:
    """A compression; one that did not converge is reported and used."""
    try:
        return mammosim.compress(
            breast, "CC", model="hyperelastic", plate_edge_mm=15.0, resolution_mm=elements, **keys
        )
    except mammosim.NotConverged as stop:
        print(f"    {stop}")
        return stop.reached


def rows_of(seed: int, elements: float, known: set[str]) -> Iterator[dict[str, str]]:
    """One row per change of one breast, but for those that are known."""
    density, volume_ml = BREASTS[seed - 1]
    breast_name = f"{density}, {volume_ml:g} mL"
    left = {name: keys for name, keys in CHANGES.items() if f"{breast_name}: {name}" not in known}
    if not left:
        return
    breast = mammosim.generate_phantom(
        density=density, volume_ml=volume_ml, voxel_mm=1.5, seed=seed, laterality="L"
    )
    inside = np.argwhere(breast.labels[::3, ::3, ::3] > 0) * 3
    points = breast.origin_mm + inside * breast.voxel_mm
    usual = compressed(breast, elements)
    for name, keys in left.items():
        found = compressed(breast, elements, **keys) if keys else usual
        away = found.displacement_at(points) - usual.displacement_at(points)
        distance = np.linalg.norm(away, axis=1)
        nipple = found.displacement_at(breast.nipple_mm[None])[0, 0]
        yield {
            "breast": breast_name, "change": name, "thickness_mm": f"{found.thickness_mm:.1f}",
            "force_n": f"{found.force_n:.1f}",
            "area_cm2": f"{found.measures['contact_area_mm2'] / 100:.0f}",
            "nipple_mm": f"{nipple:.1f}", "mean_mm": f"{distance.mean():.2f}",
            "p95_mm": f"{np.percentile(distance, 95):.2f}",
        }  # fmt: skip


PANELS = {
    "force_n": "force on the paddle, N",
    "nipple_mm": "nipple moves forward, mm",
    "mean_mm": "mean distance of tissue from\nits place with the defaults, mm",
}
"""Columns that the picture shows, with their labels."""


def draw(rows: list[dict[str, str]], path: Path) -> None:
    """Bars of each change, breasts side by side."""
    figure = Figure(figsize=(10.0, 4.6), layout="constrained")
    breasts = list(dict.fromkeys(row["breast"] for row in rows))
    place = {name: -float(number) for number, name in enumerate(CHANGES)}
    thick = 0.8 / len(breasts)
    for axis, (key, label) in zip(
        figure.subplots(1, len(PANELS), sharey=True), PANELS.items(), strict=True
    ):
        for number, breast in enumerate(breasts):
            own = [row for row in rows if row["breast"] == breast]
            y = [place[row["change"]] - (number - 0.5 * (len(breasts) - 1)) * thick for row in own]
            axis.barh(y, [float(row[key]) for row in own], thick, label=breast)
        axis.set_xlabel(label)
        axis.set_yticks(list(place.values()), list(place))
        axis.grid(axis="x", alpha=0.2)
    figure.axes[-1].legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=100)


def main() -> None:
    """Compress what has no row yet, print the table, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--elements", type=float, default=5.0)
    parser.add_argument("--breasts", type=int, nargs="+", choices=(1, 2, 3), default=[1, 2, 3])
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    rows: list[dict[str, str]] = []
    if given.results.exists():
        with given.results.open(newline="") as file:
            rows = list(csv.DictReader(file))
    known = {f"{row['breast']}: {row['change']}" for row in rows}
    for seed in given.breasts:
        for row in rows_of(seed, given.elements, known):
            new = not given.results.exists()
            with given.results.open("a", newline="") as file:
                writer = csv.DictWriter(file, list(row))
                if new:
                    writer.writeheader()
                writer.writerow(row)
            rows.append(row)
            print(" | ".join(row.values()), flush=True)
    if given.picture:
        draw(rows, given.picture)


if __name__ == "__main__":
    main()
