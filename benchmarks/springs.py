"""The thesis benchmark: both spring solvers on a half-ellipsoid of 480 116 nodes, in one process.

    python benchmarks/springs.py [--gap 65] [--sizes] [--quick]

Prints sweeps and seconds of the compiled relaxation to its own criterion and to a mean distance of
0.01 voxel from equilibrium, seconds of multigrid to an estimated largest error of 0.001 voxel,
their ratio, peak memory, and with --sizes the growth of multigrid's time with the number of nodes.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from mammosim.compression.springs import SpringProblem, relax, solve
from mammosim.compression.springs.measures import volume_measures


def half_ellipsoid(scale: float = 1.0, gap: float = 65.0, edge: float = 10.0) -> SpringProblem:
    """The thesis' half-ellipsoid, 60 x 130 x 120 nodes at scale 1, of fat, gland and inclusions.

    Gland is an ellipsoid of semi-axes 40 x 40 x 35 nodes, centred 5 nodes from the chest wall; the
    three inclusions are balls of radius 6 (the thesis' own phantom is not published).
    """
    counts = np.round(np.array([60, 130, 120]) * scale).astype(int)
    i, j, k = (index / scale for index in np.ogrid[tuple(slice(n) for n in counts)])
    y, z = (counts[1] - 1) / scale / 2, (counts[2] - 1) / scale / 2
    tip = (counts[0] - 1) / scale
    inside = (i / tip) ** 2 + ((j - y) / y) ** 2 + ((k - z) / z) ** 2 <= 1.0
    modulus = np.where(inside, np.float32(4.5), np.float32(0.0))
    gland = ((i - 5) / 40) ** 2 + ((j - y) / 40) ** 2 + ((k - z) / 35) ** 2 <= 1.0
    modulus[inside & gland] = 15.0
    for ball in ((30, 40, 60), (25, 80, 45), (20, 70, 80)):
        near = (i - ball[0]) ** 2 + (j - ball[1]) ** 2 + (k - ball[2]) ** 2 <= 36
        modulus[inside & near] = 45.0
    modulus = np.pad(modulus, 1)
    fixed = np.zeros(modulus.shape, bool)
    fixed[1] = modulus[1] > 0
    half, middle = 0.5 * gap * scale, 1 + z * scale
    return SpringProblem(modulus, fixed, middle - half, middle + half, 1 + edge * scale)


def distance(problem: SpringProblem, one, other) -> np.ndarray:
    """Distance of each tissue node between two displacements, lattice units."""
    gaps = (u - v for u, v in zip(one, other, strict=True))
    return np.sqrt(sum(gap**2 for gap in gaps))[problem.tissue]


def timed_multigrid(problem: SpringProblem, repeats: int):
    """Best and median seconds of several solutions."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        state = solve(problem, 1e-3)
        seconds.append(time.perf_counter() - start)
    return state, min(seconds), float(np.median(seconds))


def compare(gap: float, quick: bool) -> None:
    """Both solvers on the thesis' size."""
    problem = half_ellipsoid(gap=gap)
    nodes = int(problem.tissue.sum())
    solve(half_ellipsoid(0.5, gap), 1e-3)
    relax(half_ellipsoid(0.2, gap), max_sweeps=2)
    state, best, median = timed_multigrid(problem, 5)
    volume = volume_measures(problem, state, 1.0)
    tip = np.argwhere(problem.tissue)[:, 0].max() - 1
    nipple = state.displacement[0][tip][problem.tissue[tip]].mean()
    print(f"gap {gap:g}: {nodes} nodes")
    print(f"multigrid to 0.001 voxel: {best:.2f} s best, {median:.2f} s median of 5, converged "
          f"{state.converged}; nipple +{nipple:.1f}, volume {volume['volume_ratio']:.3f}, "
          f"{volume['inverted_cells']:.0f} inverted cells")  # fmt: skip
    exact = solve(problem, 1e-5, start=state).displacement
    left = distance(problem, state.displacement, exact)
    print(f"multigrid against its own solution to 1e-5: mean {left.mean():.1e}, largest "
          f"{left.max():.1e} voxel")  # fmt: skip
    if quick:
        return
    start = time.perf_counter()
    relaxed = relax(problem)
    seconds, sweeps = time.perf_counter() - start, relaxed.history.size
    gap_to = distance(problem, relaxed.displacement, exact)
    print(f"relaxation to its criterion: {sweeps} sweeps, {seconds:.1f} s, "
          f"{seconds / sweeps:.3f} s a sweep, estimated deviation {relaxed.error:.3f}, true "
          f"{gap_to.mean():.4f} mean, {gap_to.max():.3f} largest")  # fmt: skip
    print(f"ratio at the relaxation's criterion: {seconds / median:.0f}")
    limit = 1e-4
    while gap_to.mean() > 0.01 and limit > 1e-7:
        limit /= 2
        start = time.perf_counter()
        relaxed = relax(problem, limit, start=relaxed)
        seconds += time.perf_counter() - start
        sweeps += relaxed.history.size
        gap_to = distance(problem, relaxed.displacement, exact)
    print(f"relaxation to a mean distance of {gap_to.mean():.4f}: {sweeps} sweeps, {seconds:.1f} s")
    released = relax(problem.released(), start=state)
    back = distance(problem, released.displacement, [0.0, 0.0, 0.0])
    print(f"decompression by relaxation: {released.history.size} sweeps, {back.mean():.4f} mean "
          f"from rest, estimated {released.error:.4f}")  # fmt: skip
    released = solve(problem.released(), 1e-3, start=state)
    back = distance(problem, released.displacement, [0.0, 0.0, 0.0])
    print(f"decompression by multigrid: largest distance from rest {back.max():.1e}")


def sizes() -> None:
    """Seconds of multigrid against the number of nodes, and the exponent of its growth."""
    found = []
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    for scale in (0.25, 0.5, 1.0, 1.6, 2.5, 3.5):
        problem = half_ellipsoid(scale)
        state, best, median = timed_multigrid(problem, 3)
        nodes = int(problem.tissue.sum())
        found.append((nodes, best))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(f"scale {scale}: {nodes} nodes, {best:.2f} s best, {median:.2f} s median, "
              f"converged {state.converged}, "
              f"{(peak - before) / nodes:.0f} bytes a node")  # fmt: skip
    nodes, seconds = np.log(np.array(found)).T
    print(f"exponent of growth: {np.polyfit(nodes, seconds, 1)[0]:.2f}")


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gap", type=float, default=65.0)
    parser.add_argument("--sizes", action="store_true")
    parser.add_argument("--quick", action="store_true", help="multigrid only")
    arguments = parser.parse_args()
    compare(arguments.gap, arguments.quick)
    if arguments.sizes:
        sizes()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"peak memory of the process: {peak / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
