"""Technique: tube voltage by thickness, and exposure control by the signal behind dense tissue."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from mammosim.errors import InputError
from mammosim.plausibility import limit_of

# Upper thickness (mm) and kV, in the manner of the tables of clinical systems, which raise the
# voltage by about 1 kV a centimetre: W/Rh 26-32 kV over 2-9 cm, molybdenum about 25-30 kV
# (European guidelines 2006 give typical HVLs for 25-31 kV on all these spectra).
KVP_BY_THICKNESS: dict[str, tuple[tuple[float, float], ...]] = {
    "W": ((30, 26), (40, 27), (50, 28), (60, 29), (70, 30), (80, 31), (np.inf, 32)),
    "Mo": ((30, 25), (40, 26), (50, 27), (60, 28), (70, 29), (np.inf, 30)),
    "Rh": ((30, 26), (40, 27), (50, 28), (60, 29), (70, 30), (80, 31), (np.inf, 32)),
}

# Absorbed energy that exposure control aims at behind the densest part of the breast. With it a
# homogeneous breast of 5 cm and 50 per cent gland (W/Rh, grid, selenium) gets a mean glandular
# dose of 1.2 mGy, which Feng & Sechopoulos 2012 (Radiology 263:35) found for a Selenia Dimensions.
TARGET_SIGNAL_KEV_MM2 = 8.5e6

MAX_CONTROLLED_MAS = limit_of("tube_load_mas").high
"""Largest tube load that exposure control gives, mAs."""

REGION_MM = 10.0  # side of the field whose mean signal counts
DENSE_QUANTILE = 0.05  # the densest twentieth of the breast, so that a clip does not decide
FULL_THICKNESS = 0.8  # part of the gap that must be tissue: the round margin does not count
MUSCLE_SHARE = 0.1  # more muscle than this on a ray, and it does not count
SPOT_THICKNESS = 1.15  # times the gap: what is thicker rises beside a spot paddle. Assumed


def kvp_by_thickness(target: str, thickness_mm: float) -> float:
    """Tube voltage for a compressed thickness, kV.

    Examples
    --------
    >>> kvp_by_thickness("W", 55.0)
    29.0
    """
    table = KVP_BY_THICKNESS[target]
    return float(next(kvp for limit, kvp in table if thickness_mm <= limit))


def under_spot_paddle(tissue_mm: NDArray[np.float64], thickness_mm: float) -> NDArray[np.bool_]:
    """Where a spot paddle presses: tissue that fills the gap and does not rise above it.

    Parameters
    ----------
    tissue_mm : ndarray of float64, [row, column]
        Path through all tissue, mm.
    thickness_mm : float
        Gap between the plates, mm.
    """
    pressed = (tissue_mm >= FULL_THICKNESS * thickness_mm) & (
        tissue_mm <= SPOT_THICKNESS * thickness_mm
    )
    return np.asarray(pressed)


def dense_signal(
    signal: NDArray[np.float64],
    tissue_mm: NDArray[np.float64],
    muscle_mm: NDArray[np.float64],
    thickness_mm: float,
    cell_mm: float,
    spot: bool = False,
) -> float:
    """Signal behind the dense part of the breast, which exposure control looks at.

    Parameters
    ----------
    signal : ndarray of float64, [row, column]
        Signal on a coarse grid, any unit.
    tissue_mm, muscle_mm : ndarray of float64, [row, column]
        Path through all tissue and through muscle, mm.
    thickness_mm : float
        Gap between the plates, mm.
    cell_mm : float
        Side of a cell, mm.
    spot : bool
        Whether the paddle is a spot paddle: its sensor lies below what the paddle presses.

    Raises
    ------
    InputError
        If no tissue is in the field.
    """
    if not np.any(tissue_mm > 0.0):
        raise InputError(
            "acquisition: there is no tissue in the detector's field for exposure control: check "
            "projection.detector_edge_mm, or give acquisition.mas"
        )
    smooth = uniform_filter(signal, max(1, round(REGION_MM / cell_mm)), mode="nearest")
    full = tissue_mm >= FULL_THICKNESS * min(thickness_mm, float(tissue_mm.max()))
    breast = full & (muscle_mm <= MUSCLE_SHARE * tissue_mm)
    if not breast.any():
        breast = full
    pressed = breast & under_spot_paddle(tissue_mm, thickness_mm)
    if spot and pressed.any():
        breast = pressed
    return float(np.quantile(smooth[breast], DENSE_QUANTILE))
