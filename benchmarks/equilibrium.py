"""Whether the hyperelastic model finds its equilibrium: how often, how exactly, and how fast.

    python benchmarks/equilibrium.py robustness [--share 1/7] [--elements 5] [--chest-wall fixed]
        [--results CASES.csv]
    python benchmarks/equilibrium.py convergence [--breasts 3] [--elements 3]
    python benchmarks/equilibrium.py same-answer [--breasts 3] [--elements 4]
    python benchmarks/equilibrium.py phantom PHANTOM.mhd [--elements 4 2 1]

`robustness` compresses 48 generated breasts (four densities, 150 to 1400 mL) in CC and MLO, with
the plates' edge 5 and 15 mm in front of the chest wall, by 30 to 60 % of their height: 192 cases,
of which `--share 1/7` takes every seventh. With `--results`, each case is a row of that file, and
cases that have a row are not run again. `convergence` compares the default tolerance with 0.0002
mm between the same plates. `same-answer` compares ways to the same plates. `phantom` times FDA's,
as VICTRE compresses it.
"""

from __future__ import annotations

import argparse
import csv
import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim._jit import one_blas_thread
from mammosim.compression import CompressedBreast
from mammosim.compression.hyperelastic import Stages
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic_model import body_between_plates
from mammosim.compression.settings import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held

DENSITIES = ("fatty", "scattered", "heterogeneous", "dense")

EDGES_MM = (5.0, 15.0)

COMPRESSION = (0.30, 0.60)
"""Least and most, parts of the height between the plates."""

DEFAULTS = {"model": "hyperelastic", "stiffness": "aspiration"}

VICTRE = {
    "model": "hyperelastic", "stiffness": "victre", "chest_wall": "fixed", "muscle": "fixed",
    "support_z_mm": -25.4, "paddle_z_mm": 24.4, "plate_edge_mm": 7.4,
}  # fmt: skip
"""Where VICTRE's FEBio run put the plates: 49.8 mm apart, 44 % compression."""


class Case(NamedTuple):
    """One compression."""

    density: str
    volume_ml: float
    seed: int
    view: str
    edge_mm: float
    part: float

    @property
    def name(self) -> str:
        """In a row of the results."""
        breast = f"{self.density} {self.volume_ml:.0f} mL, seed {self.seed}"
        return f"{breast} {self.view} edge {self.edge_mm:g} mm {100 * self.part:.0f} %"


MEASURES = ("force_n", "front_force_n", "pressure_kpa", "smallest_j", "error_mm")
"""Of a compression, in the results."""


def cases() -> list[Case]:
    """The 192 cases: 48 breasts, two views, two edges."""
    found = []
    volumes = np.geomspace(150.0, 1400.0, 12)
    for breast in range(48):
        density, volume = DENSITIES[breast % 4], float(volumes[breast // 4])
        for turn, (view, edge) in enumerate((v, e) for v in ("CC", "MLO") for e in EDGES_MM):
            step = (5 * breast + 3 * turn) % 11 / 10.0
            part = COMPRESSION[0] + step * (COMPRESSION[1] - COMPRESSION[0])
            found.append(Case(density, volume, breast + 1, view, edge, part))
    return found


def height_mm(breast: BreastPhantom, view: View, edge_mm: float) -> float:
    """Height of the tissue in front of an edge, mm."""
    held = as_held(breast, view.rotation[1])
    places = held.origin_mm + np.argwhere(held.labels[::2, ::2, ::2]) * 2 * held.voxel_mm
    z = (places[places[:, 0] > edge_mm] @ view.rotation.T)[:, 2]
    return float(np.ptp(z) + 2.0 * held.voxel_mm[0])


def attempt(
    breast: BreastPhantom, view: str, **settings: Any
) -> tuple[CompressedBreast, str, float]:
    """A compression, why it failed (empty if it did not), and its CPU seconds."""
    start, why = time.process_time(), ""
    try:
        found = mammosim.compress(breast, view, **settings)
    except mammosim.NotConverged as stop:
        found, why = stop.reached, str(stop)
    return found, why, time.process_time() - start


def robustness(
    share: tuple[int, int], elements: float, results: Path | None, **settings: Any
) -> None:
    """Which cases converge."""
    rows = _rows(results)
    known = {row["case"] for row in rows}
    for case in cases()[share[0] - 1 :: share[1]]:
        if case.name in known:
            continue
        row = _attempted(case, elements, settings)
        rows.append(row)
        if results is not None:
            _append(results, row)
        print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    lost = [row for row in rows if row["why"]]
    cpu = [float(row["cpu_s"]) for row in rows]
    print(f"{len(rows) - len(lost)} of {len(rows)} converged; CPU s median {np.median(cpu):.1f}, "
          f"largest {max(cpu):.1f}")  # fmt: skip
    for row in lost:
        print(f"{row['case']}: {row['why']}")


def _attempted(case: Case, elements: float, settings: dict[str, Any]) -> dict[str, str]:
    """One case, as a row of the results."""
    breast = _generated(case.density, case.volume_ml, case.seed)
    view = View(case.view, breast.laterality, 45.0)
    gap = (1.0 - case.part) * height_mm(breast, view, case.edge_mm)
    found, why, cpu = attempt(
        breast, case.view, thickness_mm=gap, plate_edge_mm=case.edge_mm,
        resolution_mm=elements, **{**DEFAULTS, **settings},
    )  # fmt: skip
    measures = {key: f"{found.measures[key]:.4g}" for key in MEASURES}
    steps = str(found.history.size)
    return {"case": case.name, **measures, "steps": steps, "cpu_s": f"{cpu:.1f}", "why": why}


@lru_cache(maxsize=1)
def _generated(density: str, volume_ml: float, seed: int) -> BreastPhantom:
    return mammosim.generate_phantom(
        density=density, volume_ml=volume_ml, voxel_mm=1.0, seed=seed, laterality="L"
    )


def _rows(results: Path | None) -> list[dict[str, str]]:
    if results is None or not results.exists():
        return []
    with results.open(newline="") as file:
        return list(csv.DictReader(file))


def _append(results: Path, row: dict[str, str]) -> None:
    new = not results.exists()
    with results.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row))
        if new:
            writer.writeheader()
        writer.writerow(row)


