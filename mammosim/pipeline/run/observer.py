"""What a run does around its stages: it times, keeps, has written, and reports progress."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial, wraps
from threading import RLock
from typing import Any, ParamSpec, Protocol, Self, TypeVar

import numpy as np

from mammosim._interruption import until_kept
from mammosim._side_by_side import signals_held
from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast, CompressionSettings
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom
from mammosim.pipeline.configuration import RunConfig
from mammosim.pipeline.folder import RunFolder
from mammosim.pipeline.run.beside import WritingThread
from mammosim.pipeline.study import OnProgress, Study, ViewResult
from mammosim.report import Status

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

STAGE_NAMES = {
    "make_phantom": "phantom",
    "compress": "compression",
    "project": "projection",
    "expose": "acquisition",
    "lesion_visibility": "targets",
    "find_targets": "targets",
    "project_arc": "projections",
    "expose_arc": "projections",
    "reconstruct": "reconstruction",
    "exam_results": "lesion shift",
}
"""What the record and the progress call each stage, by its function."""


class Observe(Protocol):
    """Takes a stage and returns what is called in its place."""

    def __call__(self, stage: Callable[Arguments, Result], /) -> Callable[Arguments, Result]:
        """The stage, observed."""
        ...


def unobserved(stage: Callable[Arguments, Result], /) -> Callable[Arguments, Result]:
    """The stage as it is."""
    return stage


class RunObserver:
    """Observes the stages of one run.

    Every stage is timed and reported. The phantom and the compressions are taken from the run's
    folder where it keeps them, and kept there. A compression and a view are written as soon as they
    are there, beside the stages that follow; the study is when all are. A compression that did not
    converge is noted, and the run continues with the state reached. Views may be made at the same
    time. It is a context, which ends when nothing is being written any more.

    Parameters
    ----------
    config : RunConfig
    output : RunFolder, optional
        Without it, nothing is kept or written.
    on_progress : callable, optional
        Called by one thread at a time.
    at_once : int
        How many views are made at the same time.
    """

    def __init__(
        self,
        config: RunConfig,
        output: RunFolder | None,
        on_progress: OnProgress | None,
        at_once: int = 1,
    ) -> None:
        self._config, self._output = config, output
        self._on_progress: OnProgress = on_progress or (lambda view, stage, row: None)
        self._unfinished: dict[str, NotConverged] = {}
        self._views: dict[str, ViewResult | None] = {}
        self._seconds: dict[str, float] = defaultdict(float)
        self._reported: dict[str, str] = {}
        self._breasts: list[BreastPhantom] = []
        self._sides_handed_over: set[str] = set()
        self._beside = WritingThread(at_once)
        self._noting = RLock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        with signals_held():
            self._beside.close()

    @property
    def views(self) -> Mapping[str, ViewResult]:
        """What was reached so far, by folder, in the order in which views were first observed."""
        return {folder: view for folder, view in self._views.items() if view is not None}

    @property
    def unfinished(self) -> tuple[NotConverged, ...]:
        """Compressions that did not converge, in the same order."""
        return tuple(self._unfinished[name] for name in self._views if name in self._unfinished)

    def on_progress(self, view: str, stage: str, row: np.void | None) -> None:
        """Report a stage, or a row of the solver's history."""
        with self._noting:
            self._on_progress(view, stage, row)

    def of_run(self, stage: Callable[Arguments, Result], /) -> Callable[Arguments, Result]:
        """A stage of the whole run, observed."""
        return self._observing("")(stage)

    def of_view(self, folder: str) -> Observe:
        """Observes the stages of one view."""
        self._views.setdefault(folder, None)
        return self._observing(folder)

    def _observing(self, folder: str) -> Observe:
        def observe(stage: Callable[Arguments, Result], /) -> Callable[Arguments, Result]:
            around: dict[str, Callable[..., Any]] = {
                "make_phantom": self._phantom,
                "compress": self._compression,
            }
            run = around.get(stage.__name__, self._timed)

            @wraps(stage)
            def observed(*arguments: Arguments.args, **keys: Arguments.kwargs) -> Result:
                result: Result = run(folder, stage, *arguments, **keys)
                return result

            return observed

        return observe

    def keep(self, result: ViewResult) -> None:
        """Note and write a view that is done."""
        folder = result.compressed.view.folder
        self._views[folder] = result
        if self._output is not None:
            self._hand_over(f"{folder}.export", self._output.write_view, result)
            self._hand_over_page_parts(result)

    def keep_draw(self, number: int, mammogram: Mammogram) -> None:
        """Write one of several draws of a view's noise; none is kept in memory."""
        if self._output is not None:
            self._beside.finish()
            self._output.write_draw(number, mammogram)

    def finish(self, study: Study) -> Study:
        """Write tables, record and page; the study with the time of each stage."""
        if self._output is not None:
            with self._timing("", "export"):
                self._beside.finish()
        study = replace(study, stage_seconds=dict(self._seconds))
        if self._output is not None:
            with self._timing("", "report"):
                self._output.write_summary(study, "not converged" if self.unfinished else "done")
        return replace(study, stage_seconds=dict(self._seconds))

    def stop(self, status: Status) -> Study | None:
        """Write what was reached, marked, without a page; the study, or None without a breast.

        A second signal is held back meanwhile. If the folder cannot be written, that is no news:
        the reason for stopping is on its way up.
        """
        with signals_held():
            if self._output is not None:
                with suppress(InputError):
                    self._beside.finish()
                self._beside.close()  # after an error, the thread may still be writing
                with suppress(InputError):
                    self._output.write_stop(self._reached(), status)
            return self._reached()

    def _reached(self) -> Study | None:
        if not self._breasts:
            return None
        return Study(tuple(self._breasts), self.views, dict(self._seconds), config=self._config)

    def _timed(self, folder: str, stage: Callable[..., Any], *arguments: Any, **keys: Any) -> Any:
        with self._timing(folder, STAGE_NAMES[stage.__name__]):
            return stage(*arguments, **keys)

    def _phantom(
        self, folder: str, make_phantom: Callable[..., Any], *arguments: Any, **keys: Any
    ) -> Any:
        """The uncompressed breast, as it was kept or made now."""
        with self._timing(folder, "phantom"):
            make = partial(make_phantom, *arguments, **keys)
            if self._output is None:
                breast = make()
            else:
                one = self._config.sides[len(self._breasts)]
                breast = self._output.stages.phantom(one, make, self._beside.hand_over)
            self._breasts.append(breast)
            return breast

    @until_kept()
    def _compression(
        self, folder: str, compress: Callable[..., CompressedBreast], breast: BreastPhantom,
        view: View, settings: CompressionSettings, *, seed: int,
    ) -> CompressedBreast:  # fmt: skip
        """The compressed breast, as it was kept or made now, and handed over to be written."""
        watch = partial(self.on_progress, folder, "compression")
        make = partial(compress, breast, view, settings, seed=seed, watch=watch)
        try:
            with self._timing(folder, "compression"):
                if self._output is None:
                    compressed = make()
                else:
                    one = self._config.of_side(view.laterality)
                    compressed = self._output.stages.compression(
                        one, settings, breast, view, make, self._beside.hand_over
                    )
        except NotConverged as error:
            self._unfinished[folder] = error
            compressed = error.reached
        except Interrupted as stop:
            if stop.reached is not None:
                self._keep_compression(stop.reached, breast)
            raise
        self._hand_over_page_parts(self._keep_compression(compressed, breast))
        return compressed

    def _keep_compression(self, compressed: CompressedBreast, breast: BreastPhantom) -> ViewResult:
        folder = compressed.view.folder
        result = self._views[folder] = ViewResult(compressed)
        if self._output is not None:
            volumes = f"{folder}.volumes"
            if self._is_first_view_of(breast):
                self._hand_over(volumes, self._output.write_phantom, breast)
            self._hand_over(volumes, self._output.write_compression, compressed)
        return result

    def _is_first_view_of(self, breast: BreastPhantom) -> bool:
        """Whether no other view of the breast came as far: the first has the breast written."""
        with self._noting:
            first = breast.laterality not in self._sides_handed_over
            self._sides_handed_over.add(breast.laterality)
        return first

    def _hand_over_page_parts(self, result: ViewResult) -> None:
        """Have the parts made that the page has of this view alone, as far as it came."""
        if self._output is not None:
            for part in self._output.page_parts(result):
                self._hand_over(f"{result.compressed.view.folder}.report", part)

    def _hand_over(self, stage: str, write: Callable[..., Any], *arguments: Any) -> None:
        """Have something written beside the stages that follow, and add its time to a stage's."""

        def note(seconds: float) -> None:
            with self._noting:
                self._seconds[stage] += seconds

        self._beside.hand_over(write, *arguments, note=note)

    @contextmanager
    def _timing(self, folder: str, stage: str) -> Iterator[None]:
        """Report a stage, once for all its functions, and add its time."""
        if self._reported.get(folder) != stage:
            self._reported[folder] = stage
            self.on_progress(folder, stage, None)
        start = time.perf_counter()
        try:
            yield
        finally:
            name = f"{folder}.{stage}" if folder else stage
            with self._noting:
                self._seconds[name] += time.perf_counter() - start
