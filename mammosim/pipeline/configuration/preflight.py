"""What can be refused before anything is computed, and before a breast is compressed."""

from __future__ import annotations

from dataclasses import replace

from mammosim.acquisition import SCATTER_VOXEL_MM, check_acquisition
from mammosim.compression import (
    MODELS,
    CompressedBreast,
    CompressionSettings,
    breast_volume_ml,
    check_plates,
    compress,
    held_before,
)
from mammosim.errors import InputError, NotConverged
from mammosim.phantom import (
    BreastPhantom,
    generate_outline,
    make_phantom,
)
from mammosim.pipeline.configuration.foreseen_lesions import foreseen_origins, with_lesions
from mammosim.pipeline.configuration.resolved_view import ResolvedView
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.plausibility import plausibility_warnings
from mammosim.projection import (
    cast_shadow,
    check_arc,
    check_copy,
    check_memory,
    check_shadow,
)
from mammosim.reconstruction import check_reconstruction, load_rtk
from mammosim.targets import lesion_cut_off

SHADOW_LATTICE_MM = 3.0
"""Spacing of that lattice, mm, unless the run's own is coarser."""

_BY_ESTIMATE = "by an estimate on a coarse lattice"

COARSE_VOXEL_MM = 4.0
"""Voxel of a generated breast whose outline alone is wanted, mm."""


def check_before(config: RunConfig) -> tuple[str, ...]:
    """Refuse what can be known to be impossible without computing anything.

    Returns
    -------
    tuple of str
        What is doubtful about the phantom and how its views hold it, one sentence each.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    check_settings(config)
    found: list[str] = []
    for one in config.sides:
        breast, slack_mm = _outlined_phantom(one)
        check_compression(one, breast, slack_mm)
        found += _check_shadows(one, breast)
        found += breast.notes
        found += map(str, plausibility_warnings({"breast_volume_ml": breast_volume_ml(breast)}))
        for view in one.resolved_views:
            compresses = MODELS[view.compression.model].compresses
            found += held_before(breast, view.position(breast.laterality), compresses)
    return tuple(dict.fromkeys(found))


def check_settings(config: RunConfig) -> None:
    """Refuse pictures larger than memory, and files of the acquisition that cannot be used.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    problems: list[str] = []
    for view in config.resolved_views:
        projections = view.tomosynthesis.projections if view.tomosynthesis else 0
        try:
            check_memory(view.projection, projections=projections)
        except InputError as error:
            problems += error.problems
        if view.tomosynthesis and view.acquisition.contrast is not None:
            problems.append(
                f"{view.label}: acquisition.contrast is for mammograms, not for a series of "
                f"projections (dbt)"
            )
        try:
            _check_series(view)
        except InputError as error:
            problems += error.problems
        try:
            check_acquisition(view.acquisition)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))


def _check_series(view: ResolvedView) -> None:
    """Refuse an arc that cannot be, and a reconstruction without its library."""
    if view.tomosynthesis is None:
        return
    check_arc(view.tomosynthesis, view.projection)
    if view.tomosynthesis.reconstruct is not None:
        load_rtk()


def check_compression(config: RunConfig, breast: BreastPhantom, slack_mm: float = 0.0) -> None:
    """Refuse views that cannot be compressed as they are asked for, before any is.

    Parameters
    ----------
    config : RunConfig
    breast : BreastPhantom
        Uncompressed, or compressed before.
    slack_mm : float
        By how much the breast may be larger than this phantom, mm.

    Raises
    ------
    InputError
        With one line a view.
    """
    problems = _unnamed_view(config, breast)
    for view in config.resolved_views:
        try:
            check_plates(breast, view.position(breast.laterality), view.compression, slack_mm)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))


