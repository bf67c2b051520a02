"""A run's folder: where each stage's results are written, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Lock
from typing import Any

from mammosim.acquisition import Mammogram
from mammosim.compression import CompressedBreast
from mammosim.config import write_yaml
from mammosim.errors import InputError
from mammosim.export import (
    MARKUPS_FILE,
    PatientSettings,
    StudyIdentity,
    reconstruction_geometry,
    series_geometry,
    slice_masks,
    whole_file,
    write_compressed,
    write_draw,
    write_images,
    write_json,
    write_lesions,
    write_markups,
    write_phantom,
    write_reconstruction,
    write_series,
    write_table,
    write_text,
)
from mammosim.phantom import BreastPhantom
from mammosim.pipeline.configuration import RunConfig
from mammosim.pipeline.folder.earlier_run import (
    read_record,
    remove_earlier_run,
    remove_unfinished_files,
)
from mammosim.pipeline.folder.protection import (
    refuse_inputs_within,
    refuse_links,
    refuse_strangers,
)
from mammosim.pipeline.folder.run_identity import InputHashes, hash_of
from mammosim.pipeline.folder.stage_cache import StageCache
from mammosim.pipeline.study import Study, ViewResult
from mammosim.projection import compressed_labels
from mammosim.report import (
    ReportedView,
    Status,
    render_report,
    run_record,
)
from mammosim.targets import BiopsyResult, RuleError, ShiftUncertainty

TECHNIQUE = (
    "target", "filter", "kvp", "mas", "hvl_mm_al", "air_kerma_mgy", "dose_mgy", "dose_method",
    "scatter_model",
)  # fmt: skip
"""Of a mammogram, in the run's record; of a series of projections, those of the middle one."""


