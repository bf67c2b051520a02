"""Whether an exposure is plausible: its numbers against the table of limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.dose import dose_limit_mgy
from mammosim.acquisition.exposure import MAX_CONTROLLED_MAS
from mammosim.acquisition.mammogram import Mammogram
from mammosim.acquisition.recording import DetectorInput
from mammosim.geometry import MAGNIFIED
from mammosim.plausibility import plausibility_warnings

WHITE = 16383
"""Largest pixel value, of 14 bits."""

_GRID_ON_A_STAND = (
    "an anti-scatter grid in a magnified view: these are taken without a grid (acquisition.grid: "
    "false), since the air gap below the stand already reduces scatter"
)
"""Practice with a magnification stand: no grid, focal spot of 0.1 mm (Bushberg et al., The
Essential Physics of Medical Imaging, chapter on mammography)."""


def with_warnings(
    image: Mammogram,
    incident: DetectorInput,
    wanted_mas: float,
    exposures: float = 1.0,
    further: Mapping[str, float] | None = None,
) -> Mammogram:
    """A mammogram with a note for each implausible quantity.

    Parameters
    ----------
    image : Mammogram
    incident : DetectorInput
        What it was recorded from.
    wanted_mas : float
        Tube load that was set or that exposure control asked for, all exposures together, mAs.
    exposures : float
        Tube load of all exposures of a series over that of this one.
    further : mapping of str to float, optional
        More quantities to be judged, by their names in the table of limits.

    Returns
    -------
    Mammogram
    """
    quantities = {"tube_load_mas": image.mas * exposures, **(further or {})}
    if incident.coarse.inside.any():
        dose_mgy = image.measures.get("dose_of_all_projections_mgy", image.dose_mgy)
        quantities["dose_percent_of_limit"] = 100.0 * dose_mgy / dose_limit_mgy(image.thickness_mm)
        quantities.update(_of_picture(image.for_processing, incident))
        if incident.settings.scatter_model != "none":
            quantities["scatter_to_primary_ratio"] = incident.scatter_to_primary
    found = [str(warning) for warning in plausibility_warnings(quantities)]
    if wanted_mas > 1.001 * image.mas * exposures:
        found.insert(0, (
            f"exposure control asks for {wanted_mas:.4g} mAs and is limited to "
            f"{MAX_CONTROLLED_MAS:g} mAs: the detector gets "
            f"{100.0 * MAX_CONTROLLED_MAS / wanted_mas:.3g} % of the intended signal"
        ))  # fmt: skip
    found += magnification_warnings(image.gantry.magnification, image.focal_spot_mm, image.grid)
    breast = incident.paths.breast
    view = f"{breast.view.folder}: " if breast is not None else ""
    return replace(image, notes=(*image.notes, *(f"{view}{text}" for text in found)))


def magnification_warnings(magnification: float, focal_spot_mm: float, grid: bool) -> list[str]:
    """What no unit does in a magnified view, one sentence each; none for a contact view.

    Parameters
    ----------
    magnification : float
        At the breast support.
    focal_spot_mm : float
    grid : bool
        Whether an anti-scatter grid is in.
    """
    if magnification < MAGNIFIED:
        return []
    found = [
        str(warning)
        for warning in plausibility_warnings({"magnified_focal_spot_mm": focal_spot_mm})
    ]
    return [*found, _GRID_ON_A_STAND] if grid else found


def _of_picture(counts: NDArray[np.uint16], incident: DetectorInput) -> dict[str, float]:
    """Pixels that are saturated, and that have the most frequent value, % of the breast's."""
    inside, cell = incident.coarse.inside, incident.coarse.cell
    rows, columns = counts.shape
    histogram = np.zeros(WHITE + 1, np.int64)
    for first, cells in zip(range(0, rows, cell), inside, strict=True):
        here = counts[first : first + cell, np.repeat(cells, cell)[:columns]]
        histogram += np.bincount(here.ravel(), minlength=WHITE + 1)
    number = int(histogram.sum())
    return {
        "saturated_percent": 100.0 * float(histogram[WHITE]) / number,
        "uniform_pixels_percent": 100.0 * float(histogram.max()) / number,
    }
