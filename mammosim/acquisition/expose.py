"""From path lengths to a mammogram: `expose`, and its steps in the order of an exposure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import add_scatter_kernel, log_attenuation_kernel
from mammosim.acquisition.blocks import block_mean
from mammosim.acquisition.coarse import CoarsePaths, coarse_paths
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.dose import DoseFactors, dose_factors
from mammosim.acquisition.exposure import TARGET_SIGNAL_KEV_MM2, dense_signal, kvp_by_thickness
from mammosim.acquisition.mammogram import Mammogram
from mammosim.acquisition.noise import detect
from mammosim.acquisition.presentation import present
from mammosim.acquisition.scatter import scatter_signal
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import Response, primary, rays_of, response
from mammosim.acquisition.spectrum import Beam, make_beam
from mammosim.config import to_settings
from mammosim.projection.paths import PathLengths
from mammosim.tissues import composition

WHITE = 16383  # 14 bits
COUNTS_PER_KEV_MM2 = 3.0e-5  # puts what exposure control aims at near 255 of 16383
CLEAR_OF_WHITE = 1.05  # room for noise above the brightest pixel of air


@dataclass(frozen=True, eq=False)
class _Exposure:
    """What is known of an exposure before the detector records it.

    Signals in keV/pixel. `dense_signal` and `dense_noise` (standard deviation) are those behind
    the dense part of the breast, NaN where no tissue is in the field.
    """

    mas: float
    air_signal: float
    dense_signal: float
    dense_noise: float
    scatter_to_primary: float


def expose(paths: PathLengths, *, seed: int = 1, **keys: Any) -> Mammogram:
    """Expose a compressed breast and record its mammogram.

    Parameters
    ----------
    paths : PathLengths
        Path lengths through each tissue.
    seed : int
        Seed of the noise; the same seed gives the same picture, whatever the number of threads.
    **keys
        Any key of `AcquisitionSettings`.

    Returns
    -------
    Mammogram
        ``for_processing`` is not flat-fielded: it keeps the fall of the beam towards the corners.

    Raises
    ------
    InputError
        If a key is unknown or its value cannot be used.

    Notes
    -----
    Spectrum by SpekPy; primary by Beer and Lambert's law, summed over energies; scatter by
    convolution with kernels of the local thickness; noise of an energy-integrating detector; dose
    by Dance's factors. Not modelled: heel effect, focal-spot blur, off-focus radiation, grid
    lines, glare, lag, dead pixels.
    """
    settings = to_settings(AcquisitionSettings, keys, "expose()", ("acquisition",))
    detector = find_detector(settings.detector)
    materials = composition(settings.composition, settings.calcification)
    beam = _beam(settings, paths)
    distance_mm = paths.gantry.source_to_detector_mm
    unit = response(beam, detector, paths.pixel_mm, distance_mm, settings.support_mm)
    coarse = coarse_paths(paths, materials)

    signal, square = primary(paths, materials, unit)
    ratio = _add_scatter(signal, square, coarse, settings)
    exposure = _expose_for(signal, square, coarse, paths, settings, unit, ratio)
    signal *= np.float32(exposure.mas)
    square *= np.float32(exposure.mas)
    rng = np.random.Generator(np.random.Philox(seed))
    detect(signal, square if settings.noise else None, detector, paths.pixel_mm, rng)
    del square
    return _mammogram(signal, paths, settings, beam, coarse, exposure)


def _beam(settings: AcquisitionSettings, paths: PathLengths) -> Beam:
    kvp = settings.kvp
    if kvp is None:
        kvp = kvp_by_thickness(settings.target, paths.thickness_mm)
    return make_beam(
        settings.target,
        settings.filter,
        kvp,
        filter_mm=settings.filter_mm,
        air_mm=paths.gantry.source_to_detector_mm,
        paddle_mm=settings.paddle_mm,
        spectrum_file=settings.spectrum_file,
    )


def _add_scatter(
    signal: NDArray[np.float32],
    square: NDArray[np.float32],
    coarse: CoarsePaths,
    settings: AcquisitionSettings,
) -> float:
    """Add scatter and let the grid take its part, in place; return scatter over primary.

    The ratio is that in front of the grid, the median over the breast without its margin.
    """
    primary_mean = block_mean(signal, coarse.cell)
    if settings.scatter:
        scatter = scatter_signal(primary_mean, coarse.tissue_mm, coarse.cell_mm)
    else:
        scatter = np.zeros_like(primary_mean)
    parts = (1.0, 1.0)
    if settings.grid:
        parts = (settings.grid_primary_transmission, settings.grid_scatter_transmission)
    add_scatter_kernel(scatter, float(coarse.cell), *parts, signal, square)
    breast = coarse.inside & (primary_mean > 0.0)
    return float(np.median(scatter[breast] / primary_mean[breast])) if breast.any() else 0.0


def _expose_for(
    signal: NDArray[np.float32],
    square: NDArray[np.float32],
    coarse: CoarsePaths,
    paths: PathLengths,
    settings: AcquisitionSettings,
    unit: Response,
    ratio: float,
) -> _Exposure:
    """Find the tube load, and the numbers that go with it."""
    dense = float("nan")
    mean_signal = block_mean(signal, coarse.cell)
    if settings.mas is None or coarse.tissue_mm.any():
        dense = dense_signal(
            mean_signal,
            coarse.tissue_mm,
            coarse.muscle_mm,
            paths.thickness_mm,
            coarse.cell_mm,
        )
    mas = settings.mas
    if mas is None:
        mas = TARGET_SIGNAL_KEV_MM2 * paths.pixel_mm**2 / dense
    # Variance over signal is the mean energy of what is absorbed: nearly the same everywhere.
    energy = float("nan")
    if coarse.inside.any():
        squares = block_mean(square, coarse.cell)[coarse.inside]
        energy = float(squares.sum() / mean_signal[coarse.inside].sum())
    grid = settings.grid_primary_transmission if settings.grid else 1.0
    return _Exposure(
        mas, unit.air_signal * grid * mas, dense * mas, float(np.sqrt(energy * dense * mas)), ratio
    )


def _mammogram(
    signal: NDArray[np.float32],
    paths: PathLengths,
    settings: AcquisitionSettings,
    beam: Beam,
    coarse: CoarsePaths,
    exposure: _Exposure,
) -> Mammogram:
    """Images and technique of a recorded signal (keV/pixel), which is overwritten."""
    gantry = paths.gantry
    counts_per_kev = _counts_per_kev(exposure.air_signal / gantry.pixel_mm**2) / gantry.pixel_mm**2
    for_processing = _to_counts(signal, counts_per_kev)
    log_attenuation_kernel(signal, exposure.air_signal, rays_of(gantry), signal)
    picture = present(signal, gantry.pixel_mm)

    entrance_mm = gantry.source_to_detector_mm - gantry.support_to_detector_mm - paths.thickness_mm
    kerma = beam.kerma_mgy_mas(entrance_mm) * exposure.mas
    factors = dose_factors(
        beam.hvl_mm_al,
        paths.thickness_mm,
        float(np.nan_to_num(coarse.glandularity_percent, nan=50.0)),
        beam.target,
        beam.filter,
    )
    detector_kerma = beam.kerma_mgy_mas(gantry.source_to_detector_mm) * exposure.mas
    return Mammogram(
        for_processing=for_processing,
        for_presentation=picture.pixels,
        window_center=picture.window_center,
        window_width=picture.window_width,
        gantry=gantry,
        thickness_mm=paths.thickness_mm,
        force_n=paths.force_n,
        target=beam.target,
        filter=beam.filter,
        filter_mm=beam.filter_mm,
        kvp=beam.kvp,
        mas=exposure.mas,
        hvl_mm_al=beam.hvl_mm_al,
        air_kerma_mgy=kerma,
        dose_mgy=kerma * factors.product,
        grid=settings.grid,
        measures={
            **_quality(exposure, detector_kerma),
            **_breast(coarse, factors),
            "counts_per_kev": counts_per_kev,
        },
        notes=factors.notes,
    )


def _counts_per_kev(air_kev_mm2: float) -> float:
    """Pixel value per keV/mm2: halved, as a detector's ranges are, until air stays below white."""
    gain = COUNTS_PER_KEV_MM2
    while air_kev_mm2 * CLEAR_OF_WHITE * gain > WHITE:
        gain *= 0.5
    return gain


