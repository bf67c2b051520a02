"""From path lengths to a mammogram: `expose`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import one_blas_thread
from mammosim.acquisition._kernels import log_attenuation_kernel
from mammosim.acquisition.coarse import CoarsePaths
from mammosim.acquisition.contrast import (
    high_energy_mas,
    high_energy_settings,
    primary_attenuation,
    recombine,
)
from mammosim.acquisition.dose import DoseFactors, dose_factors
from mammosim.acquisition.exposure import under_spot_paddle
from mammosim.acquisition.exposure_limits import WHITE, with_warnings
from mammosim.acquisition.fat_level import fat_attenuation
from mammosim.acquisition.keys import AcquisitionKeys
from mammosim.acquisition.looks import look_of
from mammosim.acquisition.mammogram import ContrastPair, Dose, GlandularDose, Mammogram
from mammosim.acquisition.presentation import present
from mammosim.acquisition.recording import DetectorInput, Exposure, detector_input, record
from mammosim.acquisition.settings import AcquisitionSettings, ContrastSettings
from mammosim.acquisition.signal import rays_of
from mammosim.compression import CompressedBreast
from mammosim.config import documents_keys, given_settings
from mammosim.projection import PathLengths

IMPLANTS = frozenset({"silicone", "saline"})  # materials of implants
COUNTS_PER_KEV_MM2 = 3.0e-5  # puts what exposure control aims at near 255 of 16383
CLEAR_OF_WHITE = 1.05  # room for noise above the brightest pixel of air


@one_blas_thread
@documents_keys(AcquisitionSettings, AcquisitionKeys)
def expose(
    paths: PathLengths,
    settings: AcquisitionSettings | None = None,
    *,
    seed: int = 1,
    breast: CompressedBreast | None = None,
    dose_map: bool = False,
    watch: Callable[[int, Mammogram], None] | None = None,
    **keys: Unpack[AcquisitionKeys],
) -> Mammogram:
    """Expose a compressed breast and record its mammogram.

    Parameters
    ----------
    paths : PathLengths
        Path lengths through each tissue.
    settings : AcquisitionSettings, optional
        Spectrum, detector and exposure; or give its keys as keywords.
    seed : int
        Seed of the noise; the same seed gives the same picture, whatever the number of threads.
    breast : CompressedBreast, optional
        The voxels, for scatter models that trace photons through them; default `paths.breast`,
        which `project` sets and loaded path lengths do not have.
    dose_map : bool
        Whether the dose of every voxel of the breast's coarse copy is kept (monte-carlo only).
    watch : callable, optional
        Called with the number, from 1, and the mammogram of each of several `realisations`.
        Without it only the first is made, which is returned.
    **keys
        Keys of `AcquisitionSettings`: ``target``, ``kvp``, ``mas``, ...

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
    Spectrum by SpekPy; primary by Beer and Lambert's law, summed over energies and blurred by
    focal spot and pixel; scatter and dose by Monte Carlo through a coarse copy of the breast, or,
    where only path lengths are known, by layers built from them and by Dance's factors; noise of
    an energy-integrating detector. Not modelled: off-focus radiation, grid lines, glare, lag, dead
    pixels.
    """
    settings = given_settings(AcquisitionSettings, settings, keys, "expose()", ("acquisition",))
    settings = settings.of_unit(seed)
    incident = detector_input(
        paths, settings, breast, seed=seed, dose_map=dose_map, keep_primary=True
    )
    draws = 1 if watch is None or settings.realisations is None else settings.realisations
    kept = _copied(incident) if draws > 1 else incident
    image = _recorded(incident, seed, breast)
    if watch is not None and draws > 1:
        watch(1, image)
        for number in range(2, draws + 1):
            watch(number, _recorded(_copied(kept), seed, breast, number))
    return image


def _copied(incident: DetectorInput) -> DetectorInput:
    """A copy of the input with its own images and without the separate primary."""
    return replace(
        incident, signal=incident.signal.copy(), square=incident.square.copy(), primary=None
    )


def noise_stream(settings: AcquisitionSettings, seed: int, number: int = 1) -> np.random.Philox:
    """Source of the noise of one draw, or of one projection of a series, counted from 1."""
    own = 0 if settings.noise_seed is None else settings.noise_seed + 1
    of_draw = (number,) if number > 1 else ()
    return np.random.Philox(np.random.SeedSequence([seed, own], spawn_key=of_draw))


def _recorded(
    incident: DetectorInput, seed: int, breast: CompressedBreast | None, number: int = 1
) -> Mammogram:
    """One exposure of what arrives, whose images are overwritten."""
    settings = incident.settings
    rng = np.random.Generator(noise_stream(settings, seed, number))
    wanted_mas = incident.wanted_mas  # while the signal is still that of 1 mAs
    signal, exposure = record(incident, incident.controlled_mas(wanted_mas), rng)
    gain = _counts_per_kev(exposure, incident.paths)
    if settings.contrast is None:
        image = mammogram_of(incident, exposure, signal, gain)
    else:
        attenuation = primary_attenuation(incident, signal, exposure)
        image = mammogram_of(incident, exposure, signal, gain)
        agent = settings.contrast
        image = _with_contrast(image, incident, attenuation, agent, breast, seed, number)
    return with_warnings(image, incident, wanted_mas)


def _with_contrast(
    image: Mammogram,
    low: DetectorInput,
    attenuation: NDArray[np.float32],
    agent: ContrastSettings,
    breast: CompressedBreast | None,
    seed: int,
    number: int,
) -> Mammogram:
    """The low-energy mammogram with its high-energy exposure and the image of iodine."""
    settings = high_energy_settings(low.settings, agent)
    high = detector_input(low.paths, settings, breast, seed=seed)
    dose, factors = dose_of(high, 1.0)
    mas = high_energy_mas(agent, image.dose_mgy, dose.mgd_mgy)
    high = replace(high, settings=settings.model_copy(update={"mas": mas}))
    rng = np.random.Generator(noise_stream(low.settings, seed, number).jumped())
    signal, exposure = record(high, mas, rng)
    iodine = recombine(low, high, attenuation, primary_attenuation(high, signal, exposure))
    exposed = mammogram_of(high, exposure, signal, _counts_per_kev(exposure, low.paths))
    pair = ContrastPair(with_warnings(exposed, high, mas), iodine)
    known = {*image.notes, *(factors.notes if exposed.dose_method == "monte-carlo" else ())}
    new = [f"high energy: {note}" for note in pair.high_energy.notes if note not in known]
    return replace(
        image, contrast=pair, notes=(*image.notes, *new),
        measures={**image.measures, **_contrast(pair)},
    )  # fmt: skip


def _contrast(pair: ContrastPair) -> dict[str, float]:
    """Technique of the high-energy exposure, and of the recombination."""
    return {
        "high_energy_kvp": pair.high_energy.kvp,
        "high_energy_mas": pair.high_energy.mas,
        "high_energy_dose_mgy": pair.high_energy.dose_mgy,
        "recombination_weight": pair.iodine.weight,
    }


def mammogram_of(
    incident: DetectorInput, exposure: Exposure, signal: NDArray[np.float32], counts_per_kev: float
) -> Mammogram:
    """Images and technique of a recorded signal (keV/pixel), which is overwritten."""
    paths, settings, beam, coarse = (
        incident.paths,
        incident.settings,
        incident.beam,
        incident.coarse,
    )
    gantry = paths.gantry
    for_processing = to_counts(signal, counts_per_kev)
    air_signal = exposure.air_signal * incident.unit.air_profile
    mean_depth = incident.unit.weights.mean_depth
    log_attenuation_kernel(signal, air_signal, mean_depth, rays_of(gantry), signal)
    spot = gantry.view.spot
    pressed = under_spot_paddle(coarse.tissue_mm, paths.thickness_mm) if spot else None
    look = look_of(settings.look, settings.unit_seed)
    picture = present(signal, gantry.pixel_mm, fat_attenuation(incident), look, pressed)

    dose, factors = dose_of(incident, exposure.mas)
    detector_kerma = beam.kerma_mgy_mas(gantry.focal_spot_height_mm) * exposure.mas
    kept = incident.primary
    if kept is not None:
        kept *= np.float32(exposure.mas)
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
        air_kerma_mgy=entrance_kerma_mgy(incident, exposure.mas),
        dose_mgy=dose.mgd_mgy,
        grid=settings.grid,
        measures={
            "scatter_to_primary_ratio": incident.scatter_to_primary,
            **_quality(exposure, detector_kerma),
            **_breast(coarse, factors),
            **_contact(paths),
            **_scatter(incident),
            **_dose(dose),
            "counts_per_kev": counts_per_kev,
        },
        notes=(*paths.notes, *incident.scatter.notes, *factors.notes),
        detector=settings.detector,
        focal_spot_mm=settings.focal_spot_mm,
        automatic_exposure=settings.mas is None,
        primary=kept,
        scatter_cells=incident.scatter.signal * exposure.mas,
        cell_px=coarse.cell,
        scatter_model=incident.scatter.model or settings.scatter_model,
        dose=dose,
        implant=not IMPLANTS.isdisjoint(paths.materials),
    )


def entrance_kerma_mgy(incident: DetectorInput, mas: float) -> float:
    """Incident air kerma at the breast's upper surface below the paddle, mGy."""
    gantry, thickness_mm = incident.paths.gantry, incident.paths.thickness_mm
    entrance_mm = gantry.source_to_detector_mm - gantry.support_to_detector_mm - thickness_mm
    return incident.beam.kerma_mgy_mas(entrance_mm) * mas


