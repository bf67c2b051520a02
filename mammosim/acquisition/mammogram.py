"""The mammogram: what the detector recorded, and the picture made of it for reading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import Gantry


@dataclass(frozen=True, eq=False)
class Mammogram:
    """A full-field digital mammogram with its technique.

    Parameters
    ----------
    for_processing : ndarray of uint16, [row, column]
        Linear in exposure; air is bright.
    for_presentation : ndarray of uint16, [row, column]
        For reading: gland is bright, air is 0.
    window_center, window_width : float
        Display window of `for_presentation`.
    gantry : Gantry
    thickness_mm, force_n : float
        Compressed thickness, mm, and force on the paddle, N.
    target, filter : str
        Anode and filter material, as `W` and `Rh`.
    filter_mm : float
        Filter thickness, mm.
    kvp, mas : float
        Tube voltage, kV, and tube load, mAs.
    hvl_mm_al : float
        Half-value layer behind the paddle, mm Al.
    air_kerma_mgy : float
        Incident air kerma at the breast's upper surface below the paddle, mGy.
    dose_mgy : float
        Mean glandular dose, mGy.
    grid : bool
        Whether an anti-scatter grid was in.
    measures : mapping of str to float
        Other numbers of the picture (scatter-to-primary ratio, noise, density, ...).
    notes : tuple of str
        Warnings, one sentence each.
    detector : str
        Name of the detector, of `DETECTORS`; empty where it is not known.
    focal_spot_mm : float
        Nominal size of the focal spot, mm.
    automatic_exposure : bool
        Whether exposure control chose the tube load.
    """

    for_processing: NDArray[np.uint16]
    for_presentation: NDArray[np.uint16]
    window_center: float
    window_width: float
    gantry: Gantry
    thickness_mm: float
    force_n: float
    target: str
    filter: str
    filter_mm: float
    kvp: float
    mas: float
    hvl_mm_al: float
    air_kerma_mgy: float
    dose_mgy: float
    grid: bool
    measures: Mapping[str, float]
    notes: tuple[str, ...] = ()
    detector: str = ""
    focal_spot_mm: float = math.nan
    automatic_exposure: bool = True
