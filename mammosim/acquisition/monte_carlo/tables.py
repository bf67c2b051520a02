"""Cross-sections and scattering angles of materials, tabulated for the photon transport."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import MM_PER_CM, compton_ratio, cross_section_cm2_g
from mammosim.acquisition.monte_carlo.compton import scattering_function
from mammosim.errors import InputError
from mammosim.tissues import Material

ENERGY_STEP_KEV = 0.25
"""Spacing of the energies: linear interpolation is off by 0.1 % at 10 keV (mu falls as E^-3)."""

LOWEST_SHARE = 0.75
"""Energies go down to this part of the beam's lowest: below it a photon is stopped where it is.
Four Compton events backwards take a sixth of 25 keV."""

ANGLES = 128
"""Intervals of equal probability into which the scattering angles are divided."""

KEV_ANGSTROM = 12.398420  # h c: CODATA 2018
# 8 pi r_e^2 / 2 with the classical electron radius squared in barn, times moles a gram to cm2 / g
CM2_PER_G = 4.0 * np.pi * 0.0794078 * 0.602214  # CODATA 2018
TRANSFER_GRID = np.concatenate(
    ([0.0], np.geomspace(1e-3, 15.0, 400))
)  # sin(theta / 2) / wavelength
LOWEST_TABULATED_KEV, HIGHEST_TABULATED_KEV = 1.0, 150.0
"""Energies for which tables are made, keV: beams of mammography lie well within."""
HALF_ANGLES = np.linspace(0.0, 1.0, 257)  # sin(theta / 2)

MAX_KEPT = 64
"""Materials whose tables are kept, of up to 0.3 MB each; an exposure takes about ten."""


@dataclass(frozen=True, eq=False)
class PhotonTables:
    """What can happen to a photon in each material, by energy.

    Parameters
    ----------
    materials : tuple of Material
    energy_kev : ndarray of float64, [energy]
        Evenly spaced, keV.
    photo, incoherent, coherent : ndarray of float64, [energy, material]
        Linear coefficients of photoelectric absorption, Compton and Rayleigh scattering, 1/mm.
    transfer : ndarray of float64, [energy, material]
        Mean part of its energy that a photon leaves in a Compton event.
    incoherent_cosine, coherent_cosine : ndarray of float32, [energy, material, ANGLES + 1]
        Cosine of the scattering angle at equal steps of cumulative probability.
    """

    materials: tuple[Material, ...]
    energy_kev: NDArray[np.float64]
    photo: NDArray[np.float64]
    incoherent: NDArray[np.float64]
    coherent: NDArray[np.float64]
    transfer: NDArray[np.float64]
    incoherent_cosine: NDArray[np.float32]
    coherent_cosine: NDArray[np.float32]

    @property
    def total(self) -> NDArray[np.float64]:
        """[energy, material] linear attenuation coefficient, 1/mm."""
        return self.photo + self.incoherent + self.coherent

    @property
    def absorbed(self) -> NDArray[np.float64]:
        """[energy, material] linear energy-absorption coefficient, 1/mm."""
        return self.photo + self.incoherent * self.transfer


def photon_tables(
    materials: Sequence[Material], lowest_kev: float, highest_kev: float
) -> PhotonTables:
    """Tabulate materials over the energies of a beam.

    Parameters
    ----------
    materials : sequence of Material
    lowest_kev, highest_kev : float
        Lowest and highest energy of the beam, keV.

    Returns
    -------
    PhotonTables

    Raises
    ------
    InputError
        If an element has no form factors, or the beam goes beyond the tables.

    Notes
    -----
    Coherent scattering has the angular distribution ``(1 + cos^2) F^2(q)`` with the atoms' form
    factors, incoherent that of Klein and Nishina times the scattering function of the impulse
    approximation (`mammosim.acquisition.monte_carlo.compton`), which is 2 % above that of xraylib
    in tissue. Atoms add up independently of each other. All three coefficients are then scaled, by
    1 % or less, so that their sum is the attenuation that the primary is computed with. Not
    modelled: interference between molecules, Doppler broadening, and fluorescence, whose photons
    (below 5 keV in tissue) do not leave the voxel.
    """
    energy = _energies(lowest_kev, highest_kev)
    shape = (energy.size, len(materials))
    photo, compton, rayleigh, transfer = (np.empty(shape) for _ in range(4))
    cosines = np.empty((2, *shape, ANGLES + 1), np.float32)
    for column, material in enumerate(materials):
        elements = tuple(material.mass_fraction.items())
        parts = _column(elements, material.density_g_cm3, lowest_kev, highest_kev)
        photo[:, column], compton[:, column], rayleigh[:, column], transfer[:, column] = parts[:4]
        cosines[0, :, column], cosines[1, :, column] = parts[4:]
    return PhotonTables(
        tuple(materials), energy, photo, compton, rayleigh, transfer, cosines[0], cosines[1]
    )


@lru_cache(MAX_KEPT)
def _column(
    elements: tuple[tuple[str, float], ...], density_g_cm3: float, lowest_kev: float,
    highest_kev: float,
) -> tuple[NDArray[np.float64], ...]:  # fmt: skip
    """What `PhotonTables` holds of one material, whose elements are given by mass; not to change.

    It is kept: both views of an exam, and the check before it, ask for the same.
    """
    material = Material("", density_g_cm3, dict(elements), "")
    energy = _energies(lowest_kev, highest_kev)
    loss = 1.0 - compton_ratio(energy, 1.0 - 2.0 * HALF_ANGLES**2)
    incoherent, coherent = angular_densities(material, energy)
    integral = np.trapezoid(incoherent, HALF_ANGLES, axis=1)
    parts = (
        cross_section_cm2_g("CS_Photo", material, energy),
        CM2_PER_G * integral,
        cross_section_cm2_g("CS_Rayl", material, energy),
    )
    scale = cross_section_cm2_g("CS_Total", material, energy) / np.sum(parts, axis=0)
    scale *= density_g_cm3 / MM_PER_CM
    transfer = np.trapezoid(incoherent * loss, HALF_ANGLES, axis=1) / integral
    return *(scale * part for part in parts), transfer, _quantiles(incoherent), _quantiles(coherent)


def angular_densities(
    material: Material, energy_kev: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Incoherent and coherent differential cross-section over s = sin(theta / 2), in [0, 1].

    Both are [energy, s] in an arbitrary unit (electron radius squared times atoms a gram).
    """
    s = HALF_ANGLES
    q = energy_kev[:, None] / KEV_ANGSTROM * s
    cosine = 1.0 - 2.0 * s**2
    form = np.zeros(TRANSFER_GRID.size)
    for symbol, fraction in material.mass_fraction.items():
        weight, squared_form = _element(symbol)
        form += fraction / weight * squared_form
    ratio = compton_ratio(energy_kev, cosine)
    klein_nishina = ratio**2 * (ratio + 1.0 / ratio - 1.0 + cosine**2)
    # the solid angle between s and s + ds is 8 pi s ds
    incoherent = klein_nishina * scattering_function(material, energy_kev, cosine) * s
    coherent = (1.0 + cosine**2) * np.interp(q, TRANSFER_GRID, form) * s
    return incoherent, coherent


