"""What the detector records: beam, primary, scatter, tube load and noise, in that order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import add_scatter_kernel
from mammosim.acquisition.blocks import block_mean
from mammosim.acquisition.blur import blur_shadow, spot_width_mm
from mammosim.acquisition.coarse import CoarsePaths, coarse_paths
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.exposure import TARGET_SIGNAL_KEV_MM2, dense_signal, kvp_by_thickness
from mammosim.acquisition.noise import detect
from mammosim.acquisition.scatter import SCATTER_MODELS, ScatterCase
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import Response, primary, response
from mammosim.acquisition.spectrum import Beam, make_beam
from mammosim.compression import CompressedBreast
from mammosim.projection import PathLengths
from mammosim.tissues import composition


@dataclass(frozen=True, eq=False)
class Arrival:
    """What reaches the detector for one mAs, before it is recorded.

    Parameters
    ----------
    paths : PathLengths
    settings : AcquisitionSettings
    beam : Beam
    unit : Response
    coarse : CoarsePaths
    signal, square : ndarray of float32, [row, column]
        Energy a pixel behind the grid, keV/mAs, and its second moment, keV2/mAs.
    scatter_to_primary : float
        In front of the grid, the median over the breast without its margin.
    """

    paths: PathLengths
    settings: AcquisitionSettings
    beam: Beam
    unit: Response
    coarse: CoarsePaths
    signal: NDArray[np.float32]
    square: NDArray[np.float32]
    scatter_to_primary: float

    @property
    def air_signal(self) -> float:
        """Signal of air behind the grid where it is brightest, keV/(pixel mAs)."""
        grid = self.settings.grid_primary_transmission if self.settings.grid else 1.0
        return self.unit.air_signal * grid

    @property
    def dense_signal(self) -> float:
        """Signal behind the dense part of the breast, keV/(pixel mAs); NaN without tissue."""
        if not self.coarse.tissue_mm.any() and self.settings.mas is not None:
            return float("nan")
        return dense_signal(
            block_mean(self.signal, self.coarse.cell),
            self.coarse.tissue_mm,
            self.coarse.muscle_mm,
            self.paths.thickness_mm,
            self.coarse.cell_mm,
        )

    @property
    def mean_energy_kev(self) -> float:
        """Variance over signal in the breast: nearly the same everywhere; NaN without tissue."""
        inside = self.coarse.inside
        if not inside.any():
            return float("nan")
        square, signal = (block_mean(part, self.coarse.cell) for part in (self.square, self.signal))
        return float(square[inside].sum() / signal[inside].sum())

    def controlled_mas(self) -> float:
        """Tube load that the settings give, or that exposure control finds, mAs."""
        if self.settings.mas is not None:
            return self.settings.mas
        return TARGET_SIGNAL_KEV_MM2 * self.paths.pixel_mm**2 / self.dense_signal


@dataclass(frozen=True)
class Exposure:
    """An exposure in numbers; signals in keV/pixel.

    `dense_signal` and `dense_noise` (standard deviation of quantum noise) are those behind the
    dense part of the breast, NaN where no tissue is in the field.
    """

    mas: float
    air_signal: float
    dense_signal: float
    dense_noise: float


def arrive(
    paths: PathLengths, settings: AcquisitionSettings, breast: CompressedBreast | None = None
) -> Arrival:
    """What reaches the detector: primary, blurred by focal spot and pixel, and scatter.

    Parameters
    ----------
    paths : PathLengths
    settings : AcquisitionSettings
    breast : CompressedBreast, optional
        Voxels for scatter models that want them, in place of `paths.breast`.
    """
    materials = composition(settings.composition, settings.calcification)
    beam = beam_for(settings, paths)
    detector = find_detector(settings.detector)
    unit = response(beam, detector, paths.gantry, settings.support_mm, heel=settings.heel)
    coarse = coarse_paths(paths, materials)
    signal, square = primary(paths, materials, unit)
    middle_mm = 0.5 * paths.thickness_mm
    spot_mm = spot_width_mm(settings.focal_spot_mm, paths.gantry, middle_mm)
    blur_shadow(signal, square, paths.pixel_mm, spot_mm)
    case = ScatterCase(
        block_mean(signal, coarse.cell), coarse.tissue_mm, coarse.cell, paths.gantry, beam,
        detector, settings.support_mm, materials, breast or paths.breast,
    )  # fmt: skip
    scatter = SCATTER_MODELS[settings.scatter_model](case)
    ratio = _add_scatter(signal, square, scatter, case.primary, coarse, settings)
    return Arrival(paths, settings, beam, unit, coarse, signal, square, ratio)


def beam_for(settings: AcquisitionSettings, paths: PathLengths) -> Beam:
    """The beam that the settings ask for, its voltage by the thickness where they leave it open."""
    kvp = settings.kvp
    if kvp is None and settings.spectrum_file is None:
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
    scatter: NDArray[np.float64],
    primary_mean: NDArray[np.float64],
    coarse: CoarsePaths,
    settings: AcquisitionSettings,
) -> float:
    """Add scatter and let the grid take its part, in place; return scatter over primary.

    The ratio is that in front of the grid, the median over the breast without its margin.
    """
    parts = (1.0, 1.0)
    if settings.grid:
        parts = (settings.grid_primary_transmission, settings.grid_scatter_transmission)
    add_scatter_kernel(scatter, float(coarse.cell), *parts, signal, square)
    breast = coarse.inside & (primary_mean > 0.0)
    return float(np.median(scatter[breast] / primary_mean[breast])) if breast.any() else 0.0


def record(
    arrival: Arrival, mas: float, rng: np.random.Generator
) -> tuple[NDArray[np.float32], Exposure]:
    """Let the detector record an exposure.

    Parameters
    ----------
    arrival : Arrival
        Its images are overwritten.
    mas : float
        Tube load, mAs.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    signal : ndarray of float32, [row, column]
        Recorded energy, keV/pixel.
    exposure : Exposure
    """
    dense = arrival.dense_signal * mas
    noise = float(np.sqrt(arrival.mean_energy_kev * dense))
    exposure = Exposure(mas, arrival.air_signal * mas, dense, noise)
    signal, square = arrival.signal, arrival.square
    signal *= np.float32(mas)
    square *= np.float32(mas)
    detector = find_detector(arrival.settings.detector)
    variance = square if arrival.settings.noise else None
    detect(signal, variance, detector, arrival.paths.pixel_mm, rng)
    return signal, exposure