def dose_of(incident: DetectorInput, mas: float) -> tuple[Dose, DoseFactors]:
    """Dose of an exposure by every available method, and Dance's factors.

    Dance means the gland's share of the breast under 5 mm of fat. Only where the voxels are known
    is that known; otherwise the share inside the skin is used.
    """
    beam, coarse, found = incident.beam, incident.coarse, incident.scatter.dose
    kerma = entrance_kerma_mgy(incident, mas)
    glandularity = coarse.glandularity_percent
    if found is not None and np.isfinite(found.core_glandularity_percent):
        glandularity = found.core_glandularity_percent
    factors = dose_factors(
        beam.hvl_mm_al,
        incident.paths.thickness_mm,
        float(np.nan_to_num(glandularity, nan=50.0)),
        beam.target,
        beam.filter,
    )
    by = {"dance": GlandularDose(kerma * factors.product, factors.product)}
    if found is None or not np.isfinite(found.gland_in_field_mgy_mas):
        return Dose("dance", by), factors
    mgd = found.gland_in_field_mgy_mas * mas
    by["monte-carlo"] = GlandularDose(mgd, mgd / kerma)
    dose_map = found.dose_map
    if dose_map is not None:
        dose_map = replace(dose_map, mgy=dose_map.mgy * np.float32(mas))
    materials = {name: value * mas for name, value in found.material_mgy_mas.items()}
    return Dose(
        "monte-carlo", by, found.gland_mgy_mas * mas, found.gland_error, materials, dose_map
    ), factors