class RunFolder:
    """The folder of one run.

    Its methods may write at the same time, as long as each is called once for each thing.

    Parameters
    ----------
    path : path
        Is made when the run begins; what lies in it is replaced file by file. Half-written files of
        a run that was killed are removed at once, before any thread writes one.
    config : RunConfig
    title : str
        Name of the run in the report.
    reuse : sequence of path
        Other runs' folders, whose stages are taken where they fit.

    Attributes
    ----------
    path : Path
    stages : StageCache
        Results of stages that need not be computed again.

    Raises
    ------
    InputError
        If a link in the folder leads elsewhere, or a file lies in it that the run reads or that
        is no run's and would be replaced.
    """

    def __init__(
        self, path: str | os.PathLike[str], config: RunConfig, title: str = "",
        reuse: Sequence[Path] = (),
    ) -> None:  # fmt: skip
        self.path = Path(path)
        self._config = config
        self._title = title or self.path.name
        inputs = InputHashes.of(config)
        self._hash = hash_of(config, inputs)
        description = f"Simulated mammography: {self._title}"
        self._identity = StudyIdentity(self._hash, description, config.patient or PatientSettings())
        try:
            refuse_links(self.path)
            refuse_inputs_within(self.path, config)
            refuse_strangers(self.path, config)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be used ({error.strerror})") from None
        remove_unfinished_files(self.path)
        self.stages = StageCache(
            self.path, (*inputs.labels, *inputs.voxels, *inputs.lesions), reuse
        )
        self._begun: os.stat_result | None = None
        self._beginning = Lock()
        self._sides_written: set[str] = set()
        self._reported: dict[str, ReportedView] = {}

    def _begin(self) -> None:
        """Take the folder, once there is a result: a run that is refused before leaves nothing."""
        remove_earlier_run(self.path)
        self.stages.make_folder()
        path = self.path / "config.yaml"
        with whole_file(path) as part:
            write_yaml(self._config.plain(), part)
        self._begun = path.stat()

    def _begin_or_go_on(self) -> None:
        """Take the folder, or refuse to continue if it was removed or replaced meanwhile."""
        with self._beginning:
            if self._begun is None:
                self._begin()
                return
        self._check_presence()

    def write_phantom(self, breast: BreastPhantom) -> None:
        """Write the uncompressed breast; one that was read between plates is not known.

        Where both breasts are imaged, each has a folder, `L` and `R`.
        """
        self._begin_or_go_on()
        if not self._config.export.volumes or breast.compressed is not None:
            return
        folder = self._side_folder(breast.laterality)
        write_phantom(breast, folder, self._config.export.viewers)
        self._sides_written.add(breast.laterality)

    def _side_folder(self, side: str) -> Path:
        """Where the uncompressed breast of a side is: of two breasts in a folder each."""
        return self.path if len(self._config.sides) == 1 else self.path / side

    def write_compression(self, compressed: CompressedBreast) -> None:
        """Write a view's compressed labels, displacement, history and measures."""
        self._begin_or_go_on()
        settings = self._config.export
        wanted = settings.volumes or settings.compressed_formats
        labels, frame = compressed_labels(compressed) if wanted else (None, None)
        folder = self.path / compressed.view.folder
        write_compressed(folder, compressed, settings, labels, frame, self._config.seed)

    def write_view(self, result: ViewResult) -> None:
        """Write a view's pictures and masks, of a mammogram or of a series of projections."""
        if result.paths is None or result.mammogram is None:
            return
        self._begin_or_go_on()
        folder, export = self.path / result.compressed.view.folder, self._config.export
        if result.series is not None:
            write_series(
                folder, result.series, result.paths, result.lesion_images, export, self._identity
            )
            if result.reconstruction is not None:
                masks = slice_masks(result.compressed, result.reconstruction, result.targets)
                write_reconstruction(
                    folder, result.series, result.reconstruction, masks, export, self._identity
                )
        else:
            write_images(
                folder, result.paths, result.mammogram, result.targets, export, self._identity
            )

    def page_parts(self, result: ViewResult) -> tuple[Callable[[], Any], ...]:
        """What makes the parts of the page that tell of one view alone, beside other stages.

        First called with the compressed breast, then with its image.
        """
        if not self._config.report.html:
            return ()
        return self._reported_view(result).parts(self._config.report)

    def _reported_view(self, result: ViewResult) -> ReportedView:
        """A view for the page, with what was computed of it before."""
        folder = result.compressed.view.folder
        kept = self._reported.get(folder)
        if (
            kept is None
            or kept.compressed is not result.compressed
            or kept.mammogram is not result.mammogram
        ):
            kept = ReportedView(result.compressed, result.mammogram, result.reconstruction)
            self._reported[folder] = kept
        return kept

    def write_draw(self, number: int, mammogram: Mammogram) -> None:
        """Write the pictures of one draw of a view's noise."""
        folder = self.path / mammogram.gantry.view.folder
        write_draw(folder, mammogram, number, self._config.export, self._identity)

    def write_summary(self, study: Study, status: Status) -> None:
        """Write the tables of the lesions, the page and the run's record.

        Raises
        ------
        InputError
            If the folder was removed while the run was on, or cannot be written.
        """
        self._check_presence(study)
        self._write_tables(study)
        record = self._record(study, status)
        if self._config.report.html:
            views = [self._reported_view(view) for view in study.views.values()]
            page = render_report(
                views, study.targets, record, self._config.report, self._title, study.answers
            )
            write_text(self.path / "report.html", page)
        write_json(self.path / "run.json", record)

    def write_stop(self, study: Study | None, status: Status) -> None:
        """Mark a run that stopped before its end: its record and tables, without a page.

        An earlier run that this one was to replace, but had not touched yet, stays as it is, and
        a run that was refused before it began leaves nothing.
        """
        if self._begun is None:
            if status != "interrupted" or read_record(self.path):
                return
            self._begin()
        self._check_presence()  # a view's own files may be missing, where it was being written
        if study is not None and status != "refused":
            self._write_tables(study)
        write_json(self.path / "run.json", self._record(study, status))

    def _write_tables(self, study: Study) -> None:
        write_lesions(study.targets, self.path / "lesions.csv")
        if self._config.export.volumes and self._config.export.viewers:
            self._write_markups(study)
        for kind, rows, name in (
            (RuleError, study.answers.rules, "view_rules"),
            (BiopsyResult, study.answers.biopsy, "biopsy"),
            (ShiftUncertainty, study.answers.uncertainty, "uncertainty"),
        ):
            if rows:
                write_table(kind, rows, self.path / f"{name}.csv")

    def _write_markups(self, study: Study) -> None:
        """Targets as 3D Slicer's markups: where they were beside the breast, and in each view."""
        for view in study.views.values():
            seen, side = view.compressed.view, view.compressed.view.laterality
            if not view.targets:
                continue
            path = self.path / seen.folder / MARKUPS_FILE
            write_markups(view.targets, seen, True, path)
            if side in self._sides_written:
                write_markups(view.targets, seen, False, self._side_folder(side) / MARKUPS_FILE)

    def _check_presence(self, study: Study | None = None) -> None:
        """Refuse to call a run whole whose folder was removed or replaced meanwhile."""
        views = study.views if study else {}
        for name in ("config.yaml", *(f"{view}/compression.json" for view in views)):
            if not (self.path / name).is_file():
                raise InputError(
                    f"{self.path / name}: was removed during the run; its results are incomplete"
                )
        if self._begun is None or not os.path.samestat(
            (self.path / "config.yaml").stat(), self._begun
        ):
            raise InputError(f"{self.path}: was replaced during the run")

    def _record(self, study: Study | None, status: Status) -> dict[str, Any]:
        """What `run.json` holds, once all files but the page are written."""
        record = run_record(
            self.path,
            status=status,
            seed=self._config.seed,
            settings=self._config.plain(),
            stage_seconds=study.stage_seconds if study else {},
            warnings=study.notes if study else (),
            run_hash=self._hash,
        )
        record["title"] = self._title
        record["stages_reused"] = self.stages.reused
        views = study.views if study else {}
        record["views"] = {name: _view_record(view) for name, view in views.items()}
        series = {name: _series_record(view) for name, view in views.items() if view.series}
        if series:
            record["tomosynthesis"] = series
        return record


def _series_record(result: ViewResult) -> dict[str, Any]:
    """Geometry of a series of projections, and of the slices reconstructed from it."""
    assert result.series is not None
    record = series_geometry(result.series)
    if result.reconstruction is not None:
        record["reconstruction"] = reconstruction_geometry(result.reconstruction)
    return record


def _view_record(result: ViewResult) -> dict[str, Any]:
    """Numbers of one view: compression, technique, dose and density."""
    compressed, mammogram = result.compressed, result.mammogram
    record = {
        "view": compressed.view.label,
        "laterality": compressed.view.laterality,
        "model": compressed.model,
        "converged": compressed.converged,
        "thickness_mm": compressed.thickness_mm,
        "force_n": compressed.force_n,
        "muscle_standing": compressed.phantom.muscle_standing,
    }
    if mammogram is None:
        return record
    technique = {name: getattr(mammogram, name) for name in TECHNIQUE}
    return {**record, **technique, **mammogram.measures}
