"""The scatter model `monte-carlo`: photons followed through a coarse copy of the breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.heel import heel_ratio
from mammosim.acquisition.monte_carlo import (
    Field,
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
    on_energies,
    photon_tables,
    shadow_of,
    smoothed_scatter,
)
from mammosim.acquisition.scatter.convolution import scatter_by_kernels
from mammosim.acquisition.scatter.scatter_case import DoseMap, Scatter, ScatterCase, ScatterDose
from mammosim.compression import CompressedBreast
from mammosim.projection import coarse_breast

VOXEL_MM = 1.0
"""Edge of the coarse voxels, mm."""

PHOTONS = 200_000
"""Photons of a view: about 2 % noise in the breast after smoothing, in about a second."""

WITHOUT_BREAST = (
    "scatter: only path lengths are known, not the compressed breast, so that model kernels is "
    "used in place of monte-carlo"
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
    return follow_through(case, case.breast)


def follow_through(case: ScatterCase, breast: CompressedBreast) -> Scatter:
    """The model with a breast at hand."""
    scene = scene_of(case, breast)
    lowest, highest = float(case.beam.energy_kev[0]), float(case.beam.energy_kev[-1])
    tables = photon_tables(scene.materials, lowest, highest)
    field = image_field(case.gantry, case.cell)
    shadow = shadow_of(scene, case.gantry, field)
    has_plates = case.paddle_mm > 0.0 or case.support_mm > 0.0
    importance = importance_of(shadow, case.cell_mm, has_plates)
    field = Field(field.row_y_mm, field.column_x_mm, importance)
    tallies = follow(
        scene, tables, case.gantry, field, spectrum_of(case, tables, field), case.detector,
        cell_mm=case.cell_mm, photons=case.photons or PHOTONS, seed=case.seed, grid=case.grid,
        mapped=case.dose_map,
    )  # fmt: skip
    pixel_mm2 = case.gantry.pixel_mm**2
    mean, error = smoothed_scatter(tallies.scatter, tallies.margin, case.cell_mm)
    behind = None
    if case.grid is not None:
        behind = smoothed_scatter(tallies.behind_grid, tallies.margin, case.cell_mm)[0] * pixel_mm2
    inside = shadow & (mean > 0.0)
    noise = float(np.sqrt(np.mean((error[inside] / mean[inside]) ** 2))) if inside.any() else 0.0
    return Scatter(
        mean * pixel_mm2, behind, "", noise, tallies.photons,
        dose_of(case, scene, tables, tallies), (),
    )  # fmt: skip


def scene_of(case: ScatterCase, breast: CompressedBreast) -> Scene:
    """Breast, paddle and support."""
    support = case.support or BEAM_MATERIALS["carbon fibre"]
    edge_mm = breast.plate_edge_mm - case.gantry.detector_edge_mm
    plates = Plates(
        BEAM_MATERIALS["polycarbonate"], support, case.paddle_mm, case.support_mm, edge_mm
    )
    return make_scene(
        coarse_breast(breast, case.gantry, VOXEL_MM), plates, case.gantry, case.materials
    )


def spectrum_of(case: ScatterCase, tables: PhotonTables, field: Field) -> NDArray[np.float64]:
    """[column or 1, energy] photons per mm2 and mAs on the detector's plane, but for the plates."""
    beam, height = case.beam, case.gantry.focal_spot_height_mm
    paddle = attenuation_per_mm(BEAM_MATERIALS["polycarbonate"], beam.energy_kev)
    fluence = (beam.fluence_at(height) * np.exp(paddle * case.paddle_mm))[None]
    if case.heel:
        middle = 0.5 * (field.column_x_mm[1:] + field.column_x_mm[:-1])
        tangent = (middle - case.gantry.focal_spot_mm[0]) / height
        fluence = fluence * heel_ratio(beam.target, beam.kvp, beam.energy_kev, tangent)
    return on_energies(beam.energy_kev, fluence, tables)


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
