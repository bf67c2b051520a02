"""A run's folder: where each stage's results are written, whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Mammogram, Tomosynthesis
from mammosim.compression import CompressedBreast
from mammosim.config import write_yaml
from mammosim.errors import InputError
from mammosim.export import (
    PART_PREFIX,
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
from mammosim.phantom import open_voxels
from mammosim.pipeline.configuration.run_config import RunConfig, input_paths, without_paths
from mammosim.pipeline.folder.stage_cache import StageCache
from mammosim.projection import PathLengths, compressed_labels
from mammosim.report import (
    NOT_HASHED,
    ReportedView,
    ReportSettings,
    Status,
    file_hash,
    render_report,
    run_hash,
    run_record,
)
from mammosim.targets import BiopsyResult, RuleError, ShiftAnswers, ShiftUncertainty, Target

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
        inputs = _Inputs.of(config)
        self._hash = _hash_of(config, inputs)
        self._identity = StudyIdentity(self._hash, f"Simulated mammography: {self._title}")
        self.stages = StageCache(self.path, (*inputs.labels, *inputs.voxels), reuse)
        _remove_earlier_run(self.path)
        with whole_file(self.path / "config.yaml") as part:
            write_yaml(config.plain(), part)

    def write_compression(self, squeezed: CompressedBreast) -> None:
        """Write a view's compressed labels, displacement, history and measures."""
        settings = self._config.export
        wanted = settings.volumes or settings.compressed_formats
        labels, frame = compressed_labels(squeezed) if wanted else (None, None)
        folder = self.path / squeezed.view.folder
        write_compressed(folder, squeezed, settings, labels, frame, self._config.seed)

    def write_images(
        self, paths: PathLengths, mammogram: Mammogram, targets: Sequence[Target]
    ) -> None:
        """Write a view's pictures and masks."""
        folder = self.path / mammogram.gantry.view.folder
        write_images(folder, paths, mammogram, targets, self._config.export, self._identity)

    def write_series(
        self,
        series: Tomosynthesis,
        middle: PathLengths,
        lesion_images: Sequence[NDArray[np.unsignedinteger]],
    ) -> None:
        """Write a view's projections and masks."""
        folder = self.path / series.middle.gantry.view.folder
        write_series(folder, series, middle, lesion_images, self._config.export)

    def write_summary(
        self,
        views: Sequence[tuple[CompressedBreast, Mammogram | None]],
        targets: Sequence[Target],
        notes: Sequence[str],
        stage_seconds: Mapping[str, float],
        status: Status,
        report: ReportSettings,
        series: Mapping[str, Tomosynthesis],
        answers: ShiftAnswers,
    ) -> None:
        """Write the tables of the lesions, the run's record and the page."""
        write_lesions(targets, self.path / "lesions.csv")
        for kind, rows, name in (
            (RuleError, answers.rules, "view_rules"),
            (BiopsyResult, answers.biopsy, "biopsy"),
            (ShiftUncertainty, answers.uncertainty, "uncertainty"),
        ):
            if rows:
                write_table(kind, rows, self.path / f"{name}.csv")
        warnings = list(notes)
        for squeezed, mammogram in views:
            warnings += [*squeezed.notes, *(mammogram.notes if mammogram else ())]
            if not squeezed.converged:
                warnings.append(f"{squeezed.view.folder}: the compression did not converge")
        record: dict[str, Any] = run_record(
            self.path,
            status=status,
            seed=self._config.seed,
            settings=self._config.plain(),
            stage_seconds=stage_seconds,
            warnings=warnings,
            run_hash=self._hash,
        )
        record["title"] = self._title
        record["stages_reused"] = self.stages.reused
        record["views"] = {view.view.folder: _view_record(view, taken) for view, taken in views}
        if series:
            geometry = {name: series_geometry(taken) for name, taken in series.items()}
            record["tomosynthesis"] = geometry
        if report.html:
            page = render_report(
                [ReportedView(*view) for view in views],
                targets,
                record,
                report,
                self._title,
                answers,
            )
            write_text(self.path / "report.html", page)
        write_json(self.path / "run.json", record)


def _view_record(squeezed: CompressedBreast, mammogram: Mammogram | None) -> dict[str, Any]:
    """Numbers of one view: compression, technique, dose and density."""
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


@dataclass(frozen=True)
class _Inputs:
    """Hashes of the files that a configuration names, and of those that they consist of."""

    labels: tuple[str, ...]
    others: tuple[str, ...]
    voxels: tuple[str, ...]

    @classmethod
    def of(cls, config: RunConfig) -> _Inputs:
        named = [(where, Path(path)) for where, path in input_paths(config)]
        files = [(where, path) for where, path in named if _is_file(path)]
        labels = [path for where, path in files if where == ("phantom", "labels")]
        others = [path for where, path in files if where[0] != "phantom"]
        voxels = open_voxels(config.phantom.file).files if config.phantom.file else ()
        hashes = [tuple(file_hash(path) for path in part) for part in (labels, others, voxels)]
        return cls(*hashes)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        return False  # no name that the system knows: said when the file is read


def _hash_of(config: RunConfig, inputs: _Inputs) -> str:
    from mammosim import __version__

    files = (*inputs.labels, *inputs.others, *inputs.voxels)
    return run_hash(without_paths(config), config.seed, __version__, files)


def _remove_earlier_run(folder: Path) -> None:
    """Remove what an earlier run left, its record first, so that no record outlives its files."""
    record = read_record(folder)
    hashes = record.get("files")
    try:
        for name in NOT_HASHED:
            (folder / name).unlink(missing_ok=True)
        for name, wanted in hashes.items() if isinstance(hashes, dict) else ():
            if _is_unharmed(folder, name, wanted):
                (folder / name).unlink()
        for part in folder.rglob(f"{PART_PREFIX}*"):
            if part.is_file():
                part.unlink()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None


def check_output(path: Path, resume: bool, overwrite: bool) -> None:
    """Refuse a folder that holds something, unless it is to be resumed or overwritten.

    Raises
    ------
    InputError
        If the folder is not empty, or is no folder.
    """
    if path.exists() and not path.is_dir():
        raise InputError(f"{path}: is not a folder, cannot be a run's output")
    if path.is_dir() and any(path.iterdir()) and not (resume or overwrite):
        raise InputError(
            f"{path}: exists and is not empty; give --resume, --overwrite, or another --output"
        )


def is_finished(path: Path, config: RunConfig) -> bool:
    """Whether the folder holds the finished run of this very configuration, all files unharmed."""
    record = read_record(path)
    if record.get("status") != "done" or record.get("settings") != config.plain():
        return False
    if record.get("run_hash") != _hash_of(config, _Inputs.of(config)):
        return False
    hashes = record.get("files")
    return isinstance(hashes, dict) and all(
        _is_unharmed(path, name, wanted) for name, wanted in hashes.items()
    )


def read_record(path: Path) -> dict[str, Any]:
    """What a folder's `run.json` says; empty where there is none that can be read."""
    try:
        record = json.loads((path / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _is_unharmed(folder: Path, name: str, wanted: Any) -> bool:
    file = folder / name
    try:
        return file.resolve().is_relative_to(folder.resolve()) and file_hash(file) == wanted
    except (OSError, ValueError):
        return False


def title_of(path: Path) -> str:
    """What a run of this configuration is called: as before, if it is a run's record."""
    if path.suffix == ".json":
        title = read_record(path.parent).get("title") if path.name == "run.json" else None
        return title if isinstance(title, str) else path.stem
    return path.stem