def tissue_points(breast: BreastPhantom, spacing_mm: float = 2.0) -> NDArray[np.float64]:
    """(n, 3) points inside the tissue, mm."""
    step = np.maximum(np.rint(spacing_mm / breast.voxel_mm).astype(int), 1)
    inside = np.argwhere(breast.labels[tuple(slice(None, None, s) for s in step)]) * step
    return breast.origin_mm + inside * breast.voxel_mm


def apart(one: CompressedBreast, other: CompressedBreast) -> str:
    """How far two displacement fields are apart."""
    points = tissue_points(one.phantom)
    distance = np.linalg.norm(one.displacement_at(points) - other.displacement_at(points), axis=1)
    return f"mean {distance.mean():.4f}, 95 % {np.percentile(distance, 95):.4f}, largest " + (
        f"{distance.max():.3f} mm"
    )


def convergence(breasts: int, elements: float) -> None:
    """The default tolerance beside 0.0002 mm: the quickstart's breast first, then others."""
    for number in range(breasts):
        volume = 550.0 if number == 0 else float(np.geomspace(200.0, 1200.0, 10)[number - 1])
        density = DENSITIES[(number + 1) % 4]
        breast = mammosim.generate_phantom(
            density=density, volume_ml=volume, voxel_mm=0.4 if number == 0 else 0.8,
            seed=max(number, 1), laterality="L",
        )  # fmt: skip
        for view, edge in (("CC", 15.0), ("MLO", 5.0)):
            keys = {**DEFAULTS, "plate_edge_mm": edge, "resolution_mm": elements}
            usual, why, cpu = attempt(breast, view, **keys)
            m, plates = usual.measures, {
                "support_z_mm": usual.support_z_mm, "paddle_z_mm": usual.paddle_z_mm,
            }  # fmt: skip
            exact, also, _ = attempt(breast, view, tolerance_mm=0.0002, **keys, **plates)
            print(
                f"{density:13s} {volume:5.0f} mL {view}: {apart(usual, exact)}; estimated "
                f"{m['error_mm']:.4f}, {m['largest_error_mm']:.3f}, height "
                f"{m['height_error_mm']:.3f} mm; "
                f"{cpu:.1f} CPU s {why} {also}",
                flush=True,
            )


def same_answer(breasts: int, elements: float) -> None:
    """From rest; from half the closing steps; from the neighbouring thickness.

    The quickstart's breast first, then others. With `half` the search of the plates' height is
    repeated, too; the others compare equilibria between the same plates.
    """
    for number in range(breasts):
        volume = 550.0 if number == 0 else float(np.geomspace(200.0, 1200.0, 10)[number - 1])
        density = DENSITIES[(number + 1) % 4]
        breast = mammosim.generate_phantom(
            density=density, volume_ml=volume, voxel_mm=0.8, seed=max(number, 1), laterality="L"
        )
        for name, edge in (("CC", 15.0), ("MLO", 5.0)):
            keys = {**DEFAULTS, "plate_edge_mm": edge, "resolution_mm": elements}
            usual, why, _ = attempt(breast, name, **keys)
            print(f"{density} {volume:.0f} mL {name} {why}")
            print(f"    half the closing steps: {_from_half(breast, name, usual, keys)}")
            for way, found in _from_elsewhere(usual, keys).items():
                print(f"    {way}: {found}", flush=True)


