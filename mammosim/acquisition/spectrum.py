"""The X-ray beam: tube spectrum, filters, air and paddle; air kerma and half-value layer."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import StringIO

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from mammosim.acquisition.attenuation import (
    BEAM_MATERIALS,
    attenuation_per_mm,
    energy_absorption_cm2_g,
)
from mammosim.acquisition.tube import REFERENCE_MM, tube_fluence
from mammosim.config import read_text
from mammosim.errors import InputError

# European guidelines (4th edition, 2006, part 2A/B) name 30 um Mo, 25 um Rh (50 um on W tubes),
# 50 um Ag; 0.7 mm Al is that of W/Al tomosynthesis systems (Hologic, Dance & Young 2011).
# High-energy exposures of contrast-enhanced mammography: 0.3 mm Cu on Hologic's units, 1 mm Ti on
# Siemens' (thicknesses as makers state them, from memory); Cu or Ti at 45 to 49 kV:
# doi 10.1007/s00330-015-4007-6, introduction.
FILTER_MM: dict[str, float] = {
    "Mo": 0.030, "Rh": 0.025, "Ag": 0.050, "Al": 0.700, "Cu": 0.300, "Ti": 1.000
}  # fmt: skip
"""Usual thickness of each filter material, mm (rhodium on a tungsten tube: 0.050)."""

WINDOW_BE_MM = 0.8  # exit window of mammography tubes, as in the HVL figures of docs
KEV_TO_MGY_G = (
    1.602177e-10  # mGy in 1 g for 1 keV absorbed: 1.602177e-16 J / 1e-3 kg * 1e3 (CODATA)
)
MM2_PER_CM2 = 100.0
MAX_FLUENCE = 1e12  # a bin, 1/(mm2 mAs) at 1 m: a million times what tubes emit
MIN_FLUENCE = 1e-6  # in all, behind filter and air: 10 000 mAs would give no photon a pixel
MAX_SPECTRUM_BYTES = 1_000_000  # of a file: two columns of some hundred lines
MAX_ABOVE_KEV = 0.5  # half a wide bin: the highest bin's centre may lie this far above the voltage


@dataclass(frozen=True, eq=False)
class Beam:
    """Photons that leave tube, filter, air and paddle, at a reference distance of 1 m.

    Parameters
    ----------
    target, filter : str
    filter_mm : float
        Filter thickness, mm.
    kvp : float
        Tube voltage, kV.
    energy_kev : ndarray of float64, (n,)
        Centres of the energy bins, keV.
    fluence_mm2_mas : ndarray of float64, (n,)
        Photons a bin, 1/(mm2 mAs), on the central ray 1 m from the focal spot.
    layers_mm : mapping of str to float
        Flat layers of `BEAM_MATERIALS` that the beam has crossed at right angles, mm.
    """

    target: str
    filter: str
    filter_mm: float
    kvp: float
    energy_kev: NDArray[np.float64]
    fluence_mm2_mas: NDArray[np.float64]
    layers_mm: Mapping[str, float] = field(default_factory=dict)

    def fluence_at(self, distance_mm: float) -> NDArray[np.float64]:
        """(n,) photons a bin, 1/(mm2 mAs), on the central ray; inverse square law."""
        return self.fluence_mm2_mas * (REFERENCE_MM / distance_mm) ** 2

    def kerma_mgy_mas(self, distance_mm: float) -> float:
        """Air kerma free in air, mGy/mAs, on the central ray."""
        return float(self._kerma_weights() @ self.fluence_at(distance_mm))

    @property
    def mean_energy_kev(self) -> float:
        """Mean photon energy, keV."""
        return float(np.average(self.energy_kev, weights=self.fluence_mm2_mas))

    @property
    def hvl_mm_al(self) -> float:
        """Thickness of aluminium that halves the air kerma (narrow beam), mm."""
        kerma = self._kerma_weights() * self.fluence_mm2_mas
        aluminium = attenuation_per_mm(BEAM_MATERIALS["Al"], self.energy_kev)

        def excess(thickness_mm: float) -> float:
            return float(kerma @ np.exp(-aluminium * thickness_mm) / kerma.sum() - 0.5)

        return float(brentq(excess, 1e-4, 20.0))

    def _kerma_weights(self) -> NDArray[np.float64]:
        """Air kerma of one photon per mm2 at each energy, mGy mm2."""
        absorption = energy_absorption_cm2_g(BEAM_MATERIALS["air"], self.energy_kev)
        return self.energy_kev * absorption * KEV_TO_MGY_G * MM2_PER_CM2


def make_beam(
    target: str,
    filter: str,
    kvp: float | None = None,
    *,
    filter_mm: float | None = None,
    air_mm: float = 1000.0,
    paddle_mm: float = 3.0,
    spectrum_file: str | None = None,
) -> Beam:
    """The beam that reaches the breast.

    Parameters
    ----------
    target : {"Mo", "Rh", "W"}
        Anode material.
    filter : {"Mo", "Rh", "Ag", "Al", "Cu", "Ti"}
        Filter material.
    kvp : float, optional
        Tube voltage, kV; may be left out with a spectrum file: its highest energy.
    filter_mm : float, optional
        Filter thickness, mm; left out: the usual one of `FILTER_MM`.
    air_mm : float
        Air that the beam crosses, mm.
    paddle_mm : float
        Polycarbonate of the paddle, mm.
    spectrum_file : str, optional
        Two columns, energy in keV and photons a bin in 1/(mm2 mAs) at 1 m, of the beam behind its
        filter; it replaces tube, window and filter.

    Returns
    -------
    Beam

    Raises
    ------
    InputError
        If target, filter or tube voltage is not one that the spectrum model covers, the file
        cannot be read, or it holds photons of more than the tube voltage.

    Notes
    -----
    Filters act as narrow-beam absorbers, ``exp(-mu t)``; fluorescence of the filter is left out.
    """
    if filter not in FILTER_MM:
        raise InputError(
            f"acquisition.filter: found '{filter}', expected one of {', '.join(FILTER_MM)}"
        )
    if filter_mm is None:
        filter_mm = 0.050 if (target, filter) == ("W", "Rh") else FILTER_MM[filter]
    flat = {"air": air_mm, "polycarbonate": paddle_mm}
    if spectrum_file is not None:
        energy, fluence = read_spectrum(spectrum_file)
        kvp = _voltage_of(energy, fluence, kvp, spectrum_file)
        layers = flat
    else:
        if kvp is None:
            raise InputError("acquisition.kvp: missing; it must be given without a spectrum file")
        energy, fluence = tube_fluence(target, kvp)
        layers = {**flat, "Be": WINDOW_BE_MM, filter: filter_mm}
    for name, thickness_mm in layers.items():
        mu = attenuation_per_mm(BEAM_MATERIALS[name], energy)
        fluence = fluence * np.exp(-mu * thickness_mm)
    if not fluence.sum() > MIN_FLUENCE:
        raise InputError(
            f"{spectrum_file or 'acquisition.filter_mm'}: the beam has {fluence.sum():.3g} photons "
            f"per mm2 and mAs behind {filter_mm:g} mm {filter}, air and paddle, expected more than "
            f"{MIN_FLUENCE:g}"
        )
    # What is left of the softest photons (below about 5 keV) weighs nothing and costs time.
    kept = fluence > 1e-9 * fluence.max()
    return Beam(target, filter, filter_mm, kvp, energy[kept], fluence[kept], flat)


def read_spectrum(path: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a spectrum of two columns: energy, keV, and photons a bin, 1/(mm2 mAs) at 1 m.

    Raises
    ------
    InputError
        If there is no such file, or it does not hold two columns of numbers with rising energies
        of 1 to 150 keV and fluences that are not negative.
    """
    try:
        text = read_text(path, MAX_SPECTRUM_BYTES)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy warns of an empty file, refused below
            table = np.loadtxt(StringIO(text), dtype=np.float64, ndmin=2)
    except FileNotFoundError:
        raise InputError(f"acquisition.spectrum_file: no such file: {path}") from None
    except ValueError as error:
        raise InputError(f"{path}: not two columns of numbers ({error})") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise InputError(
            f"{path}: found a table of {table.shape}, expected two columns and two rows or more"
        )
    energy, fluence = table.T
    # xraylib's energy-absorption table begins at 1 keV.
    rising = bool(np.all(np.diff(energy) > 0.0)) and energy[0] >= 1.0 and energy[-1] <= 150.0
    sound = bool(np.all((fluence >= 0.0) & (fluence <= MAX_FLUENCE))) and fluence.sum() > 0.0
    if not rising or not sound:
        raise InputError(
            f"{path}: expected rising energies of 1 to 150 keV and fluences of 0 to "
            f"{MAX_FLUENCE:g} photons per mm2 and mAs, not all 0"
        )
    return energy.copy(), fluence.copy()


def _voltage_of(
    energy_kev: NDArray[np.float64], fluence: NDArray[np.float64], kvp: float | None, path: str
) -> float:
    """Tube voltage of a spectrum: the one given if no photon exceeds it, or the highest energy."""
    highest = float(energy_kev[fluence > 0.0].max())
    if kvp is not None and highest > kvp + MAX_ABOVE_KEV:
        raise InputError(
            f"{path}: found photons of {highest:g} keV, which a tube at acquisition.kvp {kvp:g} "
            "cannot emit; leave kvp out or give that of the spectrum"
        )
    return highest if kvp is None else kvp
