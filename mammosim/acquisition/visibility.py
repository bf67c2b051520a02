"""How well lesions show: signal with each of them against the signal without."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import attenuation_per_mm
from mammosim.acquisition.contrast_agent import materials_of
from mammosim.acquisition.detectors import Detector, find_detector
from mammosim.acquisition.grid_parts import primary_part
from mammosim.acquisition.keys import AcquisitionKeys
from mammosim.acquisition.mammogram import Mammogram
from mammosim.acquisition.noise import noise_through_blur
from mammosim.acquisition.recording import beam_for, response_for
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import Response
from mammosim.config import documents_keys, given_settings
from mammosim.geometry import Gantry
from mammosim.phantom import BreastPhantom, Lesion
from mammosim.projection import PathLengths, channels_of, host_channel

CORE = 0.5
"""Part of its greatest path length from which on a pixel belongs to the core of a shadow."""


@dataclass(frozen=True)
class Visibility:
    """How a lesion shows in the core of its shadow.

    Parameters
    ----------
    contrast : float
        Part of the signal that the lesion takes away; negative where it lets more through than
        what it replaced.
    sdnr : float
        Signal difference over the standard deviation of one pixel's noise.
    """

    contrast: float
    sdnr: float


@documents_keys(AcquisitionSettings, AcquisitionKeys)
def lesion_visibility(
    phantom: BreastPhantom,
    paths: PathLengths,
    mammogram: Mammogram,
    settings: AcquisitionSettings | None = None,
    **keys: Unpack[AcquisitionKeys],
) -> dict[int, Visibility]:
    """Contrast and signal difference to noise of each lesion that throws a shadow.

    Parameters
    ----------
    phantom : BreastPhantom
    paths : PathLengths
    mammogram : Mammogram
        Exposed from `paths` with the same settings.
    settings : AcquisitionSettings, optional
        Spectrum, detector and exposure; or give its keys as keywords.
    **keys
        Keys of `AcquisitionSettings`.

    Returns
    -------
    dict of int to Visibility
        By the lesion's label; lesions without a shadow in the field are left out.

    Notes
    -----
    With l the path lengths of a pixel, the same pixel without the lesion has the lesion's length
    in the material around it. The difference D of the primary signals of both, behind the grid,
    is taken away from the signal S that was recorded there (scatter and blur included)::

        contrast = sum D / sum (S + D)        sdnr = mean D / sqrt(mean variance)

    over the pixels whose length in the lesion is at least half its greatest. The variance is that
    of quantum noise behind the converter's blur, of the fixed pattern and of the electronics.
    Structure of the tissue around is not noise here. D itself is not blurred: for calcifications
    not much larger than a pixel the contrast is that of a detector without blur.
    """
    settings = given_settings(
        AcquisitionSettings, settings, keys, "lesion_visibility()", ("acquisition",)
    )
    detector = find_detector(settings.detector)
    unit = response_for(settings, beam_for(settings, paths), paths.gantry)
    materials = materials_of(settings)
    mu = np.stack(
        [attenuation_per_mm(materials[name], unit.energy_kev) for name in paths.materials]
    )
    grid = primary_part(settings, unit)
    found = {}
    for lesion in phantom.lesions:
        shadow = _core(paths, lesion)
        if shadow is None:
            continue
        rows, columns, lengths, without = _both(phantom, paths, lesion, shadow)
        scale = mammogram.mas * grid * _cosine(paths.gantry, rows, columns) ** 3
        with_it, energy = _primary(unit, mu, lengths, columns)
        difference = scale * (_primary(unit, mu, without, columns)[0] - with_it)
        kev = mammogram.for_processing[rows, columns] / mammogram.measures["counts_per_kev"]
        noise = _noise_kev(detector, kev, energy, paths.pixel_mm)
        found[lesion.label] = Visibility(
            float(difference.sum() / (kev + difference).sum()), float(difference.mean() / noise)
        )
    return found


def _core(paths: PathLengths, lesion: Lesion) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """Rows and columns of the core of a lesion's shadow; None where it throws none."""
    if lesion.label not in paths.lesion_labels:
        return None
    length = paths.length_mm[paths.lesion_labels.index(lesion.label)]
    greatest = float(length.max())
    if greatest == 0.0:
        return None
    rows, columns = np.nonzero(length >= CORE * greatest)
    return rows, columns


def _both(
    phantom: BreastPhantom,
    paths: PathLengths,
    lesion: Lesion,
    shadow: tuple[NDArray[np.intp], NDArray[np.intp]],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Pixels of a shadow, and their attenuating lengths [channel, n] with and without a lesion."""
    rows, columns = shadow
    lengths = paths.attenuating_mm[:, rows, columns].astype(np.float64)
    without, own = lengths.copy(), paths.lesion_labels.index(lesion.label)
    host = host_channel(phantom, lesion, channels_of(phantom))
    without[own] = 0.0
    if host is not None:
        without[host] += lengths[own]
    return rows, columns, lengths, without


def _primary(
    unit: Response, mu: NDArray[np.float64], lengths: NDArray[np.float64], columns: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Energy of primary photons for one mAs, keV, and its variance over it, keV, (n,) each.

    For rays at right angles to the detector.
    """
    weight, square = unit.energy_weight, unit.square_weight
    if len(weight) > 1:
        weight, square = weight[columns], square[columns]
    passed = np.exp(-(lengths.T @ mu))
    energy = (weight * passed).sum(axis=1)
    return energy, (square * passed).sum(axis=1) / energy


def _cosine(
    gantry: Gantry, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> NDArray[np.float64]:
    """(n,) cosine of the rays to pixels with the detector's normal."""
    spot, height = gantry.focal_spot_above_detector_mm, gantry.focal_spot_height_mm
    away = gantry.detector_xy_mm(rows, columns) - spot[:2]
    cosine: NDArray[np.float64] = height / np.hypot(height, np.linalg.norm(away, axis=-1))
    return cosine


def _noise_kev(
    detector: Detector, kev: NDArray[np.float64], energy: NDArray[np.float64], pixel_mm: float
) -> float:
    """Standard deviation of one pixel's noise, keV, for signals (n,) and variances over them."""
    quantum = float((kev * energy).mean()) * noise_through_blur(detector, pixel_mm)
    pattern = float(((detector.structure_noise * kev) ** 2).mean())
    return math.sqrt(quantum + pattern + detector.electronic_noise_kev**2)
