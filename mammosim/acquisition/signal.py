"""The signal: energy that primary photons leave in the detector, and its second moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import Rays, Weights, primary_kernel
from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.heel import heel_ratio
from mammosim.acquisition.spectrum import Beam
from mammosim.geometry import Gantry
from mammosim.projection import PathLengths
from mammosim.tissues import Material

MERGED_BIN_KEV = 0.5
"""Width of the energy bins of the sum over energies, keV."""


@dataclass(frozen=True, eq=False)
class Response:
    """What a unit of exposure leaves in one pixel behind nothing but air, paddle and support.

    Parameters
    ----------
    energy_kev : ndarray of float64, (n,)
        Mean energy of each bin, keV.
    energy_weight : ndarray of float64, [column or 1, n]
        Absorbed energy a bin, keV/(pixel mAs), for rays at right angles to the detector; one row
        for all columns of pixels without heel effect.
    square_weight : ndarray of float64, [column or 1, n]
        Its second moment over the Swank factor, keV2/(pixel mAs).
    flat_depth : ndarray of float64, (n,)
        Attenuation ``mu t`` of the flat layers in the way of a ray at right angles to them, less
        what the converter gains: both grow with the length of an oblique way.
    """

    energy_kev: NDArray[np.float64]
    energy_weight: NDArray[np.float64]
    square_weight: NDArray[np.float64]
    flat_depth: NDArray[np.float64]

    @property
    def air_signal(self) -> float:
        """Signal of air where it is brightest, for a ray at right angles, keV/(pixel mAs)."""
        return float(self.energy_weight.sum(axis=1).max())

    @property
    def air_profile(self) -> NDArray[np.float64]:
        """[column or 1] signal of air over `air_signal`."""
        return self.energy_weight.sum(axis=1) / self.air_signal

    @property
    def weights(self) -> Weights:
        """The same for the compiled loops."""
        mean_depth = float(np.average(self.flat_depth, weights=self.energy_weight[0]))
        return Weights(self.energy_weight, self.square_weight, self.flat_depth, mean_depth)


def rays_of(gantry: Gantry) -> Rays:
    """Tangents of the pixels' rays; rows and columns separate because the detector is flat."""
    rows = gantry.detector_xy_mm(np.arange(gantry.rows), np.zeros(gantry.rows))
    columns = gantry.detector_xy_mm(np.zeros(gantry.columns), np.arange(gantry.columns))
    spot, height = gantry.focal_spot_above_detector_mm, gantry.focal_spot_height_mm
    turn = gantry.detector_turn
    return Rays(
        (rows[:, 1] - spot[1]) / height, (columns[:, 0] - spot[0]) / height,
        turn.cosine, turn.sine,
    )  # fmt: skip


def response(
    beam: Beam,
    detector: Detector,
    gantry: Gantry,
    support_mm: float,
    *,
    support_material: str = "carbon fibre",
    heel: bool = False,
    merged_bin_kev: float = MERGED_BIN_KEV,
) -> Response:
    """Weights of the sum over energies, in merged bins.

    Parameters
    ----------
    beam : Beam
    detector : Detector
    gantry : Gantry
        Pixel pitch, and place of the focal spot.
    support_mm : float
        Breast support and detector cover, mm.
    support_material : str
        What they are made of, a name of `BEAM_MATERIALS`.
    heel : bool
        Whether the beam weakens towards the anode.
    merged_bin_kev : float
        Width of the bins, keV; 0 keeps those of the beam.

    Notes
    -----
    Bins are merged so that absorbed energy and its second moment are kept, at their
    energy-weighted mean energy. Behind 5 cm of breast 0.5 keV instead of 0.25 keV changes the
    signal by less than 0.1 per cent.
    """
    energy = beam.energy_kev
    support = attenuation_per_mm(BEAM_MATERIALS[support_material], energy) * support_mm
    flat = support + sum(
        attenuation_per_mm(BEAM_MATERIALS[name], energy) * length
        for name, length in beam.layers_mm.items()
    )
    photons = beam.fluence_at(gantry.focal_spot_height_mm) * gantry.pixel_mm**2 * np.exp(-support)
    photons *= detector.efficiency(energy)
    flat = flat - detector.oblique_gain(energy)  # a slant also lengthens the way in the converter
    by_column = photons[None]
    if heel:
        tangent = rays_of(gantry).column_tangent
        by_column = photons * heel_ratio(beam.target, beam.kvp, energy, tangent)
    weight = by_column * energy
    square = by_column * energy**2 / detector.swank
    if merged_bin_kev == 0.0:
        return Response(energy, weight, square, flat)
    # [bin, merged bin], one where the former belongs to the latter
    label = np.floor(energy / merged_bin_kev).astype(np.int64)
    belongs = (label[:, None] == np.unique(label)).astype(np.float64)
    share = photons * energy @ belongs
    used = share > 0.0
    belongs, share = belongs[:, used], share[used]
    mean = (photons * energy**2) @ belongs / share
    depth = (photons * energy * flat) @ belongs / share
    return Response(mean, weight @ belongs, square @ belongs, depth)


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
    ``cos^3(theta) sum_E N(E) eta(E) E exp(-sum_t mu_t(E) l_t - d(E) (1 / cos(theta) - 1))``, N for
    a ray at right angles to the detector, d the depth of paddle, support and air less the
    converter's gain (`Detector.oblique_gain`).
    """
    mu = np.stack(
        [attenuation_per_mm(materials[name], unit.energy_kev) for name in paths.materials], axis=1
    )
    shape = paths.attenuating_mm.shape[1:]
    signal, square = np.empty(shape, np.float32), np.empty(shape, np.float32)
    primary_kernel(
        paths.attenuating_mm, np.ascontiguousarray(mu), unit.weights, rays_of(paths.gantry),
        signal, square,
    )  # fmt: skip
    return signal, square