def _unnamed_view(config: RunConfig, breast: BreastPhantom) -> list[str]:
    """Problems of a breast between plates whose view is not given."""
    if breast.compressed is None or breast.compressed.view is not None:
        return []
    names = {view.view for view in config.views}
    as_it_is = not all(MODELS[view.compression.model].compresses for view in config.resolved_views)
    if not as_it_is and len(names) == 1:
        return []
    why = "compression.model is none" if as_it_is else f"{len(names)} views are requested"
    return [
        f"phantom.compressed_for: not given, but the phantom contains plates (label 50) and {why}; "
        "expected CC, MLO or ML, and that view alone"
    ]


def _check_shadows(config: RunConfig, breast: BreastPhantom) -> list[str]:
    """Refuse focal spots and detectors that certainly leave no breast in the picture.

    The breast is compressed on a coarse lattice of springs, in about a second. Returns what will be
    doubtful or cut off, one sentence each.
    """
    problems: list[str] = []
    notes: list[str] = []
    for view in config.resolved_views:
        compressed = _coarsely_compressed(breast, view)
        if compressed is None:
            continue  # the run itself says it better
        foreseen = plausibility_warnings(
            MODELS[view.compression.model].foreseen(compressed, view.compression)
        )
        notes += [f"{compressed.view.folder}: {warning}, {_BY_ESTIMATE}" for warning in foreseen]
        if not compressed.converged:
            continue
        try:
            gantry, found = check_shadow(compressed, view.projection, view.tomosynthesis)
            _check_volume(compressed, view)
            if view.acquisition.scatter_model == "monte-carlo":
                check_copy(compressed, view.projection, SCATTER_VOXEL_MM)
        except InputError as error:
            said = " ".join(error.problems)
            problems.append(f"{compressed.view.folder}: {said}, {_BY_ESTIMATE}")
        else:
            for lesion in foreseen_origins(config.phantom, compressed.phantom):
                found += lesion_cut_off(compressed, lesion, gantry)
            notes += [f"{note}, {_BY_ESTIMATE}" for note in found]
    if problems:
        raise InputError(problems)
    return notes


def _coarsely_compressed(breast: BreastPhantom, view: ResolvedView) -> CompressedBreast | None:
    settings = view.compression
    keys = {"thickness_mm", "support_z_mm", "paddle_z_mm", "plate_edge_mm", "mlo_angle_deg"}
    coarse = CompressionSettings(
        **settings.model_dump(include=keys),
        model="springs",
        resolution_mm=max(settings.resolution_mm, SHADOW_LATTICE_MM),
    )
    held = coarse if MODELS[settings.model].compresses else settings
    try:
        free = replace(breast, shaped_under=None)  # springs know no weight
        return compress(free, view.position(breast.laterality), held)
    except NotConverged as error:
        reached: CompressedBreast = error.reached
        return reached
    except InputError:
        return None


def _check_volume(compressed: CompressedBreast, view: ResolvedView) -> None:
    """Refuse a reconstruction that is larger than memory."""
    series, projection = view.tomosynthesis, view.projection
    if series is None or series.reconstruct is None:
        return
    shadow = cast_shadow(compressed, projection, series)
    sizes = view.reconstructed(shadow.height_mm * shadow.width_mm, compressed.thickness_mm)
    check_reconstruction(*sizes, series.reconstruct)


def _outlined_phantom(config: RunConfig) -> tuple[BreastPhantom, float]:
    """The breast, and by how much it may be larger than that, mm.

    One from a file is read, with its lesions. Of a generated one the outline is made of coarse
    voxels, up to one voxel smaller than it will be, with the lesions whose position is given.
    """
    phantom = config.phantom
    if phantom.generate is None:
        breast = make_phantom(
            phantom, config.first_side, config.seed, breast_number=config.breast_number
        )
        return breast, 0.0
    coarse_mm = max(COARSE_VOXEL_MM, phantom.generate.voxel_mm)
    coarse = phantom.generate.model_copy(update={"voxel_mm": coarse_mm})
    outline = generate_outline(coarse, config.seed, config.first_side or "L")
    return with_lesions(phantom, outline), 2.0 * coarse_mm
