"""Draws the elements of a generated breast before and after compression, in slices.

    python benchmarks/deformed_mesh.py OUT.png [--elements 4] [--view CC] [--edge 15]
        [--paddles level spot tilting]

Left before, then after, the slice through the middle of the breast; colour is each element's
volume over that at rest. Plates are drawn as lines.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray

import mammosim
from mammosim._jit import one_blas_thread
from mammosim.compression.hyperelastic import Stages
from mammosim.compression.hyperelastic._element_kernels import element_volumes
from mammosim.compression.hyperelastic.mesh import Mesh
from mammosim.compression.hyperelastic.tilt import level_paddle, moment_nm
from mammosim.compression.hyperelastic_model import body_between_plates
from mammosim.compression.plates import Panel, Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection

PADDLES: dict[str, dict[str, Any] | None] = {
    "level": None,
    "spot": {"size_mm": (35.0, 60.0), "centre_mm": (40.0, 0.0)},
    "tilting": {"tilt": {"spring_nm_per_deg": 0.2}},
}
"""What the paddle is, by its name in the picture."""

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
def draw(out: str, elements: float, view_name: str, edge_mm: float, kinds: list[str]) -> None:
    """Compress under each paddle, and draw the breast before and after."""
    breast = mammosim.generate_phantom(
        density="scattered", volume_ml=550.0, voxel_mm=0.8, seed=1, laterality="L"
    )
    rows = [compressed(breast, view_name, elements, edge_mm, PADDLES[kind]) for kind in kinds]
    figure, axes = plt.subplots(
        1, 1 + len(rows), figsize=(5.5 * (1 + len(rows)), 4.2), sharex=True, sharey=True,
        layout="constrained",
    )  # fmt: skip
    cells = slice_of(axes[0], rows[0].mesh, 0.0 * rows[0].u)
    for axis, kind, row in zip(axes[1:], kinds, rows, strict=True):
        cells = slice_of(axis, row.mesh, row.u)
        end = axis.get_xlim()[1]
        axis.hlines(row.plates.support_z_mm, row.plates.edge_mm, end, "C2", linewidth=2)
        axis.plot(*face(row.plates, end), "C2", linewidth=2)
        axis.set_title(f"{kind} paddle")
    axes[0].set_ylabel("along the plates' normal, mm")
    figure.colorbar(cells, ax=axes, label="volume over that at rest")
    figure.savefig(out, dpi=80)


class Compressed(NamedTuple):
    """Elements, their displacement in edges, and the plates."""

    mesh: Mesh
    u: NDArray[np.float64]
    plates: Plates


def compressed(
    breast: BreastPhantom, name: str, elements: float, edge_mm: float, paddle: dict[str, Any] | None
) -> Compressed:
    """A breast between plates that stand about the middle of its height."""
    settings = CompressionSettings(
        model="hyperelastic", resolution_mm=elements, plate_edge_mm=edge_mm, paddle=paddle
    )
    view = View(name, breast.laterality, settings.mlo_angle_deg)
    mesh, plates, _ = body_between_plates(as_held(breast, view.rotation[1]), view, settings)
    depth_mm = plates.panel.front_mm if plates.panel else 0.0
    stages = Stages(mesh, plates.edge_mm, settings.tolerance_mm, depth_mm=depth_mm)
    state = stages.compress(plates)
    if settings.paddle and settings.paddle.tilt and settings.paddle.tilt.spring_nm_per_deg:
        spring, stop = settings.paddle.tilt.spring_nm_per_deg, settings.paddle.tilt.max_deg
        plates, state, _ = level_paddle(stages, plates, state, spring, stop)
        moment = moment_nm(stages, plates, state)
        print(f"moment {moment:.2f} N m at {plates.panel.tilt_deg:.2f} degrees")
    print(f"{paddle}: converged {state.converged}, smallest J {state.value.smallest:.2f}")
    return Compressed(mesh, state.u, plates)


def slice_of(axis: plt.Axes, mesh: Mesh, u: NDArray[np.float64]) -> PolyCollection:
    """Draw the slice through the middle of a breast."""
    active, middle = mesh.body.active, mesh.body.active.shape[1] // 2
    volume, smallest = (np.ones(active.shape) for _ in range(2))
    element_volumes(u, mesh.body.element_span, volume, smallest)
    edge = float(mesh.nodes.spacing_mm[0])
    rest = np.indices(mesh.body.nodes.shape).astype(float)
    places = mesh.nodes.origin_mm[:, None, None, None] + edge * (rest + u)
    cells = PolyCollection(
        polygons(places, active, middle), array=volume[:, middle][active[:, middle]],
        cmap="coolwarm", edgecolors="k", linewidths=0.3,
    )  # fmt: skip
    cells.set_clim(0.9, 1.1)
    axis.add_collection(cells)
    axis.set_aspect("equal")
    axis.autoscale()
    axis.set_xlabel("from the chest wall, mm")
    return cells


def face(plates: Plates, end_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x and z of the ends of the paddle's face, mm, no further forward than the picture."""
    panel = plates.panel or Panel(0.0, end_mm, 0.0, 0.0, 0.0)
    x = plates.edge_mm + np.array([panel.back_mm, panel.front_mm])
    x = np.minimum(x, end_mm)
    slope = np.tan(np.deg2rad(panel.tilt_deg))
    return x, plates.paddle_z_mm - slope * (x - plates.edge_mm - panel.hinge_mm)


def main() -> None:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("--elements", type=float, default=4.0)
    parser.add_argument("--view", default="CC")
    parser.add_argument("--edge", type=float, default=15.0)
    parser.add_argument("--paddles", nargs="+", choices=list(PADDLES), default=["level"])
    arguments = parser.parse_args()
    draw(arguments.out, arguments.elements, arguments.view, arguments.edge, arguments.paddles)


if __name__ == "__main__":
    main()
