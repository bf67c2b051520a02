"""A series of projections for tomosynthesis: one dose split over many tube positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition._kernels import log_attenuation_kernel
from mammosim.acquisition.coarse import CoarsePaths
from mammosim.acquisition.expose import (
    COUNTS_PER_KEV_MM2,
    counts_per_kev_mm2,
    mammogram_of,
    noise_stream,
    to_counts,
)
from mammosim.acquisition.exposure_limits import with_warnings
from mammosim.acquisition.keys import AcquisitionKeys
from mammosim.acquisition.mammogram import Mammogram
from mammosim.acquisition.recording import DetectorInput, detector_input, record
from mammosim.acquisition.scatter_sweep import scatter_sweep
from mammosim.acquisition.settings import AcquisitionSettings
from mammosim.acquisition.signal import rays_of
from mammosim.config import documents_keys, given_settings
from mammosim.geometry import Gantry
from mammosim.projection import Arc, PathLengths


@dataclass(frozen=True, eq=False)
class Tomosynthesis:
    """Projections of one compressed breast, for a reconstruction to start from.

    Parameters
    ----------
    projections : ndarray of uint16, [projection, row, column]
        Linear in exposure, with one scale for all; air is bright.
    gantries : tuple of Gantry
        Where the tube was for each projection, and the detector for all.
    middle : Mammogram
        The projection nearest to the upright tube, with its own share of load and dose.
    mas, air_kerma_mgy, dose_mgy : float
        Tube load, incident air kerma at the upright position and mean glandular dose of all
        projections together, mAs, mGy and mGy.
    loads_mas : ndarray of float64, [projection]
        Tube load of each projection, mAs.
    dose_factors : ndarray of float64, [projection]
        Glandular dose at each angle over that of the upright tube for the same load, t(angle);
        from Monte Carlo, and 1 where another scatter model ran.
    counts_per_kev : float
        Pixel value for one keV absorbed in a pixel.
    air_counts : ndarray of float64, [projection, column or 1]
        Pixel value of air for a ray at right angles to the detector.
    flat_depth : ndarray of float64, [projection]
        Attenuation of the flat layers in the way of such a ray; no unit.
    shadows : ndarray of int64, [projection, 4]
        First and last row (exclusive) and first and last column (exclusive) of the cells of about
        2 mm that the breast's shadow meets; all 0 where it meets none.
    scatter_to_primary : ndarray of float64, [projection]
        In front of the grid, the median over the breast without its margin.
    """

    projections: NDArray[np.uint16]
    gantries: tuple[Gantry, ...]
    middle: Mammogram
    mas: float
    air_kerma_mgy: float
    dose_mgy: float
    loads_mas: NDArray[np.float64]
    dose_factors: NDArray[np.float64]
    counts_per_kev: float
    air_counts: NDArray[np.float64]
    flat_depth: NDArray[np.float64]
    shadows: NDArray[np.int64]
    scatter_to_primary: NDArray[np.float64]

    def attenuation(self, index: int) -> NDArray[np.float32]:
        """Line integrals of the attenuation coefficient in one projection, [row, column].

        The logarithm of air's signal over each pixel's own; obliqueness and the flat layers
        (paddle, support, air) are taken out. Scatter is not removed.
        """
        gantry = self.gantries[index]
        signal = self.projections[index].astype(np.float32)
        log_attenuation_kernel(
            signal, self.air_counts[index], float(self.flat_depth[index]), rays_of(gantry), signal
        )
        return signal

    @property
    def mean_dose_factor(self) -> float:
        """Mean of t(angle), each weighted by its load."""
        return float(np.average(self.dose_factors, weights=self.loads_mas))

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings, one sentence each."""
        return self.middle.notes


