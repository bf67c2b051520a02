"""Effect of each part of the model: skin, fascia, fibres, weight, tilt, friction.

    python benchmarks/structure.py [--elements 5] [--breasts 1 2 3]

Compresses three generated breasts (200, 500 and 1000 mL) in CC to the thickness of the population
fit, with one part changed at a time, and compares with the defaults: force, contact area, how far
the nipple moves forward, and the distance of tissue from its place with the defaults.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import mammosim
from mammosim.compression import CompressedBreast

BREASTS = (("scattered", 200.0), ("heterogeneous", 500.0), ("fatty", 1000.0))

CHANGES: dict[str, dict[str, Any]] = {
    "default": {},
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


def main() -> None:
    """Print a table for each breast."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--elements", type=float, default=5.0)
    parser.add_argument("--breasts", type=int, nargs="+", choices=(1, 2, 3), default=[1, 2, 3])
    given = parser.parse_args()
    elements = given.elements
    for seed in given.breasts:
        density, volume_ml = BREASTS[seed - 1]
        breast = mammosim.generate_phantom(
            density=density, volume_ml=volume_ml, voxel_mm=1.5, seed=seed, laterality="L"
        )
        inside = np.argwhere(breast.labels[::3, ::3, ::3] > 0) * 3
        points = breast.origin_mm + inside * breast.voxel_mm
        usual = compressed(breast, elements)
        print(f"{density}, {volume_ml:g} mL, to {usual.thickness_mm:.1f} mm")
        for name, keys in CHANGES.items():
            found = compressed(breast, elements, **keys) if keys else usual
            away = found.displacement_at(points) - usual.displacement_at(points)
            distance = np.linalg.norm(away, axis=1)
            nipple = found.displacement_at(breast.nipple_mm[None])[0, 0]
            print(
                f"| {name} | {found.force_n:.1f} N | "
                f"{found.measures['contact_area_mm2'] / 100:.0f} cm² | {nipple:+.1f} mm | "
                f"{distance.mean():.2f} | {np.percentile(distance, 95):.2f} mm |",
                flush=True,
            )


if __name__ == "__main__":
    main()