def _energies(lowest_kev: float, highest_kev: float) -> NDArray[np.float64]:
    if lowest_kev < LOWEST_TABULATED_KEV or highest_kev > HIGHEST_TABULATED_KEV:
        raise InputError(
            f"acquisition.scatter: the spectrum has photons of {lowest_kev:g} to {highest_kev:g} "
            f"keV, the scattering tables cover {LOWEST_TABULATED_KEV:g} to "
            f"{HIGHEST_TABULATED_KEV:g} keV; choose model: none"
        )
    first = np.floor(max(LOWEST_SHARE * lowest_kev, LOWEST_TABULATED_KEV) / ENERGY_STEP_KEV)
    last = np.ceil(highest_kev / ENERGY_STEP_KEV)
    return np.arange(first, last + 1.0) * ENERGY_STEP_KEV


def _quantiles(density: NDArray[np.float64]) -> NDArray[np.float64]:
    """[energy, ANGLES + 1] cosines at equal steps of the cumulated density over s."""
    steps = 0.5 * (density[:, 1:] + density[:, :-1])
    cumulated = np.concatenate([np.zeros((len(density), 1)), np.cumsum(steps, axis=1)], axis=1)
    cumulated /= cumulated[:, -1:]
    wanted = np.linspace(0.0, 1.0, ANGLES + 1)
    s = np.stack([np.interp(wanted, row, HALF_ANGLES) for row in cumulated])
    return 1.0 - 2.0 * s**2


@cache
def _element(symbol: str) -> tuple[float, NDArray[np.float64]]:
    """Atomic weight, and squared form factor on `TRANSFER_GRID`."""
    import xraylib  # imported when first needed: loading its tables takes a moment

    try:
        number = xraylib.SymbolToAtomicNumber(symbol)
        form = np.array([xraylib.FF_Rayl(number, float(q)) for q in TRANSFER_GRID])
        return float(xraylib.AtomicWeight(number)), form**2
    except ValueError as error:
        raise InputError(
            f"acquisition.composition: element '{symbol}' has no scattering tables ({error}); "
            "choose acquisition.scatter.model: none"
        ) from None