def _counts_per_kev(exposure: Exposure, paths: PathLengths) -> float:
    """Pixel value for one keV absorbed in a pixel."""
    pixel_mm2 = paths.pixel_mm**2
    return counts_per_kev_mm2(exposure.air_signal / pixel_mm2) / pixel_mm2


def counts_per_kev_mm2(air_kev_mm2: float, start: float = COUNTS_PER_KEV_MM2) -> float:
    """Pixel value per keV/mm2: halved, as a detector's ranges are, until air stays below white."""
    gain = start
    while air_kev_mm2 * CLEAR_OF_WHITE * gain > WHITE:
        gain *= 0.5
    return gain


def to_counts(signal: NDArray[np.float32], counts_per_kev: float) -> NDArray[np.uint16]:
    """Pixel values (14 bits) of a recorded signal, keV/pixel."""
    counts = np.empty(signal.shape, np.uint16)
    for row, line in enumerate(signal):
        counts[row] = np.clip(np.rint(line * counts_per_kev), 0, WHITE)
    return counts


def _quality(exposure: Exposure, detector_kerma_mgy: float) -> dict[str, float]:
    """Numbers of the picture behind the dense part of the breast."""
    transmission = exposure.dense_signal / exposure.air_signal
    return {
        "transmission": transmission,
        "relative_quantum_noise": exposure.dense_noise / exposure.dense_signal,
        # 100 times the air kerma in uGy that would leave this signal: IEC 62494-1, except for this
        # beam instead of the standard's.
        "exposure_index": 100.0 * transmission * detector_kerma_mgy * 1000.0,
    }


def _contact(paths: PathLengths) -> dict[str, float]:
    """Contact under the paddle, if the compressed breast is available."""
    if paths.breast is None:
        return {}
    measures = paths.breast.measures
    return {key: measures[key] for key in ("contact_area_mm2", "pressure_kpa") if key in measures}


def _breast(coarse: CoarsePaths, factors: DoseFactors) -> dict[str, float]:
    return {
        "volumetric_density_percent": coarse.density_percent,
        "glandularity_percent": coarse.glandularity_percent,
        "dose_factor_g": factors.g,
        "dose_factor_c": factors.c,
        "dose_factor_s": factors.s,
    }


def _scatter(incident: DetectorInput) -> dict[str, float]:
    """Precision of the scatter, where the model knows it, and the core's glandularity."""
    scatter = incident.scatter
    if scatter.photons == 0:
        return {}
    measures = {
        "scatter_noise_percent": 100.0 * scatter.noise,
        "scatter_photons": float(scatter.photons),
    }
    if scatter.dose is not None and np.isfinite(scatter.dose.core_glandularity_percent):
        measures["core_glandularity_percent"] = scatter.dose.core_glandularity_percent
    return measures


def _dose(dose: Dose) -> dict[str, float]:
    """Glandular dose by each method, skin dose and that of other tissues, mGy, by Monte Carlo."""
    if dose.method != "monte-carlo":
        return {}
    measures = {
        "dose_by_monte_carlo_mgy": dose.by["monte-carlo"].mgd_mgy,
        "dose_by_dance_mgy": dose.by["dance"].mgd_mgy,
        "dose_of_all_gland_mgy": dose.all_gland_mgy,
        "dose_error_percent": 100.0 * dose.error,
    }
    if np.isfinite(dose.material_mgy.get("skin", float("nan"))):
        measures["skin_dose_mgy"] = dose.material_mgy["skin"]
    for name, value in dose.material_mgy.items():
        if name not in ("gland", "skin") and np.isfinite(value):
            measures[f"dose_of_{name.replace(' ', '_')}_mgy"] = value
    return measures
