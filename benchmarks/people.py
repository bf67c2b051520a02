"""Force, pressure, contact area and outline of generated breasts beside what is measured in women.

    python benchmarks/people.py [--breasts 40] [--elements 5] [--sets aspiration] [--ratios 1 3 6]

Compresses generated breasts in CC and MLO to the thickness of the population fit, with the plates'
edge 15 (CC) and 5 mm (MLO) in front of the chest wall and every stiffness set that has skin as a
sheet, or those named. Published: total force on the paddle 49 to 186 N, median 122 N (Sullivan et
al. 1991). Of it 22 % (CC) and 14 % (MLO) bear on the breast itself, with a mean pressure of 2.3
and 0.5 kPa; the rest on tissue near the chest wall (28 women, rigid plate, sensors: Dustler et al.
2021, Acta Radiol 62:1583). Plates that start in front of the wall miss that tissue: forces here are
to be held against the breast's own share, 27 N in CC and 17 N in MLO of 122 N. "Front" leaves out
what lies within 20 mm of the plates' edge.

--ratios compares fibres: the outline of the front of the breast in CC, by the logarithm of an
ellipse's width over its depth: 0.48 on real mammograms, 0.27 by isotropic and 0.47 by transversely
isotropic simulation (Tanner et al. 2010, Digital Mammography, Lect Notes Comput Sci 6136).
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.tissues import SKIN_SHEETS

DENSITIES = ("fatty", "scattered", "heterogeneous", "dense")

VIEWS = (("CC", 15.0), ("MLO", 5.0))

MEASURES = (
    "force_n", "front_force_n", "pressure_kpa", "front_pressure_kpa", "contact_area_mm2",
)  # fmt: skip

FRONT = 0.5
"""Part of the breast's depth, from the nipple back, whose outline is fitted."""


def breast(number: int) -> BreastPhantom:
    """One of the generated breasts: every density, 200 to 1200 mL."""
    return mammosim.generate_phantom(
        density=DENSITIES[number % 4], volume_ml=float(200.0 * 6.0 ** ((7 * number % 40) / 39.0)),
        voxel_mm=1.0, seed=number + 1, laterality="L",
    )  # fmt: skip


def places(compressed: CompressedBreast) -> NDArray[np.float64]:
    """(n, 3) compressed places of tissue voxels, compression frame, mm."""
    phantom = compressed.phantom
    inside = np.argwhere(phantom.labels[::2, ::2, ::2]) * 2
    points = phantom.origin_mm + inside * phantom.voxel_mm
    return (points + compressed.displacement_at(points)) @ compressed.view.rotation.T


def log_ratio(compressed: CompressedBreast) -> float:
    """log(width / depth) of the ellipse fitted to the front half of the breast's outline.

    The ellipse's centre lies where the front half begins; its half-axes follow by least squares
    from ``(x / a)^2 + (y / b)^2 = 1``.
    """
    seen = places(compressed)
    front = seen[:, 0].max()
    start = front - FRONT * (front - compressed.plate_edge_mm)
    edges = np.arange(start, front, 2.0)
    layers = [seen[(seen[:, 0] >= x) & (seen[:, 0] < x + 2.0), 1] for x in edges]
    wide = np.array([0.5 * np.ptp(y) if len(y) > 3 else 0.0 for y in layers])
    ahead = edges + 1.0 - start
    known = wide > 0.0
    terms = np.stack([ahead[known] ** 2, wide[known] ** 2], axis=1)
    inverse = np.linalg.lstsq(terms, np.ones(len(terms)), rcond=None)[0]
    return float(0.5 * np.log(inverse[0] / inverse[1]))


def compressed(
    phantom: BreastPhantom, view: str, edge_mm: float, **keys: object
) -> CompressedBreast:
    """A compression, converged or not (it says so)."""
    try:
        return mammosim.compress(phantom, view, model="hyperelastic", plate_edge_mm=edge_mm, **keys)
    except mammosim.NotConverged as stop:
        print(f"    {stop}")
        return stop.reached


def forces(breasts: int, elements: float, sets: list[str]) -> None:
    """Force, pressure and area in each view and set: medians and 5 to 95 %."""
    for name in sets:
        for view, edge in VIEWS:
            rows = []
            for number in range(breasts):
                found = compressed(
                    breast(number), view, edge, resolution_mm=elements, stiffness=name
                )
                rows.append([found.measures[key] for key in MEASURES] + [found.thickness_mm])
            low, middle, high = np.percentile(np.array(rows), [5, 50, 95], axis=0)
            print(f"{name}, {view}, {breasts} breasts:")
            for key, *values in zip((*MEASURES, "thickness_mm"), middle, low, high, strict=True):
                print("    {}: {:.3g} ({:.3g} to {:.3g})".format(key, *values), flush=True)


def outlines(breasts: int, elements: float, ratios: list[float]) -> None:
    """Outline of the front in CC, and its depth, with and without fibres."""
    for ratio in ratios:
        logs, depths = [], []
        for number in range(breasts):
            found = compressed(
                breast(number), "CC", 15.0, resolution_mm=elements, stiffness="aspiration",
                fibres={"ratio": ratio},
            )  # fmt: skip
            logs.append(log_ratio(found))
            depths.append(places(found)[:, 0].max())
        print(
            f"fibres {ratio:g}: log(width / depth) {np.mean(logs):.2f} +- {np.std(logs):.2f}, "
            f"nipple {np.mean(depths):.1f} mm from the chest wall",
            flush=True,
        )


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--breasts", type=int, default=40)
    parser.add_argument("--elements", type=float, default=5.0)
    parser.add_argument("--sets", nargs="+", choices=list(SKIN_SHEETS), default=list(SKIN_SHEETS))
    parser.add_argument("--ratios", type=float, nargs="*", default=[])
    arguments = parser.parse_args()
    if arguments.ratios:
        outlines(arguments.breasts, arguments.elements, arguments.ratios)
    else:
        forces(arguments.breasts, arguments.elements, arguments.sets)


if __name__ == "__main__":
    main()