@documents_keys(AcquisitionSettings, AcquisitionKeys)
def expose_arc(
    arc: Arc,
    settings: AcquisitionSettings | None = None,
    *,
    seed: int = 1,
    watch: Callable[[int, PathLengths], None] | None = None,
    **keys: Unpack[AcquisitionKeys],
) -> Tomosynthesis:
    """Expose a compressed breast once from each tube position of an arc.

    Parameters
    ----------
    arc : Arc
        From `project_arc`; each projection is traced when its turn comes.
    settings : AcquisitionSettings, optional
        Spectrum, detector and exposure; or give its keys as keywords.
    seed : int
        Seed of the noise, which is another one in each projection.
    watch : callable, optional
        Given each projection's index and path lengths when they have been traced: the middle one
        first, then in their order.
    **keys
        Keys of `AcquisitionSettings`. `mas` is the load of all projections together; without
        it, exposure control finds the load that a mammogram with grid would need, so that the
        dose is a mammogram's. There is no grid unless asked for: its lines would cut off oblique
        rays.

    Returns
    -------
    Tomosynthesis

    Raises
    ------
    InputError
        If a key is unknown or its value cannot be used.

    Notes
    -----
    The load is split by `TomosynthesisSettings.shares`, evenly without them. Monte Carlo follows
    photons at three to five angles; scatter and dose of the others are interpolated. The dose of
    all projections is the sum of each one's load times t(angle), the dose at its angle over that of
    the upright tube, as Dance, Young & van Engen (2011, Phys Med Biol 56:453) define it; it is
    taken from Monte Carlo's own photons in this breast, not from their tables. Other scatter models
    take t as 1, and a note says so. Not modelled: movement of the tube during an exposure, lag,
    grid cut-off.
    """
    settings = given_settings(AcquisitionSettings, settings, keys, "expose_arc()", ("acquisition",))
    settings = settings.of_unit(seed)
    if "grid" not in settings.model_fields_set:
        settings = settings.model_copy(update={"grid": False})
    watch = watch or (lambda index, paths: None)
    count, middle = len(arc), arc.middle
    paths = arc.paths(middle)
    watch(middle, paths)
    sweep = scatter_sweep(arc.gantries, paths, arc.compressed, settings, seed)
    wanted_mas = settings.mas
    if wanted_mas is None:
        with_grid = detector_input(paths, _with_grid(settings), scatter_model=sweep)
        wanted_mas = with_grid.wanted_mas
        settings = settings.model_copy(update={"mas": with_grid.controlled_mas(wanted_mas)})
    parts = np.array(arc.settings.load_parts)
    incident = detector_input(paths, settings, scatter_model=sweep, keep_primary=True)
    total_mas = incident.wanted_mas
    loads = total_mas * parts
    pixel_mm2 = incident.paths.pixel_mm**2
    # A turned tube is nearer to the detector's plane, and air brighter by the square of that.
    nearest = min(gantry.focal_spot_height_mm for gantry in arc.gantries)
    closer = (arc.gantries[middle].focal_spot_height_mm / nearest) ** 2
    air_kev_mm2 = incident.air_signal * loads.max() * closer / pixel_mm2
    gain = counts_per_kev_mm2(air_kev_mm2, COUNTS_PER_KEV_MM2 / parts.max()) / pixel_mm2

    gantry = arc.gantries[middle]
    stack = np.empty((count, gantry.rows, gantry.columns), np.uint16)
    known = {middle: _ProjectionFacts.of(incident, loads[middle] * gain)}
    signal, exposure = record(incident, loads[middle], _noise_of(settings, seed, middle))
    shown = mammogram_of(incident, exposure, signal, gain)
    factors = np.ones(count)
    if sweep is not None:
        factors = sweep.dose_factors([turned.tube_angle_deg for turned in arc.gantries])
    dose_mgy = shown.dose_mgy * float(parts @ factors / (parts[middle] * factors[middle]))
    whole = {"projections": float(count), "dose_of_all_projections_mgy": dose_mgy}
    shown = replace(shown, measures={**shown.measures, **whole})
    unknown = {}
    if sweep is None:
        unknown["unknown_dose_angle_deg"] = max(abs(one.tube_angle_deg) for one in arc.gantries)
    shown = with_warnings(shown, incident, wanted_mas, 1.0 / float(parts[middle]), unknown)
    stack[middle] = shown.for_processing
    del incident, signal, paths
    for index in (*range(middle), *range(middle + 1, count)):
        turned = arc.paths(index)
        watch(index, turned)
        incident = detector_input(turned, settings, scatter_model=sweep)
        known[index] = _ProjectionFacts.of(incident, loads[index] * gain)
        signal, _ = record(incident, loads[index], _noise_of(settings, seed, index))
        stack[index] = to_counts(signal, gain)
    in_order = [known[index] for index in range(count)]
    return Tomosynthesis(
        stack, arc.gantries, shown, total_mas, shown.air_kerma_mgy / parts[middle], dose_mgy, loads,
        factors, gain, np.stack([one.air_counts for one in in_order]),
        np.array([one.flat_depth for one in in_order]),
        np.array([one.shadow for one in in_order]),
        np.array([one.scatter_to_primary for one in in_order]),
    )  # fmt: skip


class _ProjectionFacts(NamedTuple):
    """What `Tomosynthesis` keeps of one projection besides its pixels."""

    air_counts: NDArray[np.float64]
    flat_depth: float
    shadow: tuple[int, int, int, int]
    scatter_to_primary: float

    @classmethod
    def of(cls, incident: DetectorInput, counts_mas_per_kev: float) -> _ProjectionFacts:
        profile = incident.air_signal * incident.unit.air_profile
        return cls(
            counts_mas_per_kev * profile,
            incident.unit.weights.mean_depth,
            _shadow_of(incident.coarse, incident.paths.gantry),
            incident.scatter_to_primary,
        )


def _shadow_of(coarse: CoarsePaths, gantry: Gantry) -> tuple[int, int, int, int]:
    """Rows and columns of the cells with any tissue."""
    rows, columns = (np.flatnonzero(coarse.tissue_mm.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return 0, 0, 0, 0
    cell = coarse.cell
    return (
        int(rows[0]) * cell, min((int(rows[-1]) + 1) * cell, gantry.rows),
        int(columns[0]) * cell, min((int(columns[-1]) + 1) * cell, gantry.columns),
    )  # fmt: skip


def _with_grid(settings: AcquisitionSettings) -> AcquisitionSettings:
    """The settings of the mammogram whose dose a series is given."""
    part = settings.grid_scatter_transmission
    default = AcquisitionSettings.model_fields["grid_scatter_transmission"].default
    return settings.model_copy(
        update={"grid": True, "grid_scatter_transmission": default if part is None else part}
    )


def _noise_of(settings: AcquisitionSettings, seed: int, index: int) -> np.random.Generator:
    """Noise of one projection, whatever order they are made in."""
    return np.random.Generator(noise_stream(settings, seed, index + 1))
