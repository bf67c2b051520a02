"""What can be refused before anything is computed, and before a breast is compressed."""

from __future__ import annotations

from mammosim.acquisition import check_acquisition
from mammosim.compression import held_tissue, plate_edge_mm
from mammosim.errors import InputError
from mammosim.phantom import BreastPhantom, PhantomSettings, make_phantom
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.projection import check_field, check_memory

COARSE_VOXEL_MM = 4.0
"""Voxel of a generated breast whose outline alone is wanted, mm: it takes a second."""


def check_before(config: RunConfig) -> None:
    """Refuse what can be known to be impossible without computing anything.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    check_settings(config)
    breast = _outlined_phantom(config)
    if breast is not None:
        check_detectors(config, breast)


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
        try:
            check_acquisition(view.acquisition)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(dict.fromkeys(problems))


def check_detectors(config: RunConfig, breast: BreastPhantom) -> None:
    """Refuse detectors that cannot hold a breast, before it is compressed.

    Raises
    ------
    InputError
        With one line a view that does not fit, saying by how much at least.
    """
    problems: list[str] = []
    for view in config.resolved_views:
        edge_mm = view.projection.detector_edge_mm
        if edge_mm is None:
            edge_mm = plate_edge_mm(view.compression, *held_tissue(view.compression, breast))
        try:
            check_field(breast, view.position(breast.laterality), edge_mm, view.projection)
        except InputError as error:
            problems += [f"{view.label}: {line}" for line in error.problems]
    if problems:
        raise InputError(problems)


def _outlined_phantom(config: RunConfig) -> BreastPhantom | None:
    """The breast's outline for `check_detectors`, where a detector of a given size asks for it.

    A generated breast is made of coarse voxels, up to one voxel smaller than it will be. The usual
    formats hold nearly every breast, so that none is read for them alone.
    """
    if not any(view.projection.detector_mm for view in config.resolved_views):
        return None
    phantom = config.phantom
    if phantom.generate is not None:
        coarse = max(COARSE_VOXEL_MM, phantom.generate.voxel_mm)
        phantom = PhantomSettings(generate=phantom.generate.model_copy(update={"voxel_mm": coarse}))
    return make_phantom(phantom, config.laterality, config.seed)
