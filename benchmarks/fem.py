"""The hyperelastic model beside finite-element fields of a half-ellipsoid with a stiff inclusion.

    python benchmarks/fem.py REFERENCES [--elements 8 5 4 2.5 2]

REFERENCES is the folder with `R1_slide50_grid5mm.npz` (dolfinx, Q1 displacement, P0 pressure,
25 895 nodes, 50 %, sliding wall) and `R2_fixed20_grid5mm.npz` (20 %, fixed wall). Prints for each
element size the error on the grid points, the displacement and stretch of the inclusion, the bulge,
the volume and the time, and the observed order between sizes.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import mammosim

HALF_MM = np.array([60.0, 60.0, 65.0])
"""Semi-axes: depth from the chest wall, lateral, along the compression."""

CENTRE_MM, RADIUS_MM = np.array([25.0, 15.0, 20.0]), 10.0
"""Of the inclusion, in the same order."""

CASES = {
    "R1_slide50": {"chest_wall": "sliding", "thickness_mm": 65.0, "plate_edge_mm": -1e4},
    "R2_fixed20": {"chest_wall": "fixed", "thickness_mm": 104.0, "plate_edge_mm": 15.0},
}


def half_ellipsoid(voxel_mm: float) -> mammosim.BreastPhantom:
    """The references' body: fat (4.5 kPa) with a sphere of the thesis' abnormality (45 kPa)."""
    counts = np.ceil(HALF_MM * (1, 2, 2) / voxel_mm).astype(int)
    start = np.array([0.0, HALF_MM[1], HALF_MM[2]])
    axes = [(np.arange(n) + 0.5) * voxel_mm - s for n, s in zip(counts, start, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
    labels = sum((a / h) ** 2 for a, h in zip((x, y, z), HALF_MM, strict=True)) <= 1.0
    labels = labels.astype(np.uint8)
    ball = sum((a - c) ** 2 for a, c in zip((x, y, z), CENTRE_MM, strict=True)) <= RADIUS_MM**2
    labels[ball] = 200
    tissues = {0: "air", 1: "adipose", 200: "mass"}
    nipple = np.array([HALF_MM[0], 0.0, 0.0])
    return mammosim.BreastPhantom(
        labels, np.full(3, voxel_mm), 0.5 * voxel_mm - start, "L", tissues, nipple
    )


def compare(case: str, folder: Path, sizes: list[float], breast: mammosim.BreastPhantom) -> None:
    """Print the errors of one case."""
    reference = np.load(folder / f"{case}_grid5mm.npz")
    points, expected = (reference[key][:, [1, 0, 2]] for key in ("points", "u"))
    ball = ((points - CENTRE_MM) ** 2).sum(axis=1) < (0.9 * RADIUS_MM) ** 2
    print(f"{case}: {len(points)} points, mean displacement {_mean(expected):.2f} mm")
    before = None
    for size in sizes:
        start = time.process_time()
        compressed = mammosim.compress(
            breast, "CC", model="hyperelastic", resolution_mm=size, **CASES[case]
        )
        seconds = time.process_time() - start
        moved = compressed.displacement_at(points)
        error = np.linalg.norm(moved - expected, axis=1)
        order = np.log(before[1] / error.mean()) / np.log(before[0] / size) if before else np.nan
        before = size, error.mean()
        poles = CENTRE_MM + 0.9 * RADIUS_MM * np.array([[0, 0, 1], [0, 0, -1]])
        ends = poles + compressed.displacement_at(poles)
        bulge = compressed.displacement_at([[0.0, 59.0, 0.0], [59.0, 0.0, 0.0]])
        print(
            f"{size:5.2f} mm  error mean {error.mean():.3f}  95 % {np.percentile(error, 95):.3f}  "
            f"largest {error.max():.3f} mm  order {order:5.2f}  inclusion moves "
            f"{np.round(moved[ball].mean(axis=0), 2)} (reference "
            f"{np.round(expected[ball].mean(axis=0), 2)}), stretch "
            f"{(ends[0] - ends[1])[2] / (1.8 * RADIUS_MM):.3f}  bulge {bulge[0, 1]:.2f}, "
            f"{bulge[1, 0]:.2f} mm  volume {compressed.measures['volume_ratio']:.4f}  smallest J "
            f"{compressed.measures['smallest_j']:.2f}  force {compressed.force_n:.2f} N  "
            f"{compressed.history.size} steps  {seconds:.1f} CPU s",
            flush=True,
        )


def _mean(vectors: np.ndarray) -> float:
    return float(np.linalg.norm(vectors, axis=1).mean())


def main() -> None:
    """Run all cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("references", type=Path)
    parser.add_argument("--elements", type=float, nargs="+", default=[8.0, 5.0, 4.0, 2.5, 2.0])
    parser.add_argument("--voxel-mm", type=float, default=0.5)
    arguments = parser.parse_args()
    breast = half_ellipsoid(arguments.voxel_mm)
    mammosim.compress(  # compiles
        breast, "CC", model="hyperelastic", resolution_mm=10.0, **CASES["R1_slide50"]
    )
    for case in CASES:
        compare(case, arguments.references, arguments.elements, breast)


if __name__ == "__main__":
    main()
