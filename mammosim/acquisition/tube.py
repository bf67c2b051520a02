"""Unfiltered tube spectra by SpekPy, kept in memory and on disk because each takes a second."""

from __future__ import annotations

import math
import os
import sys
import tempfile
import zipfile
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mammosim.errors import InputError

TARGETS: tuple[str, ...] = ("W", "Mo", "Rh")
"""Anode materials that the spectrum model covers."""

KVP_RANGE: tuple[float, float] = (20.0, 49.0)
"""Tube voltages of mammography tubes, within those that SpekPy's model covers, kV: above 35 for
high-energy exposures with a contrast agent."""

REFERENCE_MM = 1000.0
"""Distance from the focal spot that fluences are given for, mm."""

ANODE_ANGLE_DEG = 16.0  # usual target angle of mammography tubes, against the tube's own axis
BIN_KEV = 0.25  # with 0.5 keV the K-edge of a Rh filter shows in the HVL
PHYSICS = "casim"  # SpekPy's model for W, Mo and Rh: Omar et al. 2020, Med Phys 47:4763


def tube_fluence(
    target: str, kvp: float, towards_anode_deg: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Photons that leave the anode, before window and filter.

    Parameters
    ----------
    target : {"W", "Mo", "Rh"}
    kvp : float
        Tube voltage, kV, within `KVP_RANGE`.
    towards_anode_deg : float
        Angle of the ray with the tube's axis, degrees, below `ANODE_ANGLE_DEG`; rays towards the
        anode leave it at a grazing angle.

    Returns
    -------
    energy_kev, fluence_mm2_mas : ndarray of float64, (n,)
        Bin centres, and photons a bin, 1/(mm2 mAs) across the ray, 1 m from the focal spot.

    Raises
    ------
    InputError
        If the target or the tube voltage is outside the model.

    References
    ----------
    Poludniowski et al. 2021, Med Phys 48:3630 (SpekPy v2).
    """
    if target not in TARGETS:
        raise InputError(
            f"acquisition.target: found '{target}', expected one of {', '.join(TARGETS)}"
        )
    low, high = KVP_RANGE
    if not low <= kvp <= high:
        raise InputError(f"acquisition.kvp: found {kvp:g}, expected {low:g} to {high:g} kV")
    return _remembered(target, round(float(kvp), 3), round(float(towards_anode_deg), 3))


@cache
def _remembered(
    target: str, kvp: float, towards_anode_deg: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    direction = f"-{towards_anode_deg:+.3f}deg" if towards_anode_deg else ""
    name = f"spekpy-{version('spekpy')}-{PHYSICS}-{target}-{kvp:.3f}kV{direction}.npz"
    file = _cache_folder() / name
    spectrum = _read(file)
    if spectrum is None:
        spectrum = _computed(target, kvp, towards_anode_deg)
        _write(file, *spectrum)
    for array in spectrum:
        array.setflags(write=False)
    return spectrum


def _computed(
    target: str, kvp: float, towards_anode_deg: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    import spekpy  # imported when first needed: it takes a second

    slope = math.tan(math.radians(towards_anode_deg))
    distance_cm = REFERENCE_MM / 10.0
    tube = spekpy.Spek(
        kvp=kvp, th=ANODE_ANGLE_DEG, dk=BIN_KEV, targ=target, physics=PHYSICS,
        x=-distance_cm * slope, z=distance_cm, mas=1.0,
    )  # fmt: skip
    energy_kev, per_kev_cm2 = tube.get_spectrum(edges=False, flu=True, diff=True)
    # SpekPy gives the fluence on the plane z, which an inclined ray reaches further away.
    per_kev_cm2 = np.asarray(per_kev_cm2) * (1.0 + slope**2)
    return np.asarray(energy_kev), per_kev_cm2 * BIN_KEV / 100.0


def _cache_folder() -> Path:
    """Where the operating system wants caches; MAMMOSIM_CACHE_DIR overrides it."""
    given = os.environ.get("MAMMOSIM_CACHE_DIR")
    if given:
        return Path(given)
    if sys.platform == "win32":
        home = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        home = str(Path.home() / "Library" / "Caches")
    else:
        home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(home) / "mammosim"


def _read(file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """A spectrum of the cache; None where there is none or it cannot be read."""
    try:
        with np.load(file, allow_pickle=False) as stored:
            energy, fluence = stored["energy_kev"], stored["fluence_mm2_mas"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    sound = energy.shape == fluence.shape and energy.ndim == 1 and energy.size > 0
    if not sound or not np.all(np.isfinite(fluence)) or not fluence.sum() > 0.0:
        return None
    return energy.astype(np.float64), fluence.astype(np.float64)


def _write(
    file: Path, energy_kev: NDArray[np.float64], fluence_mm2_mas: NDArray[np.float64]
) -> None:
    """Write whole or not at all; a cache that cannot be written is done without."""
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, suffix=".npz")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, energy_kev=energy_kev, fluence_mm2_mas=fluence_mm2_mas)
            os.replace(name, file)
        except OSError:
            os.unlink(name)
            raise