def _to_counts(signal: NDArray[np.float32], counts_per_kev: float) -> NDArray[np.uint16]:
    counts = np.empty(signal.shape, np.uint16)
    for row, line in enumerate(signal):
        counts[row] = np.clip(np.rint(line * counts_per_kev), 0, WHITE)
    return counts


def _quality(exposure: _Exposure, detector_kerma_mgy: float) -> dict[str, float]:
    """Numbers of the picture behind the dense part of the breast."""
    transmission = exposure.dense_signal / exposure.air_signal
    return {
        "scatter_to_primary_ratio": exposure.scatter_to_primary,
        "transmission": transmission,
        "relative_quantum_noise": exposure.dense_noise / exposure.dense_signal,
        # 100 times the air kerma in uGy that would leave this signal: IEC 62494-1, but for this
        # beam instead of the standard's.
        "exposure_index": 100.0 * transmission * detector_kerma_mgy * 1000.0,
    }


def _breast(coarse: CoarsePaths, factors: DoseFactors) -> dict[str, float]:
    return {
        "volumetric_density_percent": coarse.density_percent,
        "glandularity_percent": coarse.glandularity_percent,
        "dose_factor_g": factors.g,
        "dose_factor_c": factors.c,
        "dose_factor_s": factors.s,
    }
