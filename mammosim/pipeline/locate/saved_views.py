"""A run's folder read back: what `locate` needs of it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import DisplacementField
from mammosim.config import read_text
from mammosim.errors import InputError
from mammosim.export import read_compressed_labels, read_displacement, read_geometry
from mammosim.geometry import Gantry, VoxelFrame
from mammosim.targets import ImagePoint, stereotactic


@dataclass(frozen=True, eq=False)
class SavedView:
    """What a run kept of one view's compression and geometry.

    Parameters
    ----------
    gantry : Gantry
        With the tube upright.
    field : DisplacementField
    converged : bool
        Whether the compression reached its tolerance.
    nipple_mm : ndarray, (3,)
        Nipple of the uncompressed breast, breast frame, mm.
    labels : ndarray of uint8, [x, y, z], or None
        Labels of the compressed breast, axes of the compression frame.
    labels_frame : VoxelFrame or None
    """

    gantry: Gantry
    field: DisplacementField
    converged: bool
    nipple_mm: NDArray[np.float64]
    labels: NDArray[np.uint8] | None
    labels_frame: VoxelFrame | None

    def image_point(self, row: float, column: float, tube_angle_deg: float = 0.0) -> ImagePoint:
        """A pixel of this view, with the tube upright or turned."""
        name = self.gantry.view.label
        if tube_angle_deg:
            name += f" at {tube_angle_deg:g} degrees"
        gantry = stereotactic(self.gantry, tube_angle_deg)
        return ImagePoint(name, self.field, gantry, row, column, self.labels, self.labels_frame)


def read_views(run: str | PathLike[str], names: Sequence[str]) -> dict[str, SavedView]:
    """Views of a finished run, each read once.

    Parameters
    ----------
    run : path
        The run's folder.
    names : sequence of str
        As `CC` or `LCC`.

    Raises
    ------
    InputError
        If the folder is no run's or has no such view, or a file of it cannot be read.
    """
    run = Path(run)
    found = sorted(path.parent.name for path in run.glob("*/geometry.json"))
    if not found:
        raise InputError(
            f"{run}: no view with a geometry.json in it, expected the folder of a finished run"
        )
    folders = {}
    for name in names:
        of_name = [folder for folder in found if name in (folder, folder[1:])]
        if not of_name:
            raise InputError(f"view: found '{name}', {run} has {', '.join(found)}")
        if len(of_name) > 1:
            raise InputError(
                f"view: found '{name}', which both breasts have; use {' or '.join(of_name)}"
            )
        folders[name] = run / of_name[0]
    views = {folder: _read_view(folder) for folder in dict.fromkeys(folders.values())}
    return {name: views[folder] for name, folder in folders.items()}


def _read_view(folder: Path) -> SavedView:
    gantry = read_geometry(folder / "geometry.json")
    field = read_displacement(
        folder / "displacement.nii.gz", folder / "lattice.nii.gz", gantry.view
    )
    compression = _read_json(folder / "compression.json")
    labels, frame = None, None
    if (folder / "compressed.nii.gz").is_file():
        labels, frame = read_compressed_labels(folder / "compressed.nii.gz", gantry.view)
    nipple = np.array(compression.get("nipple_mm", [np.nan] * 3), dtype=float)
    converged = compression.get("converged") is True
    return SavedView(gantry, field, converged, nipple, labels, frame)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error})") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected a JSON object")
    return values
