"""Time and memory of the projection, beside other projectors where an interpreter has them.

    python benchmarks/projection.py undeformed PHANTOM.mhd [--peers PYTHON]
    python benchmarks/projection.py compressed PHANTOM.mhd [--peers PYTHON] [--pixel-mm 0.1]
    python benchmarks/projection.py large [--voxels 1000]

PHANTOM.mhd is FDA's VICTRE phantom. PYTHON is an interpreter with `itk-rtk`, `SimpleITK` and
`gecatsim` (any that is missing is passed over); it runs benchmarks/projection_peers.py on the very
same volume and geometry. Compilation is left out everywhere.

`undeformed`: 256 cubed voxels onto 512 x 512 pixels, one thread, CPU seconds.
`compressed`: the phantom at 50 mm, all its tissues; the peer warps the labels with SimpleITK and
projects once a tissue with RTK.
`large`: a made-up breast of a billion voxels and its smooth displacement; peak memory.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from mammosim import NotConverged, compress, project, read_phantom
from mammosim.compression import CompressedBreast, DisplacementField
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom
from mammosim.projection import PathLengths

THICKNESS_MM = 50.0
TURNS = 5


def main() -> None:
    """Run the benchmark named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("undeformed", "compressed", "large"))
    parser.add_argument("phantom", nargs="?")
    parser.add_argument("--peers", metavar="PYTHON")
    parser.add_argument("--pixel-mm", type=float, default=0.1)
    parser.add_argument("--view", default="CC")
    parser.add_argument("--voxels", type=int, default=1000)
    given = parser.parse_args()
    if given.what == "undeformed":
        undeformed(given.phantom, given.peers)
    elif given.what == "compressed":
        compressed(given.phantom, given.view, given.pixel_mm, given.peers)
    else:
        large(given.voxels, given.pixel_mm)


def timed(work: Callable[[], Any], turns: int = TURNS) -> tuple[Any, float, float]:
    """Result, and the least wall and CPU seconds of some turns."""
    walls, cpus = [], []
    for _ in range(turns):
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return result, min(walls), min(cpus)


