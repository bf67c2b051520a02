"""Input and output of a scatter model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.monte_carlo import Grid
from mammosim.acquisition.spectrum import Beam
from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.projection import CoarseBreast
from mammosim.tissues import Material


@dataclass(frozen=True, eq=False)
class ScatterCase:
    """An exposure as a scatter model sees it, on a grid of square cells of pixels.

    Parameters
    ----------
    primary : ndarray of float64, [row, column]
        Mean primary signal of the pixels of each cell, in front of the grid, keV/(pixel mAs).
    thickness_mm : ndarray of float64, [row, column]
        Mean path through all tissue, mm.
    cell : int
        Pixels along the side of a cell. Cells at the last row and column may be cut by the edge.
    gantry : Gantry
        Focal spot, support, detector and pixels.
    beam : Beam
        Photons as they leave the paddle; `layers_mm` says what they have crossed.
    detector : Detector
        What absorbs them.
    support_mm : float
        Carbon fibre of breast support and detector cover, mm.
    materials : mapping of str to Material
        Composition and density of each material of the tissue table.
    breast : CompressedBreast or None
        The voxels; None where only path lengths are known.
    copy : CoarseBreast or None
        Coarse copy of the breast, where one has been made for this detector already.
    support : Material or None
        What the support is made of; None for carbon fibre.
    paddle_mm : float
        Polycarbonate of the paddle, mm; the beam has crossed it.
    grid : Grid or None
        The anti-scatter grid; None where there is none.
    heel : bool
        Whether the beam weakens towards the anode.
    photons : int or None
        Photons that Monte Carlo follows; None for its default.
    seed : int
        Seed of Monte Carlo's random numbers.
    dose_map : bool
        Whether the dose of every voxel is wanted.
    """

    primary: NDArray[np.float64]
    thickness_mm: NDArray[np.float64]
    cell: int
    gantry: Gantry
    beam: Beam
    detector: Detector
    support_mm: float
    materials: Mapping[str, Material]
    breast: CompressedBreast | None = None
    copy: CoarseBreast | None = None
    support: Material | None = None
    paddle_mm: float = 0.0
    grid: Grid | None = None
    heel: bool = False
    photons: int | None = None
    seed: int = 1
    dose_map: bool = False

    @property
    def cell_mm(self) -> float:
        """Side of a cell on the detector, mm."""
        return self.cell * self.gantry.pixel_mm


@dataclass(frozen=True, eq=False)
class DoseMap:
    """Absorbed dose of each voxel of the coarse breast.

    Parameters
    ----------
    mgy : ndarray of float32, [x, y, z]
        Absorbed dose, mGy (per mAs in a `ScatterDose`); 0 in air.
    origin_mm : ndarray, (3,)
        Lowest corner, **gantry frame**, mm.
    spacing_mm : ndarray, (3,)
        Edges of a voxel, mm.
    """

    mgy: NDArray[np.float32]
    origin_mm: NDArray[np.float64]
    spacing_mm: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScatterDose:
    """Dose that a scatter model found, for 1 mAs.

    Parameters
    ----------
    gland_mgy_mas, gland_in_field_mgy_mas : float
        Mean dose of all gland in the breast's copy, and of that in the beam, mGy/mAs.
    gland_error : float
        Standard error of the former over itself.
    material_mgy_mas : mapping of str to float
        Mean dose of each material in the beam, mGy/mAs.
    core_glandularity_percent : float
        Mass of all but fat over the mass of the breast under 5 mm of skin and fat, per cent; NaN
        where it is not known.
    dose_map : DoseMap or None
        For 1 mAs.
    """

    gland_mgy_mas: float
    gland_in_field_mgy_mas: float
    gland_error: float
    material_mgy_mas: Mapping[str, float]
    core_glandularity_percent: float = float("nan")
    dose_map: DoseMap | None = None


@dataclass(frozen=True, eq=False)
class Scatter:
    """What a scatter model found, for 1 mAs.

    Parameters
    ----------
    signal : ndarray of float64, [row, column]
        Mean scatter signal of the pixels of each cell in front of the grid, keV/(pixel mAs); not
        negative.
    behind_grid : ndarray of float64, [row, column], or None
        The same behind the grid, where the model follows photons through it.
    model : str
        Name of the model that ran, where it is another than the one asked for.
    noise : float
        Standard error of the signal over itself, root mean square over the breast; NaN where the
        model has none.
    photons : int
        Photons that were followed.
    dose : ScatterDose or None
    notes : tuple of str
        Warnings, one sentence each.
    """

    signal: NDArray[np.float64]
    behind_grid: NDArray[np.float64] | None = None
    model: str = ""
    noise: float = float("nan")
    photons: int = 0
    dose: ScatterDose | None = None
    notes: tuple[str, ...] = ()
