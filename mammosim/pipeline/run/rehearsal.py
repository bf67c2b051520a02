"""A run in miniature, for the kernels that it compiles: another process rehearses what is to come.

On a machine that has not run the program before, the breast's own kernels take the first while; a
process beside the run can meanwhile compile those of the stages that follow, and the run finds them
on the disk. It makes no file but compiled kernels, and no number of the run comes from it.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import threading
from contextlib import suppress

import numpy as np

from mammosim._jit import one_blas_thread, use_threads
from mammosim._kernel_cache import BUSY
from mammosim.acquisition import AcquisitionSettings
from mammosim.errors import MammosimError
from mammosim.geometry import VoxelFrame
from mammosim.phantom import BreastPhantom, OpenEnd
from mammosim.pipeline.configuration import ResolvedView, RunConfig
from mammosim.pipeline.run.simulation import simulate_series, simulate_view
from mammosim.tissues import TISSUES

SEMI_AXES_MM = (42.0, 48.0, 42.0)
"""Of the small breast: large enough for plates, a picture and scatter."""

VOXEL_MM, ELEMENT_MM, PIXEL_MM = 2.0, 7.0, 1.0
"""Its voxels, elements and pixels: coarse, since only the compiled code is wanted."""

MIN_PHOTONS = 10_000
"""The fewest that a configuration may ask for."""


def main() -> None:
    """Rehearse the configuration that standard input holds in its first line, as JSON.

    The process ends at once when its standard input does, so that none is left behind whatever
    becomes of the one that started it.
    """
    text = sys.stdin.readline()
    threading.Thread(target=_end_with_input, daemon=True).start()
    use_threads(1)
    rehearse(RunConfig.model_validate_json(text))


def _end_with_input() -> None:
    sys.stdin.read()
    with BUSY:
        os._exit(0)


@one_blas_thread
def rehearse(config: RunConfig) -> None:
    """Make the views that a configuration asks for, of a small breast, coarsely.

    Parameters
    ----------
    config : RunConfig
    """
    breast = _small_breast(config.first_side or "L", generated=config.phantom.generate is not None)
    for view in config.resolved_views:
        simulated = simulate_series if view.tomosynthesis else simulate_view
        with suppress(MammosimError):  # what such a breast is too small for is compiled later
            simulated(breast, _coarse(view))


def _coarse(view: ResolvedView) -> ResolvedView:
    """A view's settings as they suit the small breast; which kernels they lead to stays."""
    plates = {
        "thickness_mm": None if view.compression.force_n else 1.2 * SEMI_AXES_MM[2],
        "support_z_mm": None, "paddle_z_mm": None, "plates_voxel": None, "chest_wall_mm": None,
        "plate_edge_mm": None, "resolution_mm": ELEMENT_MM,
    }  # fmt: skip
    detector = {"pixel_mm": PIXEL_MM, "detector_edge_mm": None, "detector_mm": None}
    return dataclasses.replace(
        view,
        compression=view.compression.model_copy(update=plates),
        projection=view.projection.model_copy(update=detector),
        acquisition=_few_photons(view.acquisition),
    )


def _few_photons(settings: AcquisitionSettings) -> AcquisitionSettings:
    if settings.scatter_model != "monte-carlo":
        return settings
    few = AcquisitionSettings.model_validate({"scatter": {"photons": MIN_PHOTONS}})
    return settings.model_copy(update={"scatter": few.scatter})


def _small_breast(laterality: str, generated: bool) -> BreastPhantom:
    """Half an ellipsoid with everything that needs separate kernels: gland, septa, open end."""
    a, b, c = SEMI_AXES_MM
    counts = (int(a / VOXEL_MM) + 3, 2 * int(b / VOXEL_MM) + 6, 2 * int(c / VOXEL_MM) + 6)
    origin = np.array([0.5, -0.5 * (counts[1] - 1), -0.5 * (counts[2] - 1)]) * VOXEL_MM
    frame = VoxelFrame(origin, np.full(3, VOXEL_MM), counts)
    x, y, z = (origin[axis] + VOXEL_MM * np.indices(counts)[axis] for axis in range(3))
    radius = np.sqrt((x / a) ** 2 + (y / b) ** 2 + (z / c) ** 2)
    label = {name: tissue.label for name, tissue in TISSUES.items()}
    labels = np.zeros(counts, np.uint8)
    labels[radius <= 1] = label["adipose"]
    labels[radius <= 0.8] = label["ligament_half"]
    labels[radius <= 0.5] = label["gland"]
    labels[(radius <= 1) & (radius > 1 - VOXEL_MM / c)] = label["skin"]
    end = None
    if generated:
        cut_mm = 0.8 * c
        depth = ((1 - radius) * c).astype(np.float32)
        labels[z > cut_mm] = 0
        up = np.array([0.0, 0.0, 1.0])
        end = OpenEnd(cut_mm * up, up, depth, frame, VOXEL_MM)
    names = {number: name for name, number in label.items()}
    nipple = np.array([a, 0.0, 0.0])
    return BreastPhantom(
        labels, frame.spacing_mm, frame.origin_mm, laterality, names, nipple, open_end=end
    )
