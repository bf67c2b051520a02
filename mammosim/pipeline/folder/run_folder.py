"""A run's folder: where each stage's results are written, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mammosim.compression import CompressedBreast
from mammosim.config import write_yaml
from mammosim.export import (
    StudyIdentity,
    series_geometry,
    whole_file,
    write_compressed,
    write_images,
    write_json,
    write_lesions,
    write_series,
    write_table,
    write_text,
)
from mammosim.pipeline.configuration import RunConfig
from mammosim.pipeline.folder.earlier_run import remove_earlier_run
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

TECHNIQUE = ("target", "filter", "kvp", "mas", "hvl_mm_al", "air_kerma_mgy", "dose_mgy")
"""Of a mammogram, in the run's record; of a series of projections, those of the middle one."""


class RunFolder:
    """The folder of one run.

    Parameters
    ----------
    path : path
        Is made; what lies in it is replaced file by file.
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
        If the folder cannot be made or written to.
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
        self._identity = StudyIdentity(self._hash, f"Simulated mammography: {self._title}")
        self.stages = StageCache(self.path, (*inputs.labels, *inputs.voxels), reuse)
        remove_earlier_run(self.path)
        with whole_file(self.path / "config.yaml") as part:
            write_yaml(config.plain(), part)

    def write_compression(self, squeezed: CompressedBreast) -> None:
        """Write a view's compressed labels, displacement, history and measures."""
        settings = self._config.export
        wanted = settings.volumes or settings.compressed_formats
        labels, frame = compressed_labels(squeezed) if wanted else (None, None)
        folder = self.path / squeezed.view.folder
        write_compressed(folder, squeezed, settings, labels, frame, self._config.seed)

    def write_view(self, result: ViewResult) -> None:
        """Write a view's pictures and masks, of a mammogram or of a series of projections."""
        if result.paths is None or result.mammogram is None:
            return
        folder, export = self.path / result.squeezed.view.folder, self._config.export
        if result.series is not None:
            write_series(folder, result.series, result.paths, result.lesion_images, export)
        else:
            write_images(
                folder, result.paths, result.mammogram, result.targets, export, self._identity
            )

    def write_summary(self, study: Study, status: Status) -> None:
        """Write the tables of the lesions, the run's record and the page."""
        write_lesions(study.targets, self.path / "lesions.csv")
        for kind, rows, name in (
            (RuleError, study.answers.rules, "view_rules"),
            (BiopsyResult, study.answers.biopsy, "biopsy"),
            (ShiftUncertainty, study.answers.uncertainty, "uncertainty"),
        ):
            if rows:
                write_table(kind, rows, self.path / f"{name}.csv")
        record = self._record(study, status)
        if self._config.report.html:
            views = [ReportedView(view.squeezed, view.mammogram) for view in study.views.values()]
            page = render_report(
                views, study.targets, record, self._config.report, self._title, study.answers
            )
            write_text(self.path / "report.html", page)
        write_json(self.path / "run.json", record)

    def _record(self, study: Study, status: Status) -> dict[str, Any]:
        """What `run.json` holds, once all files but the page are written."""
        record = run_record(
            self.path,
            status=status,
            seed=self._config.seed,
            settings=self._config.plain(),
            stage_seconds=study.stage_seconds,
            warnings=study.notes,
            run_hash=self._hash,
        )
        record["title"] = self._title
        record["stages_reused"] = self.stages.reused
        record["views"] = {name: _view_record(view) for name, view in study.views.items()}
        series = {
            name: series_geometry(view.series) for name, view in study.views.items() if view.series
        }
        if series:
            record["tomosynthesis"] = series
        return record


def _view_record(result: ViewResult) -> dict[str, Any]:
    """Numbers of one view: compression, technique, dose and density."""
    squeezed, mammogram = result.squeezed, result.mammogram
    record = {
        "view": squeezed.view.label,
        "laterality": squeezed.view.laterality,
        "model": squeezed.model,
        "converged": squeezed.converged,
        "thickness_mm": squeezed.thickness_mm,
        "force_n": squeezed.force_n,
    }
    if mammogram is None:
        return record
    technique = {name: getattr(mammogram, name) for name in TECHNIQUE}
    return {**record, **technique, **mammogram.measures}
