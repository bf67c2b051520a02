"""The beam without a breast, in a few energies: what the layered scatter starts from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.heel import heel_ratio
from mammosim.acquisition.monte_carlo import PhotonTables, on_energies
from mammosim.acquisition.scatter.layered import CellGrid, Layer, emission_of
from mammosim.acquisition.scatter.scatter_case import ScatterCase
from mammosim.tissues import Material

GROUPS = 3
"""Groups of energies that leave the same energy behind the breast."""


@dataclass(frozen=True, eq=False)
class OpenBeam:
    """Recorded energy of photons that have crossed everything but the breast.

    Parameters
    ----------
    energy_kev : ndarray of float64, (group,)
        Mean energy of each group behind the breast.
    signal : ndarray of float64, [group, row, column]
        keV/(mm2 mAs) in each cell; 0 in the margin, where no beam goes.
    """

    energy_kev: NDArray[np.float64]
    signal: NDArray[np.float64]


def support_of(case: ScatterCase) -> Material:
    """What the support is made of."""
    return case.support or BEAM_MATERIALS["carbon fibre"]


def spectrum_of(case: ScatterCase, tables: PhotonTables) -> NDArray[np.float64]:
    """[column of cells or 1, energy] photons per mm2 and mAs on the detector's plane.

    As of a beam that has crossed all the air but neither paddle nor support.

    Parameters
    ----------
    case : ScatterCase
    tables : PhotonTables
        Their energies are used.
    """
    beam, height = case.beam, case.gantry.focal_spot_height_mm
    paddle = attenuation_per_mm(BEAM_MATERIALS["polycarbonate"], beam.energy_kev)
    fluence = (beam.fluence_at(height) * np.exp(paddle * case.paddle_mm))[None]
    if case.heel:
        edges = np.minimum(np.arange(case.primary.shape[1] + 1) * case.cell, case.gantry.columns)
        middle = 0.5 * (edges[1:] + edges[:-1]) - 0.5
        x = case.gantry.detector_xy_mm(np.zeros(middle.size), middle)[:, 0]
        tangent = (x - case.gantry.focal_spot_mm[0]) / height
        fluence = fluence * heel_ratio(beam.target, beam.kvp, beam.energy_kev, tangent)
    return on_energies(beam.energy_kev, fluence, tables)


def cell_grid(case: ScatterCase, margin: int) -> CellGrid:
    """The case's cells with a margin of so many on each side."""
    spot = case.gantry.focal_spot_above_detector_mm
    row, column = (
        float(pixel + 0.5) / case.cell - 0.5 + margin
        for pixel in case.gantry.pixel_of(spot[0], spot[1])
    )
    return CellGrid(case.cell_mm, row, column, case.gantry.focal_spot_height_mm)


def open_beam(
    case: ScatterCase,
    tables: PhotonTables,
    spectrum: NDArray[np.float64],
    breast_depth: NDArray[np.float64],
    margin: int,
) -> OpenBeam:
    """The beam of a case behind its plates.

    Parameters
    ----------
    case : ScatterCase
    tables : PhotonTables
    spectrum : ndarray of float64, [column or 1, energy]
        From `spectrum_of`.
    breast_depth : ndarray of float64, (energy,)
        Optical depth of a typical way through the breast.
    margin : int
        Cells on each side that the beam does not reach.
    """
    energy = tables.energy_kev
    plates = case.paddle_mm * attenuation_per_mm(BEAM_MATERIALS["polycarbonate"], energy)
    plates += case.support_mm * attenuation_per_mm(support_of(case), energy)
    recorded = spectrum * energy * np.exp(-plates) * case.detector.efficiency(energy)
    behind = recorded.mean(axis=0) * np.exp(-breast_depth)
    group = np.minimum(np.cumsum(behind) / behind.sum() * GROUPS, GROUPS - 1).astype(np.intp)
    belongs = (group[:, None] == np.arange(GROUPS)).astype(np.float64)
    grid, shape = cell_grid(case, 0), case.primary.shape
    cosine = 1.0 / np.sqrt(1.0 + grid.tangent((shape[0], shape[1])) ** 2)
    by_column = (recorded @ belongs).T  # [group, column or 1]
    signal = np.pad(by_column[:, None, :] * cosine**3, ((0, 0), (margin, margin), (margin, margin)))
    return OpenBeam((behind * energy) @ belongs / (behind @ belongs), signal)


def plates_around(
    case: ScatterCase, beam: OpenBeam, breast: Sequence[Layer], gap_mm: float
) -> list[Layer]:
    """Layers of the breast with those of support and paddle, where there are any.

    Parameters
    ----------
    case : ScatterCase
    beam : OpenBeam
    breast : sequence of Layer
        From the lowest to the highest.
    gap_mm : float
        Between the plates' faces, mm.
    """
    support_face = case.gantry.support_to_detector_mm

    def plate(material: Material, thickness_mm: float, lower_face_mm: float) -> list[Layer]:
        if thickness_mm == 0.0:
            return []
        depth = attenuation_per_mm(material, beam.energy_kev) * thickness_mm
        return [
            Layer(
                lower_face_mm + 0.5 * thickness_mm,
                np.broadcast_to(depth[:, None, None], beam.signal.shape),
                emission_of([(material, 1.0)], beam.energy_kev, case.detector), plate=True,
            )
        ]  # fmt: skip

    below = plate(support_of(case), case.support_mm, support_face - case.support_mm)
    paddle = BEAM_MATERIALS["polycarbonate"]
    return [*below, *breast, *plate(paddle, case.paddle_mm, support_face + gap_mm)]
