"""What the detector records: beam, primary, scatter, tube load and noise, in that order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import add_scatter_kernel
from mammosim.acquisition.attenuation import BEAM_MATERIALS
from mammosim.acquisition.blocks import block_mean
from mammosim.acquisition.blur import blur_shadow, spot_width_mm
from mammosim.acquisition.coarse import CoarsePaths, coarse_paths
from mammosim.acquisition.contrast_agent import materials_of
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.exposure import (
    MAX_CONTROLLED_MAS,
    TARGET_SIGNAL_KEV_MM2,
    dense_signal,
    kvp_by_thickness,
)
from mammosim.acquisition.grid_parts import grid_of, primary_part, scatter_behind_grid
from mammosim.acquisition.noise import detect
from mammosim.acquisition.scatter import SCATTER_MODELS, Scatter, ScatterCase
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import Response, primary, response
from mammosim.acquisition.spectrum import Beam, make_beam
from mammosim.compression import CompressedBreast
from mammosim.geometry import Gantry
from mammosim.projection import PathLengths

ScatterModel = Callable[[ScatterCase], Scatter]
"""A scatter model, as those of `SCATTER_MODELS`."""


@dataclass(frozen=True, eq=False)
class DetectorInput:
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
    scatter : Scatter
        What the scatter model found.
    primary : ndarray of float32, [row, column], or None
        Primary signal in front of the grid, not blurred, keV/mAs.
    scatter_part : float
        Part of the breast's scatter that the grid lets through.
    """

    paths: PathLengths
    settings: AcquisitionSettings
    beam: Beam
    unit: Response
    coarse: CoarsePaths
    signal: NDArray[np.float32]
    square: NDArray[np.float32]
    scatter_to_primary: float
    scatter: Scatter
    primary: NDArray[np.float32] | None = None
    scatter_part: float = 1.0

    @property
    def air_signal(self) -> float:
        """Signal of air behind the grid where it is brightest, keV/(pixel mAs)."""
        return self.unit.air_signal * primary_part(self.settings, self.unit)

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
            self.paths.gantry.view.spot,
        )

    @property
    def mean_energy_kev(self) -> float:
        """Variance over signal in the breast: nearly the same everywhere; NaN without tissue."""
        inside = self.coarse.inside
        if not inside.any():
            return float("nan")
        square, signal = (block_mean(part, self.coarse.cell) for part in (self.square, self.signal))
        return float(square[inside].sum() / signal[inside].sum())

    @property
    def wanted_mas(self) -> float:
        """Tube load that the settings give, or that the detector's signal asks for, mAs."""
        if self.settings.mas is not None:
            return self.settings.mas
        signal, dense = TARGET_SIGNAL_KEV_MM2 * self.paths.pixel_mm**2, self.dense_signal
        return signal / dense if dense > 0.0 else np.inf

    def controlled_mas(self, wanted_mas: float) -> float:
        """The wanted tube load, which exposure control limits and the settings do not, mAs."""
        if self.settings.mas is not None:
            return wanted_mas
        return min(wanted_mas, MAX_CONTROLLED_MAS)


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


def detector_input(
    paths: PathLengths,
    settings: AcquisitionSettings,
    breast: CompressedBreast | None = None,
    *,
    seed: int = 1,
    dose_map: bool = False,
    keep_primary: bool = False,
    scatter_model: ScatterModel | None = None,
) -> DetectorInput:
    """What reaches the detector: primary, blurred by focal spot and pixel, and scatter.

    Parameters
    ----------
    paths : PathLengths
    settings : AcquisitionSettings
    breast : CompressedBreast, optional
        Voxels for scatter models that want them, in place of `paths.breast`.
    seed : int
        Seed of the scatter model's random numbers.
    dose_map : bool
        Whether the dose of every voxel is wanted.
    keep_primary : bool
        Whether the primary is kept by itself.
    scatter_model : callable, optional
        In place of the one that the settings name.
    """
    materials = materials_of(settings)
    beam = beam_for(settings, paths)
    unit = response_for(settings, beam, paths.gantry)
    coarse = coarse_paths(paths, materials)
    signal, square = primary(paths, materials, unit)
    kept = signal.copy() if keep_primary else None
    middle_mm = 0.5 * paths.thickness_mm
    spot_mm = spot_width_mm(settings.focal_spot_mm, paths.gantry, middle_mm)
    blur_shadow(signal, square, paths.pixel_mm, spot_mm)
    case = scatter_case(
        block_mean(signal, coarse.cell), coarse.tissue_mm, coarse.cell, paths.gantry, beam,
        settings, breast or paths.breast, seed=seed, dose_map=dose_map,
    )  # fmt: skip
    scatter = (scatter_model or SCATTER_MODELS[settings.scatter_model])(case)
    behind = scatter_behind_grid(scatter, settings, coarse.inside)
    add_scatter_kernel(
        behind, float(coarse.cell), primary_part(settings, unit), 1.0, signal, square
    )
    ratio = _median_ratio(scatter.signal, case.primary, coarse)
    before = scatter.signal[coarse.inside].sum()
    part = float(behind[coarse.inside].sum() / before) if before > 0.0 else 1.0
    return DetectorInput(
        paths, settings, beam, unit, coarse, signal, square, ratio, scatter, kept, part
    )


def scatter_case(
    primary: NDArray[np.float64],
    thickness_mm: NDArray[np.float64],
    cell: int,
    gantry: Gantry,
    beam: Beam,
    settings: AcquisitionSettings,
    breast: CompressedBreast | None,
    *,
    seed: int = 1,
    dose_map: bool = False,
) -> ScatterCase:
    """An exposure as the scatter model sees it."""
    chosen = settings.scatter
    return ScatterCase(
        primary, thickness_mm, cell, gantry, beam, find_detector(settings.detector),
        settings.support_mm, materials_of(settings), breast,
        support=BEAM_MATERIALS[settings.support_material], paddle_mm=settings.paddle_mm,
        grid=grid_of(settings), heel=settings.heel,
        photons=None if isinstance(chosen, bool) else chosen.photons, seed=seed, dose_map=dose_map,
    )  # fmt: skip


def response_for(settings: AcquisitionSettings, beam: Beam, gantry: Gantry) -> Response:
    """What a unit of exposure leaves in a pixel behind nothing but air and plates."""
    return response(
        beam, find_detector(settings.detector), gantry, settings.support_mm,
        support_material=settings.support_material, heel=settings.heel,
    )  # fmt: skip


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


def _median_ratio(
    scatter: NDArray[np.float64], primary_mean: NDArray[np.float64], coarse: CoarsePaths
) -> float:
    """Scatter over primary in front of the grid, the median over the breast without its margin."""
    breast = coarse.inside & (primary_mean > 0.0)
    return float(np.median(scatter[breast] / primary_mean[breast])) if breast.any() else 0.0


def record(
    incident: DetectorInput, mas: float, rng: np.random.Generator
) -> tuple[NDArray[np.float32], Exposure]:
    """Let the detector record an exposure.

    Parameters
    ----------
    incident : DetectorInput
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
    dense = incident.dense_signal * mas
    noise = float(np.sqrt(incident.mean_energy_kev * dense))
    exposure = Exposure(mas, incident.air_signal * mas, dense, noise)
    signal, square = incident.signal, incident.square
    signal *= np.float32(mas)
    square *= np.float32(mas)
    detector = find_detector(incident.settings.detector)
    variance = square if incident.settings.noise else None
    detect(signal, variance, detector, incident.paths.pixel_mm, rng)
    return signal, exposure
