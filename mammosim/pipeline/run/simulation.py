"""One run, in the order in which a mammogram is made."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mammosim._jit import one_blas_thread
from mammosim.acquisition import (
    Mammogram,
    Tomosynthesis,
    expose,
    expose_arc,
    lesion_visibility,
)
from mammosim.compression import CompressedBreast, CompressionSettings, compress
from mammosim.errors import Interrupted, NotConverged
from mammosim.export import label_image, lesion_masks
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, make_phantom
from mammosim.pipeline.configuration.preflight import check_detectors, check_settings
from mammosim.pipeline.configuration.run_config import RunConfig
from mammosim.pipeline.configuration.view_settings import ViewSettings
from mammosim.pipeline.folder.run_folder import RunFolder
from mammosim.pipeline.run.shift_analysis import shift_answers, with_ellipsoids
from mammosim.projection import PathLengths, project, project_arc
from mammosim.targets import ShiftAnswers, Target, find_targets

Tell = Callable[[str, str, np.void | None], None]
"""Told of progress: view folder or '', stage, and a row of the solver's history or None."""


@dataclass(frozen=True, eq=False)
class ViewResult:
    """One view as far as it came; what was not reached is None.

    Of a series of projections, `paths`, `mammogram` and `targets` are those of the middle one.
    """

    squeezed: CompressedBreast
    paths: PathLengths | None = None
    mammogram: Mammogram | None = None
    targets: tuple[Target, ...] = ()
    series: Tomosynthesis | None = None


@dataclass(frozen=True, eq=False)
class Study:
    """A run's results.

    Parameters
    ----------
    breast : BreastPhantom
        The uncompressed breast.
    views : dict of str to ViewResult
        By laterality and view, as `LCC`; a series of projections as `LCC_DBT`.
    targets : tuple of Target
        One a target and view, the rows of `lesions.csv`.
    answers : ShiftAnswers
        Rules between views, biopsy and uncertainty.
    stage_seconds : dict of str to float
        Wall time of each stage.
    """

    breast: BreastPhantom
    views: dict[str, ViewResult] = field(default_factory=dict)
    stage_seconds: dict[str, float] = field(default_factory=dict)
    answers: ShiftAnswers = field(default_factory=ShiftAnswers)

    @property
    def targets(self) -> tuple[Target, ...]:
        """Rows of `lesions.csv`."""
        return tuple(target for view in self.views.values() for target in view.targets)


@one_blas_thread
def simulate(config: RunConfig, output: RunFolder | None = None, tell: Tell | None = None) -> Study:
    """Make the mammograms that a configuration asks for.

    Parameters
    ----------
    config : RunConfig
        From `load_config`.
    output : RunFolder, optional
        Where to write each view as soon as it is there, and the tables and the report at the end.
    tell : callable, optional
        Told of progress.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If something does not fit, as a lesion outside the breast.
    NotConverged, Interrupted
        After everything that was reached has been written; they carry the study.
    """
    tell = tell or (lambda view, stage, row: None)
    seconds: dict[str, float] = {}
    check_settings(config)
    with _timed(seconds, "", "phantom", tell):
        breast = _phantom(config, output)
    check_detectors(config, breast)
    study = Study(breast, stage_seconds=seconds)
    unfinished: list[NotConverged] = []
    try:
        for wanted in config.views:
            _make_view(study, config, wanted, output, tell, unfinished)
        study = _with_answers(study, config, tell)
    except (Interrupted, KeyboardInterrupt) as stop:
        _finish(study, config, output, "interrupted", tell)
        raise Interrupted(str(stop) or "the run was interrupted", study) from None
    _finish(study, config, output, "not converged" if unfinished else "done", tell)
    if unfinished:
        raise NotConverged("\n".join(str(error) for error in unfinished), study)
    return study


def _make_view(
    study: Study,
    config: RunConfig,
    wanted: ViewSettings,
    output: RunFolder | None,
    tell: Tell,
    unfinished: list[NotConverged],
) -> None:
    """Compress, project, expose and write one view."""
    breast, seconds = study.breast, study.stage_seconds
    compression = config.section_for(wanted, "compression")
    series = wanted.dbt is not None
    view = View(wanted.view, breast.laterality, compression.mlo_angle_deg, series)
    name = view.folder
    try:
        with _timed(seconds, name, "compression", tell):
            squeezed = _compressed(config, compression, breast, view, output, tell)
    except NotConverged as error:
        unfinished.append(error)
        squeezed = error.reached
    except Interrupted as stop:
        _keep_compression(study, stop.reached, output, tell)
        raise
    _keep_compression(study, squeezed, output, tell)
    take = _take_series if series else _take_picture
    take(study, config, wanted, squeezed, output, tell)


def _phantom(config: RunConfig, output: RunFolder | None) -> BreastPhantom:
    """The uncompressed breast, as it was kept or made now."""

    def make() -> BreastPhantom:
        return make_phantom(config.phantom, config.laterality, config.seed)

    return make() if output is None else output.stages.phantom(config, make)


