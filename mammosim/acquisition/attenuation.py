"""Attenuation and energy absorption of materials, from xraylib's tables.

Two of its functions are not used. `CS_Total_Kissel` of version 4.3.0 returns 0.236 and 0.601 cm2/g
for carbon and oxygen at 20 keV, where NIST's XCOM has 0.442 and 0.865. `CS_Energy` is 34 per cent
low for air at 20 keV (0.355 instead of 0.539 cm2/g), so energy transfer is put together here.
"""

from __future__ import annotations

from functools import cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError
from mammosim.tissues import Material

MM_PER_CM = 10.0
ELECTRON_REST_KEV = 510.999  # CODATA 2018


def _beam_material(name: str, density: float, percent: dict[str, float], source: str) -> Material:
    total = sum(percent.values())
    fractions = MappingProxyType({symbol: part / total for symbol, part in percent.items()})
    return Material(name, density, fractions, source)


BEAM_MATERIALS: MappingProxyType[str, Material] = MappingProxyType(
    {
        material.name: material
        for material in (
            # Densities and air: NIST X-ray mass attenuation tables (Hubbell & Seltzer 1995).
            _beam_material("Be", 1.848, {"Be": 100.0}, "element"),
            _beam_material("Al", 2.699, {"Al": 100.0}, "element"),
            _beam_material("Mo", 10.22, {"Mo": 100.0}, "element"),
            _beam_material("Rh", 12.41, {"Rh": 100.0}, "element"),
            _beam_material("Ag", 10.50, {"Ag": 100.0}, "element"),
            _beam_material("Ti", 4.54, {"Ti": 100.0}, "element"),
            _beam_material("Cu", 8.96, {"Cu": 100.0}, "element"),
            _beam_material(
                "air",
                1.205e-3,
                {"C": 0.0124, "N": 75.5268, "O": 23.1781, "Ar": 1.2827},
                "dry",
            ),
            _beam_material(
                "polycarbonate", 1.20, {"H": 5.5491, "C": 75.5751, "O": 18.8758}, "(C16H14O3)n"
            ),
            # Amorphous selenium is lighter than the crystal (4.8): Kasap & Rowlands 2002.
            _beam_material("Se", 4.3, {"Se": 100.0}, "amorphous selenium"),
            _beam_material("CsI", 4.51, {"Cs": 51.155, "I": 48.845}, "stoichiometry"),
            _beam_material("Pb", 11.35, {"Pb": 100.0}, "element"),
            _beam_material("polystyrene", 1.06, {"H": 7.7418, "C": 92.2582}, "(C8H8)n"),
            # Carbon-fibre laminate, about 60 per cent fibre: counted as carbon.
            _beam_material("carbon fibre", 1.60, {"C": 100.0}, "laminate as carbon"),
        )
    }
)
"""What the beam meets besides the breast: filters, air, paddle, support, grid, detectors."""

SUPPORT_MATERIALS = ("carbon fibre", "polystyrene", "polycarbonate")
"""What breast support and detector cover may be made of."""


def attenuation_per_mm(material: Material, energy_kev: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear attenuation coefficient, coherent scatter included, 1/mm.

    Parameters
    ----------
    material : Material
    energy_kev : ndarray of float64, (n,)

    Returns
    -------
    ndarray of float64, (n,)

    Examples
    --------
    >>> from mammosim.tissues import composition
    >>> gland = composition("hammerstein", "oxalate")["gland"]
    >>> round(float(attenuation_per_mm(gland, np.array([20.0]))[0]), 5)
    0.08005
    """
    return (
        cross_section_cm2_g("CS_Total", material, energy_kev) * material.density_g_cm3 / MM_PER_CM
    )


def absorbed_fraction(
    material: Material, thickness_mm: NDArray[np.float64], energy_kev: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Fraction of photons that a layer absorbs by the photoelectric effect.

    Parameters
    ----------
    material : Material
    thickness_mm : ndarray of float64, (thickness,)
    energy_kev : ndarray of float64, (energy,)

    Returns
    -------
    ndarray of float64, [energy, thickness]

    Notes
    -----
    ``(tau / mu) (1 - exp(-mu t))``; photons that scatter in the layer are counted as lost.
    """
    total = attenuation_per_mm(material, energy_kev)
    photo = (
        cross_section_cm2_g("CS_Photo", material, energy_kev) * material.density_g_cm3 / MM_PER_CM
    )
    absorbed: NDArray[np.float64] = -np.expm1(-total[:, None] * thickness_mm)
    return (photo / total)[:, None] * absorbed


def energy_absorption_cm2_g(
    material: Material, energy_kev: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mass energy-transfer coefficient, cm2/g, which below 50 keV is that of energy absorption.

    Parameters
    ----------
    material : Material
        A material of light elements: their fluorescence is taken to be absorbed on the spot.
    energy_kev : ndarray of float64, (n,)

    Returns
    -------
    ndarray of float64, (n,)

    Notes
    -----
    Photoelectric cross-section plus the Compton cross-section times the mean share of its energy
    that a photon gives to a free electron at rest (Klein & Nishina).

    Examples
    --------
    NIST's value for air at 20 keV is 0.5389 cm2/g.

    >>> round(float(energy_absorption_cm2_g(BEAM_MATERIALS["air"], np.array([20.0]))[0]), 3)
    0.54
    """
    photo = cross_section_cm2_g("CS_Photo", material, energy_kev)
    compton = cross_section_cm2_g("CS_Compt", material, energy_kev)
    return photo + compton * _compton_transfer(energy_kev)


def _compton_transfer(energy_kev: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean share of its energy that a photon loses in a Compton event."""
    cosine = np.linspace(-1.0, 1.0, 401)
    ratio = compton_ratio(energy_kev, cosine)
    section = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
    share: NDArray[np.float64] = (section * (1.0 - ratio)).sum(axis=1) / section.sum(axis=1)
    return share


def compton_ratio(
    energy_kev: NDArray[np.float64], cosine: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[energy, angle] scattered over incident energy, for a free electron at rest."""
    return 1.0 / (1.0 + energy_kev[:, None] / ELECTRON_REST_KEV * (1.0 - cosine))


def cross_section_cm2_g(
    quantity: str, material: Material, energy_kev: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mass-weighted sum of one of xraylib's cross-sections over the elements, cm2/g."""
    energies = tuple(float(energy) for energy in energy_kev)
    parts = [
        fraction * _element(quantity, symbol, energies)
        for symbol, fraction in material.mass_fraction.items()
    ]
    return np.sum(parts, axis=0)


@cache
def _element(quantity: str, symbol: str, energies: tuple[float, ...]) -> NDArray[np.float64]:
    import xraylib  # imported when first needed: loading its tables takes a moment

    try:
        number = xraylib.SymbolToAtomicNumber(symbol)
    except ValueError:
        raise InputError(f"acquisition.composition: unknown element '{symbol}'") from None
    section = getattr(xraylib, quantity)
    try:
        return np.array([section(number, energy) for energy in energies])
    except ValueError as error:
        raise InputError(
            f"acquisition.composition: element '{symbol}' has no cross-sections from "
            f"{energies[0]:g} to {energies[-1]:g} keV ({error})"
        ) from None