def _from_half(
    breast: BreastPhantom, name: str, usual: CompressedBreast, keys: dict[str, Any]
) -> str:
    from mammosim.compression.hyperelastic import stages as module

    increment = module.INCREMENT
    module.INCREMENT = 0.5 * increment
    slow, _, _ = attempt(breast, name, **keys)
    module.INCREMENT = increment
    energies = " and ".join(f"{one.history['energy_mj'][-1]:.3f}" for one in (usual, slow))
    return f"{apart(usual, slow)}; {energies} mJ"


@one_blas_thread
def _from_elsewhere(usual: CompressedBreast, keys: dict[str, Any]) -> dict[str, str]:
    """Between the plates of a compression, from rest and from gaps 3 mm wider and narrower."""
    settings = CompressionSettings(**keys)
    between = body_between_plates(usual.phantom, usual.view, settings)
    stages = Stages(between.mesh, between.plates.edge_mm, settings.tolerance_mm)
    plates = between.plates.at_height(0.5 * (usual.support_z_mm + usual.paddle_z_mm))
    found = {"from rest": _beside(usual, stages, stages.compress(plates))}
    for way, change in (("from a gap 3 mm wider", 3.0), ("from a gap 3 mm narrower", -3.0)):
        other = plates.at_height(plates.centre_mm, plates.thickness_mm + change)
        found[way] = _beside(usual, stages, stages.settle(plates, stages.compress(other)))
    return found


def _beside(usual: CompressedBreast, stages: Stages, state: State) -> str:
    """Distance of a state from a compression, and both energies."""
    nodes, edge = stages.mesh.body.nodes, float(stages.mesh.nodes.spacing_mm[0])
    moved = edge * np.moveaxis(state.u, 0, -1)[nodes] @ usual.view.rotation
    places = (stages.mesh.nodes.origin_mm + edge * np.argwhere(nodes)) @ usual.view.rotation
    distance = np.linalg.norm(moved - usual.displacement_at(places), axis=1)
    energies = f"{usual.history['energy_mj'][-1]:.3f} and {stages.rows[-1]['energy_mj']:.3f} mJ"
    return f"mean {distance.mean():.4f}, largest {distance.max():.3f} mm; {energies}"


def phantom(path: str, elements: list[float]) -> None:
    """FDA's phantom by VICTRE's reduced model: no sheet of skin, wall and muscle fixed."""
    breast = mammosim.read_phantom(path, labels="victre")
    attempt(breast, "CC", resolution_mm=8.0, **VICTRE)  # loads the compiled code
    sizes = []
    for size in elements:
        found, why, cpu = attempt(breast, "CC", resolution_mm=size, **VICTRE)
        nodes = int(found.field.tissue.sum())
        sizes.append((nodes, cpu))
        m = found.measures
        print(
            f"{size:g} mm: {nodes} nodes, {found.history.size} steps, {cpu:.1f} CPU s, "
            f"{m['force_n']:.1f} N, estimated error {m['error_mm']:.4f} mm, {why}",
            flush=True,
        )
    if len(sizes) > 1:
        nodes_of, cpu_of = np.log(np.array(sizes)).T
        print(f"exponent of growth with nodes: {np.polyfit(nodes_of, cpu_of, 1)[0]:.2f}")


def _share(text: str) -> tuple[int, int]:
    first, total = text.split("/")
    return int(first), int(total)


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("robustness", "convergence", "same-answer", "phantom"))
    parser.add_argument("phantom", nargs="?", help="FDA's phantom, p_1.mhd")
    parser.add_argument("--share", type=_share, default=(1, 1))
    parser.add_argument("--elements", type=float, nargs="+", default=[])
    parser.add_argument("--chest-wall", default=None)
    parser.add_argument("--stiffness", default="aspiration")
    parser.add_argument("--breasts", type=int, default=3)
    parser.add_argument("--results", type=Path)
    arguments = parser.parse_args()
    elements = arguments.elements
    if arguments.what == "robustness":
        keys = {"chest_wall": arguments.chest_wall, "stiffness": arguments.stiffness}
        robustness(arguments.share, *(elements or [5.0]), arguments.results, **keys)
    elif arguments.what == "convergence":
        convergence(arguments.breasts, *(elements or [3.0]))
    elif arguments.what == "same-answer":
        same_answer(arguments.breasts, *(elements or [4.0]))
    else:
        phantom(arguments.phantom, elements or [4.0, 2.0, 1.0])


if __name__ == "__main__":
    main()
