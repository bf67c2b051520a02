"""One run, in the order in which a mammogram is made."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from typing import Unpack

from mammosim._jit import one_blas_thread
from mammosim._side_by_side import run_side_by_side
from mammosim.acquisition import Mammogram, expose, expose_arc, lesion_visibility
from mammosim.compression import compress
from mammosim.config import documents_keys
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.phantom import BreastPhantom, make_phantom
from mammosim.pipeline.configuration import (
    ResolvedView,
    RunConfig,
    RunKeys,
    check_compression,
    check_settings,
    given_config,
)
from mammosim.pipeline.folder import RunFolder
from mammosim.pipeline.run.at_once import views_at_once
from mammosim.pipeline.run.notebook_bar import notebook_bar
from mammosim.pipeline.run.observer import Observe, RunObserver, unobserved
from mammosim.pipeline.run.series_truth import SeriesTruth
from mammosim.pipeline.run.shift_analysis import exam_results, with_ellipsoids
from mammosim.pipeline.study import OnProgress, Study, ViewResult
from mammosim.projection import project, project_arc
from mammosim.reconstruction import reconstruct
from mammosim.targets import find_targets


@one_blas_thread
@documents_keys(RunConfig, RunKeys)
def simulate(
    config: RunConfig | None = None,
    output: RunFolder | None = None,
    on_progress: OnProgress | None = None,
    **sections: Unpack[RunKeys],
) -> Study:
    """Make the mammograms that a configuration asks for.

    Parameters
    ----------
    config : RunConfig, optional
        From `load_config`; or give its sections as keywords.
    output : RunFolder, optional
        Where to write each view as soon as it is there, and the tables and the report at the end.
    on_progress : callable, optional
        Called with the view's folder ('' for the run), the stage, and a row of the solver's
        history or None. Default: a bar in a Jupyter notebook, nothing elsewhere.
    **sections
        Sections and keys of `RunConfig`, each a settings object or a mapping of its keys.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If something does not fit, as a lesion outside the breast; what was computed before is
        written and its record marked.
    NotConverged, Interrupted
        After everything that was reached has been written; they carry the study.
    """
    config = given_config(config, sections, "simulate()")
    check_settings(config)
    with (
        notebook_bar(config, on_progress) as report,
        RunObserver(config, output, report, at_once := views_at_once(config)) as observer,
    ):
        return _simulate(config, observer, at_once)


def _simulate(config: RunConfig, observer: RunObserver, at_once: int) -> Study:
    """All breasts, all their views, and what follows from them together."""
    try:
        breasts = tuple(_make_breast(one, observer) for one in config.sides)
        tasks, first_id = [], 1
        for one, breast in zip(config.sides, breasts, strict=True):
            for view in one.resolved_views:
                observe = observer.of_view(view.position(breast.laterality).folder)
                task = partial(_make_view, breast, view, one.seed, observe, first_id, observer)
                tasks.append(task)
            first_id += len(breast.lesions) + len(breast.landmarks) + 1  # the nipple
        run_side_by_side(tasks, at_once)
        answers = observer.of_run(exam_results)(
            breasts, observer.views, config, observer.on_progress
        )
        views = with_ellipsoids(observer.views, answers.uncertainty)
        study = observer.finish(Study(breasts, views, answers=answers, config=config))
    except (Interrupted, KeyboardInterrupt) as stop:
        reached = observer.stop("interrupted")
        raise Interrupted(str(stop) or "the run was interrupted", reached) from None
    except InputError:
        reached = observer.stop("not converged" if observer.unfinished else "refused")
        if reached is None or not observer.unfinished:
            raise
        study = reached
    if observer.unfinished:
        raise NotConverged("\n".join(str(error) for error in observer.unfinished), study)
    return study


def _make_breast(config: RunConfig, observer: RunObserver) -> BreastPhantom:
    """One breast of the exam, if all its views can be made."""
    breast = observer.of_run(make_phantom)(
        config.phantom, config.first_side, config.seed, breast_number=config.breast_number
    )
    check_compression(config, breast)
    return breast


def _make_view(
    breast: BreastPhantom,
    view: ResolvedView,
    seed: int,
    observe: Observe,
    first_id: int,
    observer: RunObserver,
) -> None:
    """One view, which the observer keeps."""
    if view.tomosynthesis:
        result = simulate_series(breast, view, seed, observe, first_id)
    else:
        result = simulate_view(breast, view, seed, observe, first_id, observer.keep_draw)
    observer.keep(result)


def simulate_view(
    breast: BreastPhantom,
    view: ResolvedView,
    seed: int = 1,
    observe: Observe = unobserved,
    first_id: int = 1,
    watch_draws: Callable[[int, Mammogram], None] | None = None,
) -> ViewResult:
    """Make the mammogram of one view.

    Parameters
    ----------
    breast : BreastPhantom
    view : ResolvedView
        Settings of all stages.
    seed : int
        The run's.
    observe : callable, optional
        Given each stage, returns what is called in its place: the same stage, observed.
    first_id : int
        Number of the breast's first target in the run.
    watch_draws : callable, optional
        Called with number, from 1, and mammogram of each of several `acquisition.realisations`.

    Returns
    -------
    ViewResult

    Raises
    ------
    InputError
        If something does not fit, as a detector that is too small.
    NotConverged, Interrupted
        From `compress`, if no observer continues with the state reached.
    """
    position = view.position(breast.laterality)
    compressed = observe(compress)(breast, position, view.compression, seed=seed)
    paths = observe(project)(compressed, view.projection)
    mammogram = observe(expose)(
        paths, view.acquisition.of_unit(seed), seed=noise_seed(seed, position.folder),
        dose_map=view.dose_map, watch=watch_draws,
    )  # fmt: skip
    visible = observe(lesion_visibility)(breast, paths, mammogram, view.acquisition)
    targets = observe(find_targets)(compressed, paths, visible, first_id)
    return ViewResult(compressed, paths, mammogram, tuple(targets))


def simulate_series(
    breast: BreastPhantom,
    view: ResolvedView,
    seed: int = 1,
    observe: Observe = unobserved,
    first_id: int = 1,
) -> ViewResult:
    """Make the projections of one view for tomosynthesis, and slices where they are asked for.

    The parameters are those of `simulate_view`.
    """
    position = view.position(breast.laterality)
    compressed = observe(compress)(breast, position, view.compression, seed=seed)
    arc = observe(project_arc)(compressed, view.tomosynthesis, view.projection)
    truth = SeriesTruth(compressed, first_id)
    series = observe(expose_arc)(
        arc,
        view.acquisition.of_unit(seed),
        seed=noise_seed(seed, position.folder),
        watch=truth.gather,
    )
    settings = view.tomosynthesis.reconstruct if view.tomosynthesis else None
    slices = observe(reconstruct)(series, settings) if settings else None
    return truth.result(series, slices)


def noise_seed(seed: int, folder: str) -> int:
    """Seed of a view's noise: another for each view, whatever order they are made in."""
    digest = hashlib.sha256(f"{seed}/{folder}".encode()).digest()
    return int.from_bytes(digest[:8], "little")
