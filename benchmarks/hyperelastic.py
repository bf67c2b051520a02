"""The hyperelastic model on FDA's VICTRE phantom, as VICTRE compresses it, and on rough cases.

    python benchmarks/hyperelastic.py PHANTOM.mhd [--elements 4 2 1] [--robustness] [--invariance]

Prints seconds, steps, residual, force, volume, memory and the exponent of growth against element
size, and how far the displacements of two sizes are apart. --robustness compresses generated and
simple breasts in ways that stop other codes: to 35 % of their height, with inclusions of 100 kPa,
stiff thin skin, rough surfaces, plates' edges behind most of the breast, a nearly empty view.
--invariance shows what threads, increments and starting guess change.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable, Iterator
from itertools import combinations

import numba
import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim.compression import CompressedBreast
from mammosim.compression.hyperelastic import stages
from mammosim.phantom import BreastPhantom

VICTRE_PLATES = {"support_z_mm": -25.4, "paddle_z_mm": 24.4, "plate_edge_mm": 7.4}
"""Where VICTRE's FEBio run put them for this phantom: 49.8 mm apart, 44 % compression."""

VICTRE = {
    "model": "hyperelastic", "stiffness": "victre", "chest_wall": "fixed", "muscle": "fixed",
    **VICTRE_PLATES,
}  # fmt: skip

STONES_MM = (
    (30, 0, 0), (15, 30, 20), (20, -30, -15), (8, 0, 35), (40, 0, 25), (8, 40, 0), (45, 20, 0)
)  # fmt: skip

IN_FRONT_MM = 20.0
"""Displacements are compared in front of this x, away from the plates' edge, and everywhere."""


def timed_compression(breast: BreastPhantom, **settings: object) -> tuple[CompressedBreast, float]:
    """A compressed breast, converged or not, and the seconds that it took."""
    start, cpu = time.perf_counter(), time.process_time()
    try:
        compressed = mammosim.compress(breast, "CC", **settings)
    except mammosim.NotConverged as stop:
        print(f"    did not converge: {stop}")
        compressed = stop.reached
    print(f"    {time.process_time() - cpu:.1f} s of both processors")
    return compressed, time.perf_counter() - start


def grid(breast: BreastPhantom, spacing_mm: float = 2.0) -> NDArray[np.float64]:
    """(n, 3) points inside the tissue, mm."""
    step = np.maximum(np.rint(spacing_mm / breast.voxel_mm).astype(int), 1)
    inside = np.argwhere(breast.labels[tuple(slice(None, None, s) for s in step)]) * step
    return breast.origin_mm + inside * breast.voxel_mm


def apart(one: CompressedBreast, other: CompressedBreast, points: NDArray[np.float64]) -> str:
    """How far two displacement fields are apart."""
    distance = np.linalg.norm(one.displacement_at(points) - other.displacement_at(points), axis=1)
    front = distance[points[:, 0] > IN_FRONT_MM]
    return (
        f"mean {distance.mean():.3f}, 95 % {np.percentile(distance, 95):.3f}, largest "
        f"{distance.max():.2f} mm; in front of x = {IN_FRONT_MM:g} mm {front.mean():.3f}, "
        f"{np.percentile(front, 95):.3f}, {front.max():.2f} mm"
    )


def line(compressed: CompressedBreast, seconds: float) -> str:
    """One result in a line."""
    m, last = compressed.measures, compressed.history[-1]
    return (
        f"{seconds:6.1f} s, {compressed.history.size} steps, out of balance "
        f"{m['out_of_balance']:.3f}, error {m['error_mm']:.4f} mm, "
        f"gap {compressed.thickness_mm:.1f} mm, {m['force_n']:.1f} N, "
        f"volume {m['volume_ratio']:.4f}, "
        f"{m['inverted_cells']:.0f} folded of {m['cells']:.0f}, smallest J {m['smallest_j']:.3f}, "
        f"{last['element_mm']:g} mm"
    )


def sizes(breast: BreastPhantom, elements: list[float]) -> None:
    """FDA's phantom with elements of several sizes."""
    points, results, taken = grid(breast), [], []
    moved = None
    for size in elements:
        compressed, seconds = timed_compression(breast, resolution_mm=size, **VICTRE)
        nodes = int(compressed.field.tissue.sum())
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(f"{size:g} mm: {nodes} nodes, {line(compressed, seconds)}, peak {peak / 1e9:.2f} GB")
        results.append(compressed)
        taken.append((nodes, seconds))
        moved = np.linalg.norm(compressed.displacement_at(points), axis=1)
    if len(elements) > 1 and moved is not None:
        nodes, seconds = np.log(np.array(taken)).T
        print(f"exponent of growth with nodes: {np.polyfit(nodes, seconds, 1)[0]:.2f}")
        print(f"points moved {moved.mean():.2f} mm on average")
    for (a, one), (b, other) in combinations(zip(elements, results, strict=True), 2):
        print(f"{a:g} and {b:g} mm apart: {apart(one, other, points)}")


