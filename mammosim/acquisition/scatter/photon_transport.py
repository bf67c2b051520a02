"""The scatter model `monte-carlo`: photons followed through a coarse copy of the breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS
from mammosim.acquisition.monte_carlo import (
    Field,
    Guide,
    PhotonTables,
    Plates,
    Scene,
    Tallies,
    absorbed_energy,
    core_glandularity_percent,
    dose_map_mgy,
    follow,
    image_field,
    importance_of,
    make_scene,
    photon_tables,
    shadow_of,
    smoothed_scatter,
)
from mammosim.acquisition.scatter.convolution import scatter_by_kernels
from mammosim.acquisition.scatter.open_beam import spectrum_of, support_of
from mammosim.acquisition.scatter.scatter_case import DoseMap, Scatter, ScatterCase, ScatterDose
from mammosim.acquisition.scatter.scene_layers import shape_of_scatter
from mammosim.projection import coarse_breast

VOXEL_MM = 1.0
"""Edge of the coarse voxels, mm."""

PHOTONS = 160_000
"""Photons of a view: below 2 % noise in the breast after smoothing, in about a second."""

WITHOUT_BREAST = (
    "scatter: only path lengths are known, not the compressed breast; model kernels is used "
    "instead of monte-carlo"
)


def scatter_by_monte_carlo(case: ScatterCase) -> Scatter:
    """Follow photons through the breast, its plates and the air gap.

    Parameters
    ----------
    case : ScatterCase
        Without a breast, the model `kernels` runs, and a note says so.

    Raises
    ------
    InputError
        If a material has no scattering tables, the spectrum goes beyond them, or the breast is too
        large for the coarse copy.
    """
    if case.breast is None:
        by_kernels = scatter_by_kernels(case)
        return Scatter(by_kernels.signal, model="kernels", notes=(WITHOUT_BREAST,))
    return follow_through(case)


def follow_through(case: ScatterCase) -> Scatter:
    """Scatter and dose by following photons through the breast, paddle and support.

    Parameters
    ----------
    case : ScatterCase
        Exposure, with the compressed breast at hand.

    Returns
    -------
    Scatter
        Signal in front of the grid and, with a grid, behind it, keV/(pixel mAs), [row, column] of
        the case's cells; its standard error and the dose of each tissue.

    Notes
    -----
    The scores are smoothed relative to an expected shape, below the breast and beside it apart, so
    that the leak across its edge stays small. Photons are followed through a coarse copy of the
    breast: structures smaller than its voxels scatter like their mean.
    """
    scene, tables, tallies, spectrum = transported(case)
    guide = Guide(*shape_of_scatter(case, scene, tables, spectrum, tallies.margin), case.cell_mm)
    pixel_mm2 = case.gantry.pixel_mm**2
    mean, error = smoothed_scatter(tallies.scatter, tallies.margin, guide)
    behind = None
    if case.grid is not None:
        behind = smoothed_scatter(tallies.behind_grid, tallies.margin, guide)[0] * pixel_mm2
    m = tallies.margin
    inside = guide.below[m:-m, m:-m] & (mean > 0.0)
    noise = float(np.sqrt(np.mean((error[inside] / mean[inside]) ** 2))) if inside.any() else 0.0
    return Scatter(
        mean * pixel_mm2, behind, "", noise, tallies.photons, dose_of(case, scene, tables, tallies)
    )  # fmt: skip


def transported(case: ScatterCase) -> tuple[Scene, PhotonTables, Tallies, NDArray[np.float64]]:
    """The photons' scene, tables and tallies, and the spectrum they were drawn from."""
    scene = scene_of(case)
    lowest, highest = float(case.beam.energy_kev[0]), float(case.beam.energy_kev[-1])
    tables = photon_tables(scene.materials, lowest, highest)
    field = image_field(case.gantry, case.cell)
    shadow = shadow_of(scene, case.gantry, field)
    has_plates = case.paddle_mm > 0.0 or case.support_mm > 0.0
    importance = importance_of(shadow, case.cell_mm, has_plates)
    field = Field(field.row_y_mm, field.column_x_mm, importance)
    spectrum = spectrum_of(case, tables)
    tallies = follow(
        scene, tables, case.gantry, field, spectrum, case.detector,
        cell_mm=case.cell_mm, photons=case.photons or PHOTONS, seed=case.seed, grid=case.grid,
        mapped=case.dose_map,
    )  # fmt: skip
    return scene, tables, tallies, spectrum


def scene_of(case: ScatterCase) -> Scene:
    """Breast, paddle and support."""
    breast = case.breast
    assert breast is not None
    edge_mm = breast.plate_edge_mm - case.gantry.detector_edge_mm
    plates = Plates(
        BEAM_MATERIALS["polycarbonate"], support_of(case), case.paddle_mm, case.support_mm, edge_mm
    )
    copy = case.copy or coarse_breast(breast, case.gantry, VOXEL_MM)
    return make_scene(copy, plates, case.gantry, case.materials)


def dose_of(case: ScatterCase, scene: Scene, tables: PhotonTables, tallies: Tallies) -> ScatterDose:
    """Dose of each material for 1 mAs."""
    absorbed = absorbed_energy(tallies, scene, tables)
    gland, error = absorbed.dose_mgy("gland")
    dose_map = None
    if case.dose_map:
        space, inner = scene.space, scene.inner
        origin = [planes[part.start] for planes, part in zip(space[:3], inner, strict=True)]
        spacing = [
            planes[part.start + 1] - planes[part.start]
            for planes, part in zip(space[:3], inner, strict=True)
        ]
        dose_map = DoseMap(dose_map_mgy(tallies, scene), np.array(origin), np.array(spacing))
    names = [material.name for material in scene.materials[:-3]]
    return ScatterDose(
        gland, absorbed.dose_mgy("gland", in_field=True)[0],
        error / gland if gland > 0.0 else error,
        {name: absorbed.dose_mgy(name, in_field=True)[0] for name in names},
        core_glandularity_percent(scene), dose_map,
    )  # fmt: skip
