"""Force, pressure, contact area and outline of generated breasts beside what is measured in women.

    python benchmarks/people.py RESULTS.csv [--breasts 40] [--elements 6] [--voxel-mm 1.5]
    python benchmarks/people.py RESULTS.csv --breasts 3 --elements 3
    python benchmarks/people.py RESULTS.csv --summary

Compresses generated breasts (four density classes, 200 to 1200 mL) in CC and MLO by the model
`hyperelastic` to the thickness of the population fit, with the plates' edge 15 (CC) and 10 mm (MLO)
in front of the chest wall. One line per breast, view and size of element is written as soon as it
is known; a second start computes only what is missing. `--fibres 3` changes the ratio of fibres,
`--set krouskop` the moduli; both are columns of the file. `--summary` prints medians and 5 to 95 %
of each combination, and how far other elements come from those of 6 mm on the same breasts.

Published values are named in docs/explanation/validation.md. Forces are those on the paddle; they
are to be held against the share of the clinical force that bears on the breast itself, because
plates that begin in front of the wall miss the tissue that bears the rest. "Front" leaves out what
lies within 20 mm of the plates' edge.

`log_width_over_depth` is that of Tanner et al. 2010 (Digital Mammography, Lect Notes Comput Sci
6136): the logarithm of width over depth of an ellipse fitted to the front of the outline. They
found 0.48 on real mammograms, 0.27 with isotropic and 0.47 with transversely isotropic simulation.
`depth_mm` is the distance from the plates' edge to the foremost tissue, `length_mm` the extent of
the tissue between the plates along their edge.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.tissues import SKIN_SHEETS

DENSITIES = ("fatty", "scattered", "heterogeneous", "dense")

VIEWS = (("CC", 15.0), ("MLO", 10.0))

MEASURES = (
    "force_n", "front_force_n", "pressure_kpa", "front_pressure_kpa", "contact_area_mm2",
    "volume_before_ml", "volume_change_percent", "smallest_j",
)  # fmt: skip

SHOWN = (
    "thickness_mm", "force_n", "front_force_n", "front_share", "pressure_kpa",
    "front_pressure_kpa", "contact_area_mm2", "depth_mm", "length_mm", "depth_over_length",
    "log_width_over_depth", "volume_change_percent", "cpu_s",
)  # fmt: skip

CASE = ("breast", "view", "elements_mm", "stiffness", "fibres")

FRONT = 0.5
"""Part of the breast's depth, from the nipple back, whose outline is fitted."""

USUAL_ELEMENTS_MM = 6.0

Row = dict[str, str | float]


def generated(number: int, voxel_mm: float) -> BreastPhantom:
    """One of the breasts: every density, 200 to 1200 mL."""
    return mammosim.generate_phantom(
        density=DENSITIES[number % 4], volume_ml=float(200.0 * 6.0 ** ((7 * number % 40) / 39.0)),
        voxel_mm=voxel_mm, seed=number + 1, laterality="L",
    )  # fmt: skip


def compressed_places(compressed: CompressedBreast) -> NDArray[np.float64]:
    """(n, 3) places of tissue voxels after compression, compression frame, mm."""
    phantom = compressed.phantom
    inside = np.argwhere(phantom.labels)
    points = phantom.origin_mm + inside * phantom.voxel_mm
    return (points + compressed.displacement_at(points)) @ compressed.view.rotation.T


def outline(compressed: CompressedBreast) -> Row:
    """Depth and length between the plates, and the ellipse fitted to the front half.

    The ellipse's centre lies where the front half begins; its half-axes follow by least squares
    from ``(x / a)^2 + (y / b)^2 = 1``.
    """
    seen = compressed_places(compressed)
    front = seen[:, 0].max()
    depth = front - compressed.plate_edge_mm
    between = seen[seen[:, 0] > compressed.plate_edge_mm]
    length = float(np.ptp(between[:, 1]))
    start = front - FRONT * depth
    edges = np.arange(start, front, 2.0)
    layers = [seen[(seen[:, 0] >= x) & (seen[:, 0] < x + 2.0), 1] for x in edges]
    half_widths = np.array([0.5 * np.ptp(y) if len(y) > 3 else 0.0 for y in layers])
    ahead = edges + 1.0 - start
    known = half_widths > 0.0
    terms = np.stack([ahead[known] ** 2, half_widths[known] ** 2], axis=1)
    inverse = np.linalg.lstsq(terms, np.ones(len(terms)), rcond=None)[0]
    return {
        "depth_mm": depth,
        "length_mm": length,
        "depth_over_length": depth / length,
        "log_width_over_depth": float(0.5 * np.log(inverse[0] / inverse[1])),
    }


