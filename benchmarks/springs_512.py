"""The thesis' dream size: a 512 x 512 x 512 phantom of 41 million tissue nodes, 50 % compression.

    python benchmarks/springs_512.py [--voxels 512]

The phantom passes through `mammosim.compress` as a user's would, with a lattice node a voxel, and
is converged to 0.01 voxel. Prints what each size of lattice takes, the result, and peak memory.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from mammosim.compression import compress
from mammosim.phantom import BreastPhantom

EXTENT_MM = 128.0
THICKNESS_MM = 64.0


def half_ellipsoid(voxels: int) -> BreastPhantom:
    """Fat with an ellipsoid of gland, across the cube along y and z and 0.59 of it along x."""
    depth, middle = 300 / 512 * voxels, (voxels - 1) / 2
    y, z = (index - middle for index in np.ogrid[:voxels, :voxels])
    labels = np.zeros((voxels, voxels, voxels), np.uint8)
    for i in range(int(depth) + 1):
        outer = (i / depth) ** 2 + (y**2 + z**2) / (voxels / 2) ** 2
        gland = (i / voxels - 0.1) ** 2 / 0.35**2
        gland = gland + (y / voxels / 0.3) ** 2 + (z / voxels / 0.27) ** 2
        labels[i] = (outer <= 1.0).astype(np.uint8) + ((outer <= 1.0) & (gland <= 1.0))
    voxel = EXTENT_MM / voxels
    return BreastPhantom(
        labels=labels,
        voxel_mm=np.full(3, voxel),
        origin_mm=np.array([voxel / 2, -middle * voxel, -middle * voxel]),
        laterality="L",
        tissue_of_label={0: "air", 1: "adipose", 2: "gland"},
        nipple_mm=np.array([depth * voxel, 0.0, 0.0]),
        source="half-ellipsoid",
    )


def main() -> None:
    """Compress the phantom and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--voxels", type=int, default=512, help="along each edge of the cube")
    voxels = parser.parse_args().voxels
    compress(
        half_ellipsoid(48),
        "CC",
        model="springs",
        thickness_mm=THICKNESS_MM,
        resolution_mm=EXTENT_MM / 48,
    )
    breast = half_ellipsoid(voxels)
    start = time.perf_counter()

    def print_row(row: np.void) -> None:
        print(f"{time.perf_counter() - start:7.1f} s  {row['nodes']:>9} nodes, axis {row['axis']}: "
              f"{row['error_estimate_voxel']:.4f} voxel, {row['nodes_held']} held")  # fmt: skip

    compressed = compress(
        breast, "CC", model="springs", watch=print_row, thickness_mm=THICKNESS_MM,
        resolution_mm=EXTENT_MM / voxels, tolerance_voxel=0.01, plate_edge_mm=10.0,
    )  # fmt: skip
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    nodes = int(compressed.history["nodes"].max())
    print(f"{nodes} tissue nodes, converged {compressed.converged}: {seconds:.1f} s, "
          f"peak {peak / 1e9:.2f} GB, {peak / nodes:.0f} bytes a node")  # fmt: skip
    for name, value in compressed.measures.items():
        print(f"{name}: {value:.6g}")


if __name__ == "__main__":
    main()