def invariance(breast: BreastPhantom, size: float = 4.0) -> None:
    """What must not change the answer, and what it changes."""
    points = grid(breast)
    base, _ = timed_compression(breast, resolution_mm=size, **VICTRE)
    numba.set_num_threads(1)
    single, _ = timed_compression(breast, resolution_mm=size, **VICTRE)
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    same = np.array_equal(base.field.displacement_mm, single.field.displacement_mm)
    print(f"one thread: {'the same bits' if same else apart(base, single, points)}")
    usual = stages.INCREMENT
    for part in (0.03, 0.12, 0.25):
        stages.INCREMENT = part
        other, _ = timed_compression(breast, resolution_mm=size, **VICTRE)
        print(f"increments of {part:g} for {usual:g}: {apart(base, other, points)}")
    stages.INCREMENT = usual
    for tolerance in (0.002, 0.0002):
        other, _ = timed_compression(breast, resolution_mm=size, tolerance_mm=tolerance, **VICTRE)
        print(f"tolerance {tolerance:g} for 0.02 mm: {apart(base, other, points)}")


def half_ellipsoid(voxel_mm: float, change: Callable[..., None] | None = None) -> BreastPhantom:
    """A breast of fat with a core of gland, 60 x 65 x 60 mm semi-axes; `change` relabels it."""
    n = np.ceil(np.array([62.0, 132.0, 122.0]) / voxel_mm).astype(int)
    places = np.ogrid[tuple(slice(count) for count in n)]
    middle = (-0.5, (n[1] - 1) / 2, (n[2] - 1) / 2)
    x, y, z = ((place - m) * voxel_mm for place, m in zip(places, middle, strict=True))
    radius = np.sqrt((x / 60) ** 2 + (y / 65) ** 2 + (z / 60) ** 2)
    labels = (radius <= 1.0).astype(np.uint8)
    labels[((x - 15) / 30) ** 2 + (y / 35) ** 2 + (z / 30) ** 2 <= 1.0] = 29
    if change is not None:
        change(labels, radius, x, y, z)
    tissues = {0: "air", 1: "adipose", 2: "skin", 29: "gland", 200: "mass"}
    start = np.array([0.5 * voxel_mm, -(n[1] - 1) / 2 * voxel_mm, -(n[2] - 1) / 2 * voxel_mm])
    return BreastPhantom(
        labels, np.full(3, voxel_mm), start, "L", tissues, np.array([60.0, 0.0, 0.0])
    )


def rough(labels: NDArray[np.uint8], radius: NDArray[np.float64], *_: object) -> None:
    """Half of the voxels of the outermost 2 mm are air."""
    shell = (radius > 1.0 - 2.0 / 60.0) & (labels > 0)
    labels[shell & (np.random.default_rng(1).random(labels.shape) < 0.5)] = 0


def skin(labels: NDArray[np.uint8], radius: NDArray[np.float64], *_: object) -> None:
    """A skin of 1.5 mm."""
    labels[(radius > 1.0 - 1.5 / 60.0) & (labels > 0)] = 2


def stones(labels: NDArray[np.uint8], radius: NDArray[np.float64], *axes: NDArray) -> None:
    """Seven stiff balls of 10 mm, some next to the plates and the wall."""
    for place in STONES_MM:
        near = sum((a - p) ** 2 for a, p in zip(axes, place, strict=True)) <= 25.0
        labels[near & (labels > 0)] = 200


def rough_cases() -> Iterator[tuple[str, BreastPhantom, dict[str, object]]]:
    """Name, breast and settings of each case."""
    plain = half_ellipsoid(1.0)
    settings = {"model": "hyperelastic", "stiffness": "victre", "plate_edge_mm": 10.0}
    for part in (0.5, 0.4, 0.35):
        yield f"{100 * (1 - part):.0f} %", plain, {**settings, "thickness_mm": 120 * part}
    yield "65 %, sliding wall", plain, {
        **settings, "chest_wall": "sliding", "thickness_mm": 42.0, "plate_edge_mm": 3.0,
    }  # fmt: skip
    yield "rough surface, 50 %", half_ellipsoid(1.0, rough), {**settings, "thickness_mm": 60.0}
    stiff = {**settings, "thickness_mm": 60.0}
    balls, thin = {"stiffness_kpa": {"mass": 100.0}}, {"stiffness_kpa": {"skin": 60.0}}
    yield "balls of 100 kPa, 50 %", half_ellipsoid(1.0, stones), {**stiff, **balls}
    yield "skin of 60 kPa, 50 %", half_ellipsoid(0.75, skin), {**stiff, **thin}
    yield "edge at 40 of 60 mm", plain, {**settings, "thickness_mm": 60.0, "plate_edge_mm": 40.0}
    yield "hardly touched", plain, {**settings, "thickness_mm": 119.0}


def robustness(size: float = 3.0) -> None:
    """Cases that stop other codes."""
    for name, breast, settings in rough_cases():
        compressed, seconds = timed_compression(breast, resolution_mm=size, **settings)
        print(f"{name}: {line(compressed, seconds)}")
        for note in compressed.notes:
            print(f"    {note}")


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("phantom", nargs="?", help="FDA's phantom, p_1.mhd")
    parser.add_argument("--elements", type=float, nargs="+", default=[4.0, 2.0, 1.0])
    parser.add_argument("--robustness", action="store_true")
    parser.add_argument("--invariance", action="store_true")
    arguments = parser.parse_args()
    if arguments.phantom:
        breast = mammosim.read_phantom(arguments.phantom, labels="victre")
        timed_compression(breast, resolution_mm=8.0, **VICTRE)  # loads the compiled code
        sizes(breast, arguments.elements)
        if arguments.invariance:
            invariance(breast)
    if arguments.robustness:
        robustness()


if __name__ == "__main__":
    main()
