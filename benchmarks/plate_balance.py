"""Forces on paddle and support of generated breasts: plates midway, and where they balance.

    python benchmarks/plate_balance.py [--models springs hyperelastic] [--resolution-mm 5]

For six breasts in CC and MLO, each model: the difference of the two forces, of the larger one,
with the plates about the middle of the breast's height (as `place_plates` puts them before their
height is sought) and as `compress` finds them, how far they moved, and processor time of both.
"""

from __future__ import annotations

import argparse
import time
from typing import Any, Literal

from mammosim.compression import CompressedBreast, CompressionSettings
from mammosim.compression.credibility import contact_quantities
from mammosim.compression.lattice import build_lattice
from mammosim.compression.model import MODELS
from mammosim.compression.plates import held_tissue, place_plates, plate_edge_mm
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held, generate_phantom

BREASTS: tuple[tuple[Any, float, Literal["L", "R"]], ...] = (
    ("fatty", 350, "L"), ("scattered", 500, "R"), ("scattered", 800, "L"),
    ("heterogeneous", 250, "L"), ("dense", 150, "R"), ("heterogeneous", 1100, "R"),
)  # fmt: skip
STIFFNESS = {"springs": "thesis", "hyperelastic": "aspiration"}
VOXEL_MM = 2.0


def main() -> None:
    """Compress each breast twice and print a line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", nargs="+", default=list(STIFFNESS))
    parser.add_argument("--resolution-mm", type=float, default=5.0)
    wanted = parser.parse_args()
    print("model         breast              view  midway %  found %  moved mm  N      CPU s")
    for number, (density, volume_ml, side) in enumerate(BREASTS):
        breast = generate_phantom(
            density=density, volume_ml=volume_ml, voxel_mm=VOXEL_MM, seed=number + 1,
            laterality=side,
        )  # fmt: skip
        for model in wanted.models:
            for name in ("CC", "MLO"):
                settings = CompressionSettings(
                    model=model, stiffness=STIFFNESS[model], resolution_mm=wanted.resolution_mm
                )
                view = View(name, side, settings.mlo_angle_deg)
                held = as_held(breast, view.rotation[1])
                midway, first_s = timed(held, view, midway_heights(held, view, settings))
                found, second_s = timed(held, view, settings)
                moved = middle_mm(found) - middle_mm(midway)
                print(
                    f"{model:13s} {density:13s} {volume_ml:4.0f}  {name:5s} "
                    f"{imbalance(midway):8s}  {imbalance(found):7s}  {moved:8.1f}  "
                    f"{found.force_n:5.0f}  {first_s:.1f} {second_s:.1f}",
                    flush=True,
                )


def midway_heights(
    breast: BreastPhantom, view: View, settings: CompressionSettings
) -> CompressionSettings:
    """The settings with both heights as the search starts from them."""
    reach, fixed = held_tissue(settings, breast)
    lattice = build_lattice(breast, view, settings.resolution_mm, settings.moduli)
    plates, _ = place_plates(settings, breast, view, lattice, plate_edge_mm(settings, reach, fixed))
    heights = {"support_z_mm": plates.support_z_mm, "paddle_z_mm": plates.paddle_z_mm}
    return settings.model_copy(update=heights)


def timed(
    breast: BreastPhantom, view: View, settings: CompressionSettings
) -> tuple[CompressedBreast, float]:
    """A compression that nobody judges, and its processor time, s."""
    start = time.process_time()
    found = MODELS[settings.model].compress(breast, view, settings, 1, None)
    return found, time.process_time() - start


def imbalance(found: CompressedBreast) -> str:
    """Difference of the forces, per cent; a dash where the solver did not converge."""
    quantities = contact_quantities(found, CompressionSettings())
    return f"{quantities['force_imbalance_percent']:.1f}" if found.converged else "-"


def middle_mm(found: CompressedBreast) -> float:
    """Height of the middle between the plates, mm."""
    return 0.5 * (found.support_z_mm + found.paddle_z_mm)


if __name__ == "__main__":
    main()
