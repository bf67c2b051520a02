"""Path lengths on a coarse grid, and how dense the breast is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.blocks import block_mean, cell_pixels
from mammosim.projection import PathLengths
from mammosim.tissues import FOREIGN_MATERIALS, Material

CELL_MM = 2.0  # scatter decays over 3 mm and more
NOT_BREAST = ("muscle", *FOREIGN_MATERIALS)
NOT_PARENCHYMA = (*NOT_BREAST, "skin")


@dataclass(frozen=True, eq=False)
class CoarsePaths:
    """Mean path lengths of each cell, and shares of the whole breast.

    Parameters
    ----------
    cell : int
        Pixels along the side of a cell.
    cell_mm : float
        Side of a cell on the detector, mm.
    tissue_mm, muscle_mm : ndarray of float64, [row, column]
        Mean path through all tissue, and through muscle, mm.
    inside : ndarray of bool, [row, column]
        Cells with tissue through more than half of the gap between the plates.
    density_percent : float
        Volume of gland over that of all tissue but muscle and what is foreign to the breast, per
        cent; NaN without breast.
    glandularity_percent : float
        Mass of all but fat over the mass inside the skin, muscle left out, per cent; that is the
        glandularity of dose tables.
    """

    cell: int
    cell_mm: float
    tissue_mm: NDArray[np.float64]
    muscle_mm: NDArray[np.float64]
    inside: NDArray[np.bool_]
    density_percent: float
    glandularity_percent: float


def coarse_paths(paths: PathLengths, materials: Mapping[str, Material]) -> CoarsePaths:
    """Average path lengths over cells of about 2 mm, one channel after the other.

    Parameters
    ----------
    paths : PathLengths
    materials : mapping of str to Material
    """
    cell = cell_pixels(CELL_MM, paths.pixel_mm)
    means = [block_mean(channel, cell) for channel in paths.length_mm]
    zero = np.zeros((-(-paths.gantry.rows // cell), -(-paths.gantry.columns // cell)))
    tissue_mm = sum(means, start=zero)
    muscle = [mean for mean, name in zip(means, paths.materials, strict=True) if name == "muscle"]
    volume: dict[str, float] = {}
    for name, mean in zip(paths.materials, means, strict=True):
        volume[name] = volume.get(name, 0.0) + float(mean.sum())
    breast = sum(v for name, v in volume.items() if name not in NOT_BREAST)
    mass = {
        name: v * materials[name].density_g_cm3
        for name, v in volume.items()
        if name not in NOT_PARENCHYMA
    }
    return CoarsePaths(
        cell,
        cell * paths.pixel_mm,
        tissue_mm,
        sum(muscle, start=zero),
        tissue_mm > 0.5 * min(paths.thickness_mm, float(tissue_mm.max())),
        _percent(volume.get("gland", 0.0), breast),
        100.0 - _percent(mass.get("adipose", 0.0), sum(mass.values())),
    )


def _percent(part: float, whole: float) -> float:
    return 100.0 * part / whole if whole > 0.0 else float("nan")
