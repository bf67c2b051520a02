"""Scatter of a series of projections: Monte Carlo at a few tube angles, interpolated between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.blocks import cell_pixels
from mammosim.acquisition.coarse import CELL_MM
from mammosim.acquisition.recording import beam_for, scatter_case
from mammosim.acquisition.scatter import Scatter, ScatterCase, ScatterDose, follow_through
from mammosim.acquisition.scatter.photon_transport import PHOTONS, VOXEL_MM
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.projection import PathLengths, coarse_breast

MAX_STEP_DEG = 12.5
"""Largest angle between two tube positions at which photons are followed: scatter under a breast
of 50 mm shifts by 5 mm over it, and varies over centimetres."""

MAX_ANGLES = 5
SERIES_PHOTONS = 3
"""Photons of a series over those of one view, shared among the angles."""


@dataclass(frozen=True, eq=False)
class ScatterSweep:
    """A scatter model for the projections of one series, interpolated over the tube's angle.

    Parameters
    ----------
    angles_deg : ndarray of float64, (n,)
    found : tuple of Scatter
        What Monte Carlo found at each angle.
    """

    angles_deg: NDArray[np.float64]
    found: tuple[Scatter, ...]

    def __call__(self, case: ScatterCase) -> Scatter:
        """Scatter of one projection, by the polynomial through all angles."""
        weights = self.weights(case.gantry.tube_angle_deg)
        signal = sum(w * one.signal for w, one in zip(weights, self.found, strict=True))
        behind = None
        if all(one.behind_grid is not None for one in self.found):
            behind = np.maximum(
                sum(w * one.behind_grid for w, one in zip(weights, self.found, strict=True)), 0.0
            )
        noise = np.sqrt(
            sum((w * one.noise) ** 2 for w, one in zip(weights, self.found, strict=True))
        )
        return Scatter(
            np.maximum(signal, 0.0), behind, "", float(noise),
            sum(one.photons for one in self.found), self._dose(weights),
        )  # fmt: skip

    def weights(self, angle_deg: float) -> NDArray[np.float64]:
        """(n,) Lagrange's weights of the angles."""
        weights = np.ones(self.angles_deg.size)
        for k, here in enumerate(self.angles_deg):
            others = np.delete(self.angles_deg, k)
            weights[k] = np.prod((angle_deg - others) / (here - others))
        return weights

    def dose_factors(self, angles_deg: Sequence[float]) -> NDArray[np.float64]:
        """Glandular dose at tube angles over that of the upright tube, for the same load."""
        upright, *each = (
            self._dose(self.weights(angle)).gland_in_field_mgy_mas for angle in (0.0, *angles_deg)
        )
        return np.array(each) / upright if upright > 0.0 else np.ones(len(angles_deg))

    def _dose(self, weights: NDArray[np.float64]) -> ScatterDose:
        doses = [one.dose for one in self.found if one.dose is not None]

        def mix(values: list[float]) -> float:
            return float(np.dot(weights, values))

        materials = {
            name: mix([dose.material_mgy_mas[name] for dose in doses])
            for name in doses[0].material_mgy_mas
        }
        return ScatterDose(
            mix([dose.gland_mgy_mas for dose in doses]),
            mix([dose.gland_in_field_mgy_mas for dose in doses]),
            float(np.sqrt(np.sum((weights * [dose.gland_error for dose in doses]) ** 2))),
            materials,
            doses[0].core_glandularity_percent,
        )


def scatter_sweep(
    gantries: tuple[Gantry, ...],
    paths: PathLengths,
    breast: CompressedBreast | None,
    settings: AcquisitionSettings,
    seed: int,
) -> ScatterSweep | None:
    """Follow photons at a few of a series' angles; None where the model is another.

    Parameters
    ----------
    gantries : tuple of Gantry
        One a projection.
    paths : PathLengths
        Of any projection: its thickness chooses the tube's voltage.
    breast : CompressedBreast or None
    settings : AcquisitionSettings
    seed : int
    """
    if settings.scatter_model != "monte-carlo" or breast is None:
        return None
    given = [gantry.tube_angle_deg for gantry in gantries]
    detector = [gantry.detector_angle_deg for gantry in gantries]
    span = max(given) - min(given)
    count = 1 if span == 0.0 else min(max(int(np.ceil(span / MAX_STEP_DEG)) + 1, 3), MAX_ANGLES)
    angles = np.linspace(min(given), max(given), count)
    cell = cell_pixels(CELL_MM, gantries[0].pixel_mm)
    shape = (-(-gantries[0].rows // cell), -(-gantries[0].columns // cell))
    beam, found = beam_for(settings, paths), []
    copy = coarse_breast(breast, gantries[0], VOXEL_MM)
    for number, angle in enumerate(angles):
        gantry = replace(
            gantries[0], tube_angle_deg=float(angle),
            detector_angle_deg=float(np.interp(angle, given, detector)),
        )  # fmt: skip
        case = scatter_case(
            np.zeros(shape), np.zeros(shape), cell, gantry, beam, settings, breast,
            seed=seed + number,
        )  # fmt: skip
        photons = (case.photons or PHOTONS) * (SERIES_PHOTONS if count > 1 else 1) // count
        found.append(follow_through(replace(case, copy=copy, photons=photons)))
    return ScatterSweep(angles, tuple(found))
