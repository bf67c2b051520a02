"""The signal: energy that primary photons leave in the detector, and its second moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import Rays, primary_kernel
from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.spectrum import Beam
from mammosim.geometry import Gantry
from mammosim.projection.paths import PathLengths
from mammosim.tissues import Material

MERGED_BIN_KEV = 0.5
"""Width of the energy bins of the sum over energies, keV."""


@dataclass(frozen=True, eq=False)
class Response:
    """What a unit of exposure leaves in one pixel behind nothing but air and support.

    Parameters
    ----------
    energy_kev : ndarray of float64, (n,)
        Mean energy of each bin, keV.
    energy_weight : ndarray of float64, (n,)
        Absorbed energy a bin, keV/(pixel mAs).
    square_weight : ndarray of float64, (n,)
        Its second moment over the Swank factor, keV2/(pixel mAs).
    """

    energy_kev: NDArray[np.float64]
    energy_weight: NDArray[np.float64]
    square_weight: NDArray[np.float64]

    @property
    def air_signal(self) -> float:
        """Signal of air on the central ray, keV/(pixel mAs)."""
        return float(self.energy_weight.sum())


def rays_of(gantry: Gantry) -> Rays:
    """Tangents of the pixels' rays; rows and columns separate because the detector is flat."""
    rows = gantry.detector_xy_mm(np.arange(gantry.rows), np.zeros(gantry.rows))
    columns = gantry.detector_xy_mm(np.zeros(gantry.columns), np.arange(gantry.columns))
    spot, distance = gantry.focal_spot_mm, gantry.source_to_detector_mm
    return Rays((rows[:, 1] - spot[1]) / distance, (columns[:, 0] - spot[0]) / distance)


def response(
    beam: Beam,
    detector: Detector,
    pixel_mm: float,
    distance_mm: float,
    support_mm: float,
    merged_bin_kev: float = MERGED_BIN_KEV,
) -> Response:
    """Weights of the sum over energies, in merged bins.

    Parameters
    ----------
    beam : Beam
    detector : Detector
    pixel_mm, distance_mm : float
        Pixel pitch and source to detector distance, mm.
    support_mm : float
        Carbon fibre of breast support and detector cover, mm.
    merged_bin_kev : float
        Width of the bins, keV; 0 keeps those of the beam.

    Notes
    -----
    Bins are merged so that absorbed energy and its second moment are kept, at their
    energy-weighted mean energy. Behind 5 cm of breast 0.5 keV instead of 0.25 keV changes the
    signal by less than 0.1 per cent.
    """
    energy = beam.energy_kev
    support = attenuation_per_mm(BEAM_MATERIALS["carbon fibre"], energy)
    photons = beam.fluence_at(distance_mm) * pixel_mm**2 * np.exp(-support * support_mm)
    photons *= detector.efficiency(energy)
    weight = photons * energy
    square = photons * energy**2 / detector.swank
    if merged_bin_kev == 0.0:
        return Response(energy, weight, square)
    label = np.floor(energy / merged_bin_kev).astype(np.int64)
    label -= label.min()
    merged = _sums(label, weight)
    used = merged > 0.0
    mean = _sums(label, weight * energy)[used] / merged[used]
    return Response(mean, merged[used], _sums(label, square)[used])


def _sums(label: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of the weights of each label."""
    return np.bincount(label, weight).astype(np.float64)


def primary(
    paths: PathLengths, materials: Mapping[str, Material], unit: Response
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Energy that primary photons leave in each pixel, and its second moment.

    Parameters
    ----------
    paths : PathLengths
    materials : mapping of str to Material
        What each material of `paths` is made of.
    unit : Response

    Returns
    -------
    signal, square : ndarray of float32, [row, column]
        keV/(pixel mAs) and keV2/(pixel mAs).

    Notes
    -----
    ``cos^3(theta) sum_E N(E) eta(E) E exp(-sum_t mu_t(E) l_t)``, N on the central ray. Paddle,
    support and converter are counted at normal incidence for all rays (8 per cent more path in
    the far corner of a 24 x 30 cm detector).
    """
    mu = np.stack(
        [attenuation_per_mm(materials[name], unit.energy_kev) for name in paths.materials], axis=1
    )
    shape = paths.attenuating_mm.shape[1:]
    signal, square = np.empty(shape, np.float32), np.empty(shape, np.float32)
    primary_kernel(
        paths.attenuating_mm, np.ascontiguousarray(mu), unit.energy_weight, unit.square_weight,
        rays_of(paths.gantry), signal, square,
    )  # fmt: skip
    return signal, square
