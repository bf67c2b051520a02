"""The model `none`: a breast that is compressed already, or is to stay as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.lattice import bounds_mm
from mammosim.compression.model import MechanicalModel
from mammosim.compression.settings import CompressionSettings
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom, CompressedState

CELL_MM = 2.0
"""Of the lattice, on which nothing moves: so closely does the detector's format follow the shadow
of the breast, as with a breast that is compressed."""


def leave_uncompressed(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """A breast that nothing moves.

    Plates are where the settings say, else where those are that hold the phantom already, else
    they touch it from below and above. The detector begins at their edge or, where they have none,
    at the first layer of tissue.
    """
    refuse_moving(settings)
    low, high = bounds_mm(breast, view)
    cells = np.maximum(np.ceil((high - low) / CELL_MM - 1e-6).astype(int), 1)
    nx, ny, nz = (int(count) + 1 for count in cells)
    frame = VoxelFrame(low, (high - low) / cells, (nx, ny, nz))
    field = DisplacementField(
        frame, np.zeros((nx, ny, nz, 3), np.float32), np.ones((nx, ny, nz), bool), view.rotation
    )
    held = breast.compressed or CompressedState(None)
    support = _first(settings.support_z_mm, held.support_z_mm, low[2])
    paddle = _first(settings.paddle_z_mm, held.paddle_z_mm, high[2])
    history = np.zeros(0, [("iteration", np.int32)])
    edge = _first(settings.plate_edge_mm, held.edge_mm, low[0])
    return CompressedBreast(
        breast, view, "none", field, support, paddle, edge, True,
        {"force_n": 0.0, "error_voxel": 0.0}, history,
    )  # fmt: skip


def held_before(breast: BreastPhantom, view: View, compresses: bool) -> tuple[str, ...]:
    """What is doubtful about a view of a breast that was compressed before.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    compresses : bool
        Whether the model compresses it again.
    """
    held, notes = breast.compressed, list[str]()
    if held is None:
        return ()
    if held.view is None and held.paddle_z_mm is not None:
        notes.append(
            f"{view.folder}: the phantom contains plates, but phantom.compressed_for is not "
            f"given: they were assumed to be those of {view.name}"
        )
    if compresses:
        notes.append(
            f"{view.folder}: the phantom is already compressed and was compressed again; "
            f"compression.model: none leaves it as it is"
        )
    return tuple(notes)


def refuse_moving(settings: CompressionSettings) -> None:
    """Refuse settings that ask for a compression where nothing moves.

    Raises
    ------
    InputError
        If a thickness or a force is given.
    """
    if settings.force_n is not None or settings.thickness_mm is not None:
        raise InputError(
            "compression.model: 'none' does not compress, so thickness_mm and force_n must not be "
            "given"
        )


def _first(*candidates: float | None) -> float:
    """The first that is known."""
    return float(next(value for value in candidates if value is not None))


UNCOMPRESSED = MechanicalModel(
    leave_uncompressed,
    method=lambda settings: "left uncompressed",
    where_it_stopped=lambda compressed, settings: "nothing was computed",
    compresses=False,
)
