"""The model `none`: a breast that is compressed already, or is to stay as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.lattice import bounds_mm, tissue_front
from mammosim.compression.model import MechanicalModel
from mammosim.compression.plates import plate_edge_mm
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom


def leave_uncompressed(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """A breast that nothing moves; the plates touch it from below and above.

    Heights of the plates are taken from the settings where both are given.
    """
    if settings.force_n is not None or settings.thickness_mm is not None:
        raise InputError(
            "compression.model: 'none' moves nothing, so thickness_mm and force_n must be left out"
        )
    low, high = bounds_mm(breast, view)
    frame = VoxelFrame(low, high - low, (2, 2, 2))
    field = DisplacementField(
        frame, np.zeros((2, 2, 2, 3), np.float32), np.ones((2, 2, 2), bool), view.rotation
    )
    support = low[2] if settings.support_z_mm is None else settings.support_z_mm
    paddle = high[2] if settings.paddle_z_mm is None else settings.paddle_z_mm
    history = np.zeros(0, [("iteration", np.int32)])
    edge = plate_edge_mm(settings, tissue_front(breast), muscle_fixed=False)
    return CompressedBreast(
        breast, view, "none", field, float(support), float(paddle), edge, True,
        {"force_n": 0.0, "error_voxel": 0.0}, history,
    )  # fmt: skip


UNCOMPRESSED = MechanicalModel(
    leave_uncompressed,
    method=lambda settings: "left uncompressed",
    where_it_stopped=lambda compressed, settings: "nothing was computed",
    compresses=False,
)