def _compressed(
    config: RunConfig,
    settings: CompressionSettings,
    breast: BreastPhantom,
    view: View,
    output: RunFolder | None,
    tell: Tell,
) -> CompressedBreast:
    """The compressed breast, as it was kept or made now."""

    def make() -> CompressedBreast:
        return compress(
            breast, view, seed=config.seed,
            watch=lambda row: tell(view.folder, "compression", row), **_given(settings),
        )  # fmt: skip

    if output is None:
        return make()
    return output.stages.compression(config, settings, breast, view, make)


def _take_picture(
    study: Study,
    config: RunConfig,
    wanted: ViewSettings,
    squeezed: CompressedBreast,
    output: RunFolder | None,
    tell: Tell,
) -> None:
    """Project, expose and write one picture."""
    name, seconds = squeezed.view.folder, study.stage_seconds
    with _timed(seconds, name, "projection", tell):
        paths = project(squeezed, **_given(config.section_for(wanted, "projection")))
    with _timed(seconds, name, "acquisition", tell):
        acquisition = _given(config.section_for(wanted, "acquisition"))
        mammogram = expose(paths, seed=_seed_of(config.seed, name), **acquisition)
    with _timed(seconds, name, "targets", tell):
        visible = lesion_visibility(study.breast, paths, mammogram, **acquisition)
        targets = tuple(find_targets(squeezed, paths, visible))
    study.views[name] = ViewResult(squeezed, paths, mammogram, targets)
    if output is not None:
        with _timed(seconds, name, "export", tell):
            output.write_images(paths, mammogram, targets)


def _take_series(
    study: Study,
    config: RunConfig,
    wanted: ViewSettings,
    squeezed: CompressedBreast,
    output: RunFolder | None,
    tell: Tell,
) -> None:
    """Project, expose and write a series of projections, one after the other."""
    name, seconds = squeezed.view.folder, study.stage_seconds
    middle: list[PathLengths] = []
    targets: list[Target] = []
    lesions: dict[int, Any] = {}

    def note(index: int, paths: PathLengths) -> None:
        if not middle:  # it comes first
            middle.append(paths)
            targets.extend(find_targets(squeezed, paths))
        if any(paths.lesion_labels):
            masks = lesion_masks(paths, targets)
            lesions[index] = label_image(masks, (paths.gantry.rows, paths.gantry.columns))

    with _timed(seconds, name, "projections", tell):
        arc = project_arc(squeezed, wanted.dbt, config.section_for(wanted, "projection"))
        acquisition = _given(config.section_for(wanted, "acquisition"))
        series = expose_arc(arc, seed=_seed_of(config.seed, name), watch=note, **acquisition)
    study.views[name] = ViewResult(squeezed, middle[0], series.middle, tuple(targets), series)
    if output is not None:
        with _timed(seconds, name, "export", tell):
            output.write_series(series, middle[0], [lesions[k] for k in sorted(lesions)])


def _keep_compression(
    study: Study, squeezed: CompressedBreast, output: RunFolder | None, tell: Tell
) -> None:
    """Note and write what the compression reached, before anything else can fail."""
    name = squeezed.view.folder
    study.views[name] = ViewResult(squeezed)
    if output is not None:
        with _timed(study.stage_seconds, name, "volumes", tell):
            output.write_compression(squeezed)


def _with_answers(study: Study, config: RunConfig, tell: Tell) -> Study:
    """The study with what it answers about its lesions, and how sure their rows are."""
    with _timed(study.stage_seconds, "", "lesion shift", tell):
        answers = shift_answers(study.breast, study.views, config, tell)
    for name, view in study.views.items():
        targets = with_ellipsoids(view.targets, answers.uncertainty)
        study.views[name] = replace(view, targets=targets)
    return replace(study, answers=answers)


def _finish(
    study: Study, config: RunConfig, output: RunFolder | None, status: Any, tell: Tell
) -> None:
    if output is None:
        return
    with _timed(study.stage_seconds, "", "report", tell):
        views = [(view.squeezed, view.mammogram) for view in study.views.values()]
        notes = (*study.breast.notes, *study.answers.notes)
        series = {name: view.series for name, view in study.views.items() if view.series}
        output.write_summary(
            views, study.targets, notes, study.stage_seconds, status, config.report,
            series, study.answers,
        )  # fmt: skip


@contextmanager
def _timed(seconds: dict[str, float], view: str, stage: str, tell: Tell) -> Iterator[None]:
    tell(view, stage, None)
    start = time.perf_counter()
    yield
    seconds[f"{view}.{stage}" if view else stage] = time.perf_counter() - start


def _given(settings: Any) -> dict[str, Any]:
    """What a user set of a section; the rest is the stage's own default."""
    given: dict[str, Any] = settings.model_dump(mode="json", exclude_unset=True)
    return given


def _seed_of(seed: int, view: str) -> int:
    """Seed of a view's noise: another for each view, whatever order they are made in."""
    digest = hashlib.sha256(f"{seed}/{view}".encode()).digest()
    return int.from_bytes(digest[:8], "little")