def measured(phantom: BreastPhantom, case: Row, edge_mm: float) -> Row:
    """One line of the table."""
    start = time.process_time()
    converged = 1.0
    try:
        found = mammosim.compress(
            phantom, str(case["view"]), model="hyperelastic", plate_edge_mm=edge_mm,  # type: ignore[arg-type]
            resolution_mm=float(case["elements_mm"]), stiffness=str(case["stiffness"]),
            fibres={"ratio": float(case["fibres"])},
        )  # fmt: skip
    except mammosim.NotConverged as stop:
        print(f"    {stop}")
        found, converged = stop.reached, 0.0
    row: Row = {**case, "converged": converged, "thickness_mm": found.thickness_mm}
    row.update({key: float(found.measures[key]) for key in MEASURES})
    row["front_share"] = float(row["front_force_n"]) / float(row["force_n"])
    row["cpu_s"] = time.process_time() - start
    return {**row, **outline(found)}


def key_of(row: Row) -> tuple[str, ...]:
    """What tells the lines of the file apart."""
    numbers = {"breast", "elements_mm", "fibres"}
    return tuple(f"{float(row[k]):g}" if k in numbers else str(row[k]) for k in CASE)


def read(path: Path) -> list[Row]:
    """Lines of an earlier start."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [dict(row) for row in csv.DictReader(file)]


def add(path: Path, row: Row) -> None:
    """Append a line, after the header where the file is new."""
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if new:
            writer.writeheader()
        writer.writerow({k: round(v, 5) if isinstance(v, float) else v for k, v in row.items()})


def compute(path: Path, numbers: range, voxel_mm: float, usual: Row) -> None:
    """Compress what is not yet in the file."""
    known = {key_of(row) for row in read(path)}
    for number in numbers:
        cases = [({"breast": float(number), "view": view, **usual}, edge) for view, edge in VIEWS]
        missing = [(case, edge) for case, edge in cases if key_of(case) not in known]
        if not missing:
            continue
        phantom = generated(number, voxel_mm)
        for case, edge in missing:
            row = measured(phantom, case, edge)
            add(path, row)
            print(", ".join(f"{k} {row[k]:.3g}" if isinstance(row[k], float) else str(row[k])
                            for k in (*CASE, "force_n", "cpu_s")), flush=True)  # fmt: skip


def summarise(rows: list[Row]) -> None:
    """Medians and 5 to 95 % of each combination; other elements against the usual ones."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(key_of(row)[1:], []).append(row)
    for (view, elements, name, fibres), group in sorted(groups.items()):
        failed = sum(float(row["converged"]) == 0.0 for row in group)
        print(
            f"{view}, {elements} mm, {name}, fibres {fibres}: {len(group)} breasts, "
            f"{failed} did not converge"
        )
        for key in SHOWN:
            low, middle, high = np.percentile([float(row[key]) for row in group], [5, 50, 95])
            print(f"    {key}: {middle:.3g} ({low:.3g} to {high:.3g})")
        usual = {
            row["breast"]: row
            for row in groups.get((view, f"{USUAL_ELEMENTS_MM:g}", name, fibres), [])
        }
        pairs = [(row, usual[row["breast"]]) for row in group if row["breast"] in usual]
        if float(elements) != USUAL_ELEMENTS_MM and pairs:
            for key in SHOWN[:-1]:
                change = [float(coarse[key]) / float(row[key]) - 1.0 for row, coarse in pairs]
                print(f"    {key}, 6 mm over {elements} mm: "
                      + ", ".join(f"{100.0 * c:+.1f} %" for c in change))  # fmt: skip


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("--breasts", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--elements", type=float, default=USUAL_ELEMENTS_MM)
    parser.add_argument("--voxel-mm", type=float, default=1.5)
    parser.add_argument("--set", choices=list(SKIN_SHEETS), default="aspiration", dest="stiffness")
    parser.add_argument("--fibres", type=float, default=1.0)
    parser.add_argument("--summary", action="store_true")
    given = parser.parse_args()
    if not given.summary:
        usual: Row = {
            "elements_mm": given.elements,
            "stiffness": given.stiffness,
            "fibres": given.fibres,
        }
        numbers = range(given.first, given.first + given.breasts)
        compute(given.results, numbers, given.voxel_mm, usual)
    summarise(read(given.results))


if __name__ == "__main__":
    main()