def undeformed(path: str, peers: str | None) -> None:
    """256 cubed voxels onto 512 x 512 pixels on one thread."""
    numba.set_num_threads(1)
    fda = read_phantom(path, labels="victre")
    n, voxel_mm = 256, 0.4
    breast_like = np.zeros((n, n, n), np.uint8)
    every_other = fda.labels[::2, ::2, ::2][:n, :n, :n]
    low = [0, *((n - size) // 2 for size in every_other.shape[1:])]
    breast_like[tuple(slice(a, a + s) for a, s in zip(low, every_other.shape, strict=True))] = (
        every_other
    )
    for name, labels in (("breast", breast_like), ("filled with random lumps", lumps(n))):
        half = 0.5 * (n - 1) * voxel_mm
        origin = np.array([0.5 * voxel_mm, -half, -half])
        block = BreastPhantom(labels, np.full(3, voxel_mm), origin, "L", fda.tissue_of_label,
                              nipple_mm=np.zeros(3))  # fmt: skip
        left_alone = compress(block, "CC", model="none", support_z_mm=-half, paddle_z_mm=half)
        keys = {
            "pixel_mm": 0.25,
            "detector_mm": [128.0, 128.0],
            "detector_edge_mm": 0.0,
            "conserve_mass": False,
        }
        project(left_alone, **{**keys, "pixel_mm": 4.0})
        paths, _, cpu = timed(lambda: project(left_alone, **keys))  # noqa: B023
        print(f"undeformed, {name}: {len(paths.tissues)} channels in one pass, {cpu:.3f} CPU s")
        if peers:
            gland = gland_of(paths)
            job = {"what": "one", "volume": (labels == 29).astype(np.float32), "voxel_mm": voxel_mm}
            report(run_peers(peers, job, paths), gland)


def lumps(n: int) -> np.ndarray:
    """Labels of gland in fat, in lumps of some voxels, no air."""
    from scipy.ndimage import gaussian_filter

    rough = np.random.default_rng(1).standard_normal((n, n, n), dtype=np.float32)
    return np.where(gaussian_filter(rough, 4.0) > 0.0, 29, 1).astype(np.uint8)


def compressed(path: str, view: str, pixel_mm: float, peers: str | None) -> None:
    """FDA's phantom at 50 mm, all tissues."""
    breast = read_phantom(path, labels="victre")
    keys = {
        "model": "springs", "thickness_mm": THICKNESS_MM, "muscle": "fixed", "stiffness": "victre",
    }  # fmt: skip
    try:
        compressed = compress(breast, view, **keys)
    except NotConverged as stop:  # as good for timing: it is a few thousandths of a node off
        print(f"compressed: {stop}")
        compressed = stop.reached
    inverse = compressed.inverse
    project(compressed, pixel_mm=2.0)
    paths, wall, cpu = timed(lambda: project(compressed, pixel_mm=pixel_mm), 3)
    print(
        f"compressed, {view}, {paths.length_mm.shape} [channel, row, column] of {pixel_mm:g} mm: "
        f"{wall:.2f} s on {numba.get_num_threads()} threads, {cpu:.2f} CPU s"
    )
    if peers:
        channels = np.zeros(256, np.uint8)
        for label, tissue in breast.tissue_of_label.items():
            channels[label] = 1 + material_order(paths, tissue) if tissue != "air" else 0
        job = {
            "what": "warp", "volume": breast.labels, "voxel_mm": breast.voxel_mm,
            "origin_mm": breast.origin_mm, "rotation": compressed.view.rotation,
            "channels": channels, "inverse_origin_mm": inverse.frame.origin_mm,
            "inverse_spacing_mm": inverse.frame.spacing_mm, "original_mm": inverse.original_mm,
            "threads": numba.get_num_threads(),
        }  # fmt: skip
        report(run_peers(peers, job, paths), paths.length_mm.sum(axis=0))


def material_order(paths: PathLengths, tissue: str) -> int:
    """Channel of a tissue."""
    from mammosim.tissues import TISSUES

    material = TISSUES[tissue].material
    return paths.materials.index(material) if material in paths.materials else -1


def gland_of(paths: PathLengths) -> np.ndarray:
    """Path length of gland, mm."""
    return paths.length_mm[paths.materials.index("gland")]


def run_peers(python: str, job: dict[str, Any], paths: PathLengths) -> list[dict[str, Any]]:
    """Hand a job to the other interpreter; its rows, each with the picture it made."""
    gantry = paths.gantry
    geometry = {
        "detector_edge_mm": gantry.detector_edge_mm, "support_z_mm": gantry.support_z_mm,
        "focal_spot_mm": gantry.focal_spot_mm, "gap_mm": gantry.support_to_detector_mm,
        "pixel_mm": gantry.pixel_mm, "rows": gantry.rows, "columns": gantry.columns,
        "row_y_mm": gantry.detector_xy_mm(np.arange(gantry.rows), 0)[:, 1],
        "column_x_mm": gantry.detector_xy_mm(0, np.arange(gantry.columns))[:, 0],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "job.npz", **job, **geometry)
        script = Path(__file__).with_name("projection_peers.py")
        subprocess.run([python, str(script), folder], check=True)
        rows = json.loads((Path(folder) / "rows.json").read_text())
        for row in rows:
            row["picture"] = np.load(Path(folder) / row["picture"])
    return rows


def report(rows: list[dict[str, Any]], ours: np.ndarray) -> None:
    """Print the peers' times, and how their pictures differ from ours."""
    for row in rows:
        inside = ours > 0.0
        off = np.abs(row["picture"] - ours)[inside].mean() / ours[inside].mean()
        print(f"  {row['name']}: {row['wall']:.2f} s, {row['cpu']:.3f} CPU s; "
              f"mean difference to ours {100.0 * off:.1f} %")  # fmt: skip


def large(n: int, pixel_mm: float) -> None:
    """A half ball of n cubed voxels of 0.1 mm, compressed by a smooth displacement."""
    compressed = made_up(n)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    paths = project(compressed, pixel_mm=pixel_mm)
    seconds = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"large, {n}^3 voxels, {paths.length_mm.shape} [channel, row, column]: {seconds:.1f} s "
        f"with compilation, peak {after / 2**20:.2f} GiB ({before / 2**20:.2f} GiB before it)"
    )


def made_up(n: int) -> CompressedBreast:
    """A half ball of fat with gland and skin, made plane by plane, and its lattice of 1 mm."""
    voxel_mm = 0.1
    size_mm = n * voxel_mm
    at = (np.arange(n) + 0.5) * voxel_mm
    across = at - 0.5 * size_mm
    radius = 0.45 * size_mm
    labels = np.zeros((n, n, n), np.uint8)
    for x, plane in zip(at, labels, strict=True):
        r = np.sqrt((x / 1.8) ** 2 + across[:, None] ** 2 + across**2, dtype=np.float32)
        lobes = np.sin(x / 3.0) * np.sin(across / 4.0)[:, None] * np.sin(across / 2.5) > 0.1
        plane[r < radius] = 1
        plane[lobes & (r < 0.8 * radius)] = 29
        plane[(r >= radius - 1.5) & (r < radius)] = 2
    origin = np.array([0.5 * voxel_mm, across[0], across[0]])
    tissues = {0: "air", 1: "adipose", 2: "skin", 29: "gland"}
    breast = BreastPhantom(labels, np.full(3, voxel_mm), origin, "L", tissues, np.zeros(3))
    nodes = int(size_mm) + 3
    frame = VoxelFrame(np.array([-1.0, -0.5 * (nodes - 1), -0.5 * (nodes - 1)]), np.ones(3),
                       (nodes, nodes, nodes))  # fmt: skip
    rest = np.moveaxis(np.indices(frame.shape, dtype=np.float32), 0, -1) + frame.origin_mm
    moved = rest * [0.15, 0.15, -0.4] * np.minimum(rest[..., :1] / 20.0, 1.0).clip(0.0)
    distance = np.sqrt((rest[..., 0] / 1.8) ** 2 + rest[..., 1] ** 2 + rest[..., 2] ** 2)
    tissue = (distance < radius) & (rest[..., 0] >= 0.0)
    view = View("CC", "L")
    field = DisplacementField(frame, moved.astype(np.float32), tissue, view.rotation)
    half = 0.6 * radius
    return CompressedBreast(breast, view, "none", field, -half, half, 0.0, True,
                            {"force_n": 0.0}, np.zeros(0, [("iteration", "i4")]))  # fmt: skip


if __name__ == "__main__":
    main()
