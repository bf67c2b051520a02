"""Contrast-enhanced mammography: the high-energy exposure, and the image of iodine."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import add_scatter_kernel, log_attenuation_kernel
from mammosim.acquisition.attenuation import attenuation_per_mm, cross_section_cm2_g
from mammosim.acquisition.blocks import block_mean
from mammosim.acquisition.contrast_agent import MG_PER_G
from mammosim.acquisition.exposure import MAX_CONTROLLED_MAS
from mammosim.acquisition.grid_parts import scatter_behind_grid
from mammosim.acquisition.iodine_background import flattened
from mammosim.acquisition.mammogram import IodineImage
from mammosim.acquisition.recording import DetectorInput, Exposure
from mammosim.acquisition.settings import AcquisitionSettings, ContrastSettings
from mammosim.acquisition.signal import rays_of
from mammosim.tissues import Material, composition

DOSE_OF_LOW_ENERGY = 0.43
"""Glandular dose of the high-energy exposure over that of the low-energy one: 23 to 36 per cent of
both together in 348 examinations (Gennaro et al. 2022, Cancers 14:1774); the middle is taken."""

GLAND_SHARES = (0.0, 0.5)
"""Glandular fractions at which a breast without iodine is made equally bright: few are denser
(Yaffe et al. 2009, Med Phys 36:5437: 95 per cent of breasts below 45 per cent)."""

IODINE = Material("iodine", 4.93, {"I": 1.0}, "element")
"""Solid iodine; only its attenuation per mass is used, so that the density does not matter."""

TEST_MG_CM2 = 1.0
"""Iodine by which the sensitivity is found, as in test phantoms of 1 mg/cm2."""


def high_energy_settings(
    settings: AcquisitionSettings, agent: ContrastSettings
) -> AcquisitionSettings:
    """Settings of the high-energy exposure: another filter, voltage and load, the rest the same."""
    return settings.model_copy(
        update={
            "filter": agent.filter, "filter_mm": agent.filter_mm, "kvp": agent.kvp,
            "mas": agent.mas, "spectrum_file": None,
        }
    )  # fmt: skip


def high_energy_mas(agent: ContrastSettings, low_dose_mgy: float, dose_mgy_mas: float) -> float:
    """The tube load that is set, or that gives the usual part of the low-energy dose, mAs."""
    if agent.mas is not None:
        return agent.mas
    return min(DOSE_OF_LOW_ENERGY * low_dose_mgy / dose_mgy_mas, MAX_CONTROLLED_MAS)


def primary_attenuation(
    incident: DetectorInput, signal: NDArray[np.float32], exposure: Exposure
) -> NDArray[np.float32]:
    """ln(signal of air / signal) of a recorded signal, keV/pixel, less its mean scatter.

    Real units estimate the scatter, which is smooth, from the image. Here the scatter that was
    computed is subtracted, so that only its noise is left.
    """
    cell = incident.coarse.cell
    scatter = scatter_behind_grid(incident.scatter, incident.settings, incident.coarse.inside)
    primary = signal.copy()
    add_scatter_kernel(
        scatter * exposure.mas, float(cell), 1.0, -1.0, primary, np.zeros_like(primary)
    )
    log_attenuation_kernel(
        primary, exposure.air_signal * incident.unit.air_profile, incident.unit.weights.mean_depth,
        rays_of(incident.paths.gantry), primary,
    )  # fmt: skip
    return primary


def recombine(
    low: DetectorInput,
    high: DetectorInput,
    low_attenuation: NDArray[np.float32],
    high_attenuation: NDArray[np.float32],
) -> IodineImage:
    """Recombine two exposures to the iodine on each ray.

    Parameters
    ----------
    low, high : DetectorInput
        What reached the detector in each exposure.
    low_attenuation, high_attenuation : ndarray of float32, [row, column]
        From `primary_attenuation`. The latter is overwritten with the result.

    Returns
    -------
    IodineImage

    Notes
    -----
    ``iodine = (A_high - w A_low - A_0) / s``. The weight w makes breasts of no gland and of half
    gland alike at the thickness of this one, s is the change for 1 mg/cm2 of iodine between them,
    both with beam hardening; A_0 is the median over the breast without its margin, so that the
    breast's middle is zero. Where the breast is thinner its own attenuation does not cancel: the
    margin is not zero. What is shown to a reader is flattened.
    """
    weight, sensitivity = _weights(low, high)
    iodine = high_attenuation
    iodine -= np.float32(weight) * low_attenuation
    inside = high.coarse.inside
    middle = block_mean(iodine, high.coarse.cell)[inside]
    iodine -= np.float32(np.median(middle) if middle.size else 0.0)
    iodine /= np.float32(sensitivity)
    shown = flattened(iodine, low_attenuation, low.paths.pixel_mm, low.paths.thickness_mm)
    return IodineImage(iodine, shown, weight, sensitivity)


def _weights(low: DetectorInput, high: DetectorInput) -> tuple[float, float]:
    """Weight of the low-energy image, and change of the result for 1 mg/cm2 of iodine."""
    settings = low.settings
    materials = composition(settings.composition, settings.calcification)
    thickness_mm = low.paths.thickness_mm
    half = 0.5 * sum(GLAND_SHARES)
    without, with_iodine = [], []
    tissue = []
    for incident in (low, high):
        lean, dense = (_attenuation(incident, materials, thickness_mm, g) for g in GLAND_SHARES)
        tissue.append(dense - lean)
        without.append(_attenuation(incident, materials, thickness_mm, half))
        with_iodine.append(_attenuation(incident, materials, thickness_mm, half, TEST_MG_CM2))
    weight = tissue[1] / tissue[0]
    change = [after - before for before, after in zip(without, with_iodine, strict=True)]
    return weight, (change[1] - weight * change[0]) / TEST_MG_CM2


def _attenuation(
    incident: DetectorInput,
    materials: Mapping[str, Material],
    thickness_mm: float,
    gland: float,
    iodine_mg_cm2: float = 0.0,
) -> float:
    """Attenuation of a slab of gland and fat under a beam."""
    energy, weight = incident.unit.energy_kev, incident.unit.energy_weight[0]
    mu = sum(
        share * attenuation_per_mm(materials[name], energy)
        for name, share in (("gland", gland), ("adipose", 1.0 - gland))
    )
    depth = mu * thickness_mm
    depth += cross_section_cm2_g("CS_Total", IODINE, energy) * iodine_mg_cm2 / MG_PER_G
    return float(np.log(weight.sum() / (weight @ np.exp(-depth))))
