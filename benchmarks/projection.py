"""Time the projection of a raw 8-bit phantom, squeezed by formula to a given thickness.

Usage: python benchmarks/projection.py PHANTOM.raw.gz NX NY NZ VOXEL_MM [PIXEL_MM] [VIEW]

The labels must be those of the tissue table, x fastest (VICTRE's layout). The breast is squeezed
to 50 mm along the plates' normal and widened across so that its volume is kept, which is not how
a breast deforms but costs a projection as much.
"""

from __future__ import annotations

import gzip
import resource
import sys
import time
from pathlib import Path

import numba
import numpy as np
from scipy.ndimage import binary_dilation

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from naive.projection import inverse_map, phantom, squeezed

from mammosim.geometry import View
from mammosim.projection import compressed_labels, project

THICKNESS_MM = 50.0


def breast_from(path: str, shape: tuple[int, int, int], voxel_mm: float):
    """The phantom, chest wall at x = 0, centred in y and z."""
    packed = Path(path).read_bytes()
    raw = gzip.decompress(packed) if path.endswith(".gz") else packed
    labels = np.frombuffer(raw, dtype=np.uint8).reshape(shape[::-1]).T
    origin = [0.5 * voxel_mm, *(-0.5 * voxel_mm * (np.array(shape[1:]) - 1))]
    return phantom(labels, voxel_mm, origin, laterality="R")


def squeeze(breast, view: str):
    """Squeeze to `THICKNESS_MM`, affinely, on a grid of 1 mm."""
    rotation = View(view, "R").rotation
    tissue = breast.frame.position_mm(np.argwhere(breast.labels)[::50]) @ rotation.T
    low, high = tissue.min(axis=0), tissue.max(axis=0)
    ratio = THICKNESS_MM / (high[2] - low[2])
    stretch = np.array([ratio**-0.5, ratio**-0.5, ratio])
    inverse = inverse_map(lambda p: p / stretch, low * stretch - 3, high * stretch + 3, 1.0)
    forget_air(breast, inverse, rotation)
    plates = (float(low[2] * ratio), float(high[2] * ratio))
    return squeezed(breast, inverse, view, plates_mm=plates, edge_mm=7.4)


def forget_air(breast, inverse, rotation) -> None:
    """Leave the map undefined further than two nodes from tissue, as a solver's map is."""
    voxel = np.rint(breast.frame.index(inverse.original_mm @ rotation)).astype(int)
    inside = ((voxel >= 0) & (voxel < breast.labels.shape)).all(axis=-1)
    tissue = np.zeros(inside.shape, dtype=bool)
    tissue[inside] = breast.labels[tuple(voxel[inside].T)] > 0
    inverse.original_mm[~binary_dilation(tissue, iterations=2)] = np.nan


def main() -> None:
    """Print seconds for each step, compilation left out."""
    path, *size = sys.argv[1:5]
    voxel_mm = float(sys.argv[5])
    pixel_mm = float(sys.argv[6]) if len(sys.argv) > 6 else 0.1
    view = sys.argv[7] if len(sys.argv) > 7 else "CC"
    compressed = squeeze(breast_from(path, tuple(map(int, size)), voxel_mm), view)
    project(compressed, pixel_mm=2.0)
    start = time.perf_counter()
    paths = project(compressed, pixel_mm=pixel_mm)
    seconds = time.perf_counter() - start
    voxel_volume = float(np.prod(compressed.phantom.voxel_mm))
    print(f"project   {seconds:6.2f} s on {numba.get_num_threads()} threads")
    print(f"          {len(paths.tissues)} channels of {paths.length_mm.shape[1:]} pixels")
    lit = np.count_nonzero(paths.length_mm.sum(axis=0))
    print(f"          {lit} rays in tissue, longest {paths.length_mm.sum(axis=0).max():.1f} mm")
    print(f"tissue    {np.count_nonzero(compressed.phantom.labels) * voxel_volume / 1000:.1f} mL")
    start = time.perf_counter()
    labels, _ = compressed_labels(compressed)
    print(f"warp      {time.perf_counter() - start:6.2f} s for {labels.size / 1e6:.1f} M voxels")
    print(f"peak      {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
