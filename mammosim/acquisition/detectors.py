"""Detectors: what they absorb, how they blur, and what noise they add."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS, absorbed_fraction, attenuation_per_mm
from mammosim.errors import InputError


@dataclass(frozen=True)
class Detector:
    """An energy-integrating flat-panel detector.

    Parameters
    ----------
    name : str
    material : str
        Converter, a name of `BEAM_MATERIALS`; None for one that records all energy.
    thickness_mm : float
        Converter's thickness at full density, mm.
    swank : float
        Swank factor: how much the spread of charge a photon lets loose adds to quantum noise.
    blur_mm, blur_mm2, blur_sigma_mm : float
        Converter's transfer function without the pixel's aperture,
        ``exp(-2 (pi sigma f)^2) / (1 + blur_mm f + blur_mm2 f^2)``, f in 1/mm.
    electronic_noise_kev : float
        Standard deviation of electronic noise a pixel, as absorbed energy, keV.
    structure_noise : float
        Standard deviation of what flat-fielding leaves of the fixed pattern, as part of the signal.
    """

    name: str
    material: str | None
    thickness_mm: float
    swank: float
    blur_mm: float
    blur_mm2: float
    blur_sigma_mm: float
    electronic_noise_kev: float
    structure_noise: float

    def efficiency(self, energy_kev: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) fraction of the photons whose energy is recorded, at right angles."""
        return self.oblique_efficiency(energy_kev, np.ones(1))[:, 0]

    def oblique_efficiency(
        self, energy_kev: NDArray[np.float64], cosine: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """[energy, cosine] the same for photons that come in at an angle to the normal."""
        if self.material is None:
            return np.ones((energy_kev.size, cosine.size))
        material = BEAM_MATERIALS[self.material]
        return absorbed_fraction(material, self.thickness_mm / cosine, energy_kev)

    def oblique_gain(self, energy_kev: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) relative gain of efficiency for each part by which a slant lengthens the way.

        ``d ln(1 - exp(-mu t s)) / ds`` at s = 1: exact to first order in 1 / cos - 1, which is
        below 0.1 for primary photons.
        """
        if self.material is None:
            return np.zeros(energy_kev.size)
        depth = attenuation_per_mm(BEAM_MATERIALS[self.material], energy_kev) * self.thickness_mm
        return np.asarray(depth / np.expm1(depth))

    def transfer(self, frequency_per_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Converter's modulation transfer function, without the pixel's aperture."""
        f2 = frequency_per_mm**2
        gauss = np.exp(-2.0 * (np.pi * self.blur_sigma_mm) ** 2 * f2)
        return gauss / (1.0 + self.blur_mm * frequency_per_mm + self.blur_mm2 * f2)


# Selenium: 200 um, 50 eV a pair and Swank 0.99 are VICTRE's (Badano et al. 2018). sigma 0.018 mm
# makes the whole MTF of a 70 um pixel 0.46 at Nyquist, as measured detectors have above 0.40
# (Marshall, Monnin et al. 2011). Electronic noise of 130 keV (2600 electrons) a pixel lets the DQE
# of 85 um pixels fall by a fifth from 6 to 0.4 mR, as Zhao, Zhao & co-workers measured (2008, Med
# Phys 35:1978); with VICTRE's 5200 electrons it would fall by half. Pixels of 70 um are taken to
# have the same.
_SELENIUM = Detector(
    name="a-Se-70",
    material="Se",
    thickness_mm=0.200,
    swank=0.99,
    blur_mm=0.0,
    blur_mm2=0.0,
    blur_sigma_mm=0.018,
    electronic_noise_kev=130.0,
    structure_noise=0.002,
)

DETECTORS: MappingProxyType[str, Detector] = MappingProxyType(
    {
        detector.name: detector
        for detector in (
            _SELENIUM,
            replace(_SELENIUM, name="a-Se-85"),
            # Vedantham et al. 2000, Med Phys 27:558, on a prototype of 100 um pixels. MTF 0.73,
            # 0.42, 0.28 at 2, 4, 5 per mm, divided by the aperture's sinc (0.935, 0.757, 0.637)
            # and fitted: within 0.03. DQE near frequency 0 for Mo/Mo 28 kV behind 45 mm Lucite of
            # 0.55 at 32.8 mR and 0.40 at 1.3 mR: thickness at full density, Swank factor and
            # electronic noise, which makers do not publish, give 0.55 and 0.42.
            Detector("CsI-100", "CsI", 0.100, 0.87, 0.0815, 0.0298, 0.0, 260.0, 0.002),
            # Records the energy of every photon, for comparisons with other programs.
            Detector("ideal", None, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        )
    }
)
"""Detectors by name; the name's number is the usual pixel in um, any pixel may be used."""
# Structure noise: an assumption; flat-fielded systems stay below the 2 per cent of the European
# guidelines' SNR homogeneity, and below quantum noise at clinical exposures.


def find_detector(name: str) -> Detector:
    """A detector by name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in DETECTORS:
        raise InputError(
            f"acquisition.detector: found '{name}', expected one of {', '.join(DETECTORS)}"
        )
    return DETECTORS[name]
