"""The `phantom` section's work: read or generate, then put in lesions and landmarks."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from mammosim.errors import InputError
from mammosim.phantom.anatomy import generate_phantom
from mammosim.phantom.breast import BreastPhantom, Landmark
from mammosim.phantom.lesions import insert_lesions
from mammosim.phantom.place import box_text, tissue_at
from mammosim.phantom.read import read_phantom
from mammosim.phantom.settings import LandmarkSettings, PhantomSettings
from mammosim.phantom.voxels import MAX_LENGTH_MM, MIN_LENGTH_MM
from mammosim.tissues import LABEL_MAPS

_LESION_STREAM = 0x1E510
"""Any number: keeps the random numbers of lesions apart from those of the anatomy."""


def make_phantom(
    settings: PhantomSettings,
    laterality: Literal["L", "R"] | None = None,
    seed: int = 1,
    folder: str | os.PathLike[str] = ".",
    breast_number: int = 0,
) -> BreastPhantom:
    """Read or generate the breast, and put in lesions and landmarks.

    Parameters
    ----------
    settings : PhantomSettings
    laterality : {"L", "R"}, optional
        Which breast it is; left out: what the phantom shows, else L.
    seed : int
        Seed of the generator and of lesions without a position.
    folder : path
        Folder that paths in the settings are relative to.
    breast_number : int
        0, or 1 for the second breast of an exam, whose lesions are drawn apart from the first's.

    Raises
    ------
    InputError
        If the file cannot be used, or a lesion or landmark does not fit.
    """
    if settings.generate is not None:
        breast = generate_phantom(settings.generate, seed=seed, laterality=laterality or "L")
    else:
        labels = settings.labels
        if labels is not None and labels not in LABEL_MAPS:
            labels = str(Path(folder) / labels)
        breast = read_phantom(
            Path(folder) / str(settings.file), labels, laterality, settings.axes,
            settings.voxel_mm, settings.reduce, settings.compressed_for,
            **settings.lesions_from_labels.model_dump(), open_end=settings.open_end,
        )  # fmt: skip
        _check_size(breast)
    landmarks = _landmarks(breast, settings.landmarks)
    rng = np.random.default_rng([seed, _LESION_STREAM, *([breast_number] if breast_number else [])])
    generated = settings.generate is not None  # so nothing else uses its labels
    breast = insert_lesions(breast, settings.lesions, rng, in_place=generated)
    return dataclasses.replace(
        breast,
        landmarks=breast.landmarks + landmarks,
        shaped_under=None if settings.shaped_under == "none" else settings.shaped_under,
    )


def _check_size(breast: BreastPhantom) -> None:
    """Refuse a file that no breast fills, as where its unit is not the mm."""
    longest = float(max(breast.voxel_mm * breast.labels.shape))
    if not MIN_LENGTH_MM <= longest <= MAX_LENGTH_MM:
        raise InputError(
            f"{breast.source}: is {longest:.3g} mm long, expected {MIN_LENGTH_MM:g} to "
            f"{MAX_LENGTH_MM:g} mm for a breast; if its voxel size is in another unit, set "
            f"phantom.voxel_mm in mm"
        )


def _landmarks(breast: BreastPhantom, wanted: Sequence[LandmarkSettings]) -> tuple[Landmark, ...]:
    problems = []
    for number, entry in enumerate(wanted):
        tissue = tissue_at(breast, entry.position_mm)
        if tissue in (None, "air"):
            where = "outside the voxels" if tissue is None else "in air"
            problems.append(
                f"phantom.landmarks.{number}: '{entry.name}' at {list(entry.position_mm)} mm lies "
                f"{where}; {box_text(breast)}"
            )
    if problems:
        raise InputError(problems)
    return tuple(Landmark(entry.name, np.array(entry.position_mm)) for entry in wanted)
