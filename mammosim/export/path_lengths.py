"""Path lengths as a NumPy archive, complete enough to be exposed again without tracing."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.config import open_file
from mammosim.errors import InputError
from mammosim.export.atomic import whole_file
from mammosim.geometry import Gantry, View
from mammosim.projection import PathLengths

_ARRAYS = ("tissues", "materials", "lesion_labels", "length_mm", "attenuating_mm", "geometry")


def write_path_lengths(paths: PathLengths, path: str | PathLike[str]) -> None:
    """Write the path length of every channel as a NumPy archive.

    Parameters
    ----------
    paths : PathLengths
    path : str or path
        Ending in ``.npz``.

    Raises
    ------
    InputError
        If the file cannot be written.

    Notes
    -----
    Its arrays: `tissues`, `materials`, `lesion_labels` (one entry a channel), `length_mm` and
    `attenuating_mm` ([tissue, row, column]), `pixel_mm`, `focal_spot_mm` (gantry frame), and
    `geometry`, the view, the gantry and the compression as JSON. `load_path_lengths` reads it.
    """
    geometry = {
        "gantry": asdict(paths.gantry),
        "thickness_mm": paths.thickness_mm,
        "force_n": paths.force_n,
        "clipped_fraction": paths.clipped_fraction,
    }
    with whole_file(path) as part:
        np.savez_compressed(
            part,
            tissues=np.array(paths.tissues),
            materials=np.array(paths.materials),
            lesion_labels=np.array(paths.lesion_labels, dtype=np.int64),
            length_mm=paths.length_mm,
            attenuating_mm=paths.attenuating_mm,
            pixel_mm=np.float64(paths.pixel_mm),
            focal_spot_mm=paths.gantry.focal_spot_mm,
            geometry=np.array(json.dumps(geometry)),
        )


def load_path_lengths(path: str | PathLike[str]) -> PathLengths:
    """Read path lengths that a run saved, to expose them again.

    Parameters
    ----------
    path : path
        A `path_lengths.npz` that a run wrote with ``export.path_lengths: true``.

    Returns
    -------
    PathLengths
        The same numbers, bit by bit, that the run's own exposure had.

    Raises
    ------
    InputError
        If it is no such archive, or an array is missing or does not fit the others.

    Examples
    --------
    Another tube voltage for a breast that was compressed and traced long ago::

        paths = mammosim.load_path_lengths("runs/quickstart/LCC/path_lengths.npz")
        image = mammosim.expose(paths, kvp=31, seed=2)
    """
    try:
        with open_file(path) as stream, np.load(stream, allow_pickle=False) as archive:
            missing = [name for name in _ARRAYS if name not in archive]
            if missing:
                raise InputError(
                    f"{path}: found no array {', '.join(missing)}; expected an archive written by "
                    f"export.path_lengths"
                )
            found = {name: archive[name] for name in _ARRAYS}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: cannot be read as a NumPy archive ({error})") from error
    return _paths(found, path)


def _paths(found: dict[str, NDArray[Any]], path: str | PathLike[str]) -> PathLengths:
    geometry = _geometry(found["geometry"], path)
    gantry: Gantry = geometry.pop("gantry")
    shape = (found["tissues"].size, gantry.rows, gantry.columns)
    for name in ("length_mm", "attenuating_mm"):
        if found[name].shape != shape or found[name].dtype != np.float32:
            raise InputError(
                f"{path}: found {name} of {found[name].dtype} {found[name].shape}, "
                f"expected float32 {shape} [tissue, row, column]"
            )
    for name in ("materials", "lesion_labels"):
        if found[name].shape != shape[:1]:
            raise InputError(
                f"{path}: found {name} of shape {found[name].shape}, expected one entry for each "
                f"of {shape[0]} tissues"
            )
    return PathLengths(
        tissues=tuple(found["tissues"].tolist()),
        materials=tuple(found["materials"].tolist()),
        lesion_labels=tuple(found["lesion_labels"].tolist()),
        length_mm=found["length_mm"],
        attenuating_mm=found["attenuating_mm"],
        gantry=gantry,
        **geometry,
    )


def _geometry(text: NDArray[Any], path: str | PathLike[str]) -> dict[str, Any]:
    try:
        geometry: dict[str, Any] = json.loads(str(text))
        gantry = dict(geometry.pop("gantry"))
        view = View(**gantry.pop("view"))
        numbers = {key: float(geometry[key]) for key in
                   ("thickness_mm", "force_n", "clipped_fraction")}  # fmt: skip
        return {"gantry": Gantry(view=view, **gantry), **numbers}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: geometry cannot be understood ({error}); expected the view, the gantry and "
            "the compression as export.path_lengths writes them"
        ) from error
