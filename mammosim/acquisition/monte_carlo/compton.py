"""Compton scattering by bound electrons: the relativistic impulse approximation.

Ribberfors & Berggren 1982, Phys Rev A 26:3325; with one-parameter Compton profiles as of Brusa,
Stutz, Riveros, Fernandez-Varea & Salvat 1996, Nucl Instrum Meth A 379:167, the model of PENELOPE.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import ELECTRON_REST_KEV
from mammosim.errors import InputError
from mammosim.tissues import Material

INVERSE_FINE_STRUCTURE = 137.035999  # atomic units of momentum in m c: CODATA 2018
BOHR_RADIUS_CM, AVOGADRO = 5.29177211e-9, 6.02214076e23  # CODATA 2018

UNBOUND = {"C": 4}
"""Outer electrons that are counted as a free electron gas, by element. PENELOPE does so where the
ionisation energy is below 13 eV (carbon's is 11.3 eV, hydrogen's, nitrogen's and oxygen's are 13.6
to 14.5 eV: NIST Atomic Spectra Database); elements that occur as traces are left out."""

_SHELLS = 31  # as many as xraylib numbers


@dataclass(frozen=True)
class Shell:
    """Electrons of one kind in an atom.

    Parameters
    ----------
    electrons : float
    binding_kev : float
        Ionisation energy, keV.
    profile : float
        Height of the Compton profile of one electron at zero momentum, 1 / atomic unit.
    """

    electrons: float
    binding_kev: float
    profile: float


@cache
def shells_of(symbol: str) -> tuple[Shell, ...]:
    """Shells of an element: xraylib's edges and Biggs, Mendelsohn and Mann's profiles (1975).

    Raises
    ------
    InputError
        If xraylib has no Compton profile of the element.
    """
    import xraylib  # imported when first needed: loading its tables takes a moment

    number = xraylib.SymbolToAtomicNumber(symbol)
    found: list[Shell] = []
    for shell in range(_SHELLS):
        electrons = _number_or_zero(xraylib.ElectronConfig, number, shell)
        if electrons == 0.0:
            continue
        profile = _number_or_zero(xraylib.ComptonProfile_Partial, number, shell, 0.0)
        if profile == 0.0 and found:  # the other half of a subshell that is listed once
            profile = found[-1].profile
        if profile > 0.0:
            found.append(
                Shell(electrons, _number_or_zero(xraylib.EdgeEnergy, number, shell), profile)
            )
    if not found:
        raise InputError(
            f"acquisition.composition: element '{symbol}' has no Compton profile; choose "
            "acquisition.scatter.model: none"
        )
    return tuple(found)


def scattering_function(
    material: Material, energy_kev: NDArray[np.float64], cosine: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[energy, angle] incoherent scattering function of a material, moles of electrons a gram.

    Parameters
    ----------
    material : Material
    energy_kev : ndarray of float64, (energy,)
    cosine : ndarray of float64, (angle,)
        Of the scattering angle.

    Notes
    -----
    Atoms add up independently of each other, except for the electrons of `UNBOUND`: they fill a
    Fermi sphere of the radius ``p_F = (3 pi^2 n)^(1/3)``, where n is their number in a cubic Bohr
    radius, and have the profile ``J0 = 3 / (4 p_F)`` and no binding energy.
    """
    energies, cosines = tuple(map(float, energy_kev)), tuple(map(float, cosine))
    total = np.zeros((energy_kev.size, cosine.size))
    free = 0.0
    for symbol, fraction in material.mass_fraction.items():
        moles = fraction / _atomic_weight(symbol)
        total += moles * _bound_function(symbol, energies, cosines)
        free += moles * UNBOUND.get(symbol, 0)
    if free > 0.0:
        number = free * material.density_g_cm3 * AVOGADRO * BOHR_RADIUS_CM**3
        gas = Shell(free, 0.0, 0.75 / float(np.cbrt(3.0 * np.pi**2 * number)))
        total += impulse_function((gas,), energy_kev, cosine)
    return total


def impulse_function(
    shells: Sequence[Shell], energy_kev: NDArray[np.float64], cosine: NDArray[np.float64]
) -> NDArray[np.float64]:
    """[energy, angle] incoherent scattering function of shells, at most their electrons.

    Parameters
    ----------
    shells : sequence of Shell
    energy_kev : ndarray of float64, (energy,)
    cosine : ndarray of float64, (angle,)

    Notes
    -----
    ``S = sum f n(p_max)`` over the shells with ``E > U``, where ``p_max`` is the largest momentum
    along the momentum transfer that an electron may have so that it can leave its shell,

        p_max / m c = (E (E - U)(1 - cos) - m c^2 U)
                      / (m c^2 sqrt(2 E (E - U)(1 - cos) + U^2)),

    and n the cumulated profile, ``n(p) = exp(1/2 - (d1 - d2 J0 p)^2) / 2`` for p < 0 and
    ``1 - exp(1/2 - (d1 + d2 J0 p)^2) / 2`` otherwise, ``d1 = d2 / 2 = sqrt(1/2)``.

    Examples
    --------
    Nearly all six electrons of carbon scatter at large angles, few at small ones.

    >>> s = impulse_function(shells_of("C"), np.array([20.0]), np.array([-1.0, 0.999]))
    >>> [round(float(value), 2) for value in s[0]]
    [5.89, 0.3]
    """
    energy, away = energy_kev[:, None], 1.0 - cosine[None, :]
    total = np.zeros((energy_kev.size, cosine.size))
    for shell in shells:
        bound = shell.binding_kev
        left = np.maximum(energy - bound, 0.0)
        product = energy * left * away
        momentum = (product - ELECTRON_REST_KEV * bound) / (
            ELECTRON_REST_KEV * np.sqrt(2.0 * product + bound**2 + 1e-30)
        )
        u = shell.profile * INVERSE_FINE_STRUCTURE * momentum
        beyond = 0.5 * np.exp(0.5 - (np.sqrt(0.5) + np.sqrt(2.0) * np.abs(u)) ** 2)
        share = np.where(u < 0.0, beyond, 1.0 - beyond)
        total += shell.electrons * np.where(energy > bound, share, 0.0)
    return total


@cache
def _bound_function(
    symbol: str, energies_kev: tuple[float, ...], cosines: tuple[float, ...]
) -> NDArray[np.float64]:
    """[energy, angle] scattering function of an element's bound electrons."""
    free, shells = float(UNBOUND.get(symbol, 0)), []
    for shell in reversed(shells_of(symbol)):  # outermost first
        taken = min(free, shell.electrons)
        free -= taken
        shells.append(Shell(shell.electrons - taken, shell.binding_kev, shell.profile))
    return impulse_function(shells, np.array(energies_kev), np.array(cosines))


@cache
def _atomic_weight(symbol: str) -> float:
    import xraylib

    return float(xraylib.AtomicWeight(xraylib.SymbolToAtomicNumber(symbol)))


def _number_or_zero(function: Callable[..., float], *arguments: float) -> float:
    """What one of xraylib's functions returns, 0 where it has no value."""
    try:
        return float(function(*arguments))
    except ValueError:
        return 0.0
