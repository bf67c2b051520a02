"""Draws the elements of a generated breast before and after compression, in slices.

    python benchmarks/deformed_mesh.py OUT.png [--elements 4] [--view CC] [--edge 15]

Left before, right after, the slice through the middle of the breast; colour is each element's
volume over that at rest. Plates are drawn as lines.
"""

from __future__ import annotations

import argparse

import matplotlib
import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim._jit import one_blas_thread
from mammosim.compression.hyperelastic import Stages
from mammosim.compression.hyperelastic._element_kernels import element_volumes
from mammosim.compression.hyperelastic_model import body_between_plates
from mammosim.compression.settings import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import as_held

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def polygons(
    places: NDArray[np.float64], active: NDArray[np.bool_], middle: int
) -> list[NDArray[np.float64]]:
    """Outlines (4, 2) in x and z of the elements of one slice, mm."""
    return [
        np.array([places[[0, 2], i + a, middle, k + c] for a, c in CORNERS])
        for i, k in np.argwhere(active[:, middle])
    ]


@one_blas_thread
def draw(out: str, elements: float, view_name: str, edge_mm: float) -> None:
    """Compress, and draw both states."""
    breast = mammosim.generate_phantom(
        density="scattered", volume_ml=550.0, voxel_mm=0.8, seed=1, laterality="L"
    )
    settings = CompressionSettings(
        model="hyperelastic", stiffness="krouskop", resolution_mm=elements, plate_edge_mm=edge_mm
    )
    view = View(view_name, breast.laterality, settings.mlo_angle_deg)
    mesh, plates, _ = body_between_plates(as_held(breast, view.rotation[1]), view, settings)
    state = Stages(mesh, plates.edge_mm, settings.tolerance_mm).compress(plates)
    active, middle = mesh.body.active, mesh.body.active.shape[1] // 2
    volume, smallest = (np.ones(active.shape) for _ in range(2))
    element_volumes(state.u, mesh.body.element_span, volume, smallest)
    rest = np.indices(mesh.body.nodes.shape).astype(float)
    figure, axes = plt.subplots(
        1, 2, figsize=(11, 4.2), sharex=True, sharey=True, layout="constrained"
    )
    for axis, moved, values in ((axes[0], 0.0, None), (axes[1], state.u, volume)):
        places = mesh.nodes.origin_mm[:, None, None, None] + elements * (rest + moved)
        shown = np.ones(active.shape) if values is None else values
        cells = PolyCollection(
            polygons(places, active, middle), array=shown[:, middle][active[:, middle]],
            cmap="coolwarm", edgecolors="k", linewidths=0.3,
        )  # fmt: skip
        cells.set_clim(0.9, 1.1)
        axis.add_collection(cells)
        axis.set_aspect("equal")
        axis.autoscale()
        axis.set_xlabel("from the chest wall, mm")
    for z in (plates.support_z_mm, plates.paddle_z_mm):
        axes[1].hlines(z, plates.edge_mm, axes[1].get_xlim()[1], "C2", linewidth=2)
    axes[0].set_ylabel("along the plates' normal, mm")
    figure.colorbar(cells, ax=axes, label="volume over that at rest")
    figure.savefig(out, dpi=80)
    print(f"{out}: {np.count_nonzero(active)} elements, smallest J {smallest[active].min():.2f}")


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("--elements", type=float, default=4.0)
    parser.add_argument("--view", default="CC")
    parser.add_argument("--edge", type=float, default=15.0)
    arguments = parser.parse_args()
    draw(arguments.out, arguments.elements, arguments.view, arguments.edge)


if __name__ == "__main__":
    main()
