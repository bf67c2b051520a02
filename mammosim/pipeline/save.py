"""A run's folder: where each stage's results are written, whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Mammogram, Tomosynthesis
from mammosim.compression import CompressedBreast
from mammosim.config import write_yaml
from mammosim.errors import InputError
from mammosim.export import (
    StudyIdentity,
    series_geometry,
    whole_file,
    write_compressed,
    write_images,
    write_json,
    write_lesions,
    write_series,
    write_text,
)
from mammosim.phantom.readers import open_voxels
from mammosim.pipeline.run_config import RunConfig, named_paths
from mammosim.projection import PathLengths, compressed_labels
from mammosim.report import (
    ReportedView,
    ReportSettings,
    Status,
    file_hash,
    render_report,
    run_hash,
    run_record,
)
from mammosim.targets import Target


class RunFolder:
    """The folder of one run.

    Parameters
    ----------
    path : path
        Is made; what lies in it is replaced file by file.
    config : RunConfig
    title : str
        Name of the run in the report.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """

    def __init__(self, path: str | os.PathLike[str], config: RunConfig, title: str = "") -> None:
        from mammosim import __version__

        self.path = Path(path)
        self._config = config
        self._title = title or self.path.name
        self._hash = run_hash(_without_paths(config), config.seed, __version__, _inputs(config))
        self._identity = StudyIdentity(self._hash, f"Simulated mammography: {self._title}")
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
    ) -> None:
        """Write the lesion table, the run's record and the page."""
        write_lesions(targets, self.path / "lesions.csv")
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
        if series:
            geometry = {name: series_geometry(taken) for name, taken in series.items()}
            record["tomosynthesis"] = geometry
        if report.html:
            page = render_report(
                [ReportedView(*view) for view in views], targets, record, report, self._title
            )
            write_text(self.path / "report.html", page)
        write_json(self.path / "run.json", record)


def _inputs(config: RunConfig) -> list[str]:
    """Hashes of the files that a configuration names, and of those that they consist of."""
    named = [Path(value) for where, value in _paths(config) if where != ("phantom", "file")]
    files = [path for path in named if path.is_file()]
    if config.phantom.file is not None:
        files += open_voxels(config.phantom.file).files
    return [file_hash(path) for path in files]


def _without_paths(config: RunConfig) -> dict[str, Any]:
    """The configuration's values, without where its input files lie."""
    values = config.plain()
    for where, value in _paths(config):
        block = values
        for key in where[:-1]:
            block = block[key]
        block[where[-1]] = Path(value).name
    return values


def _paths(config: RunConfig) -> list[tuple[tuple[Any, ...], str]]:
    named = named_paths(config.plain())
    return [(where, value) for where, value in named if Path(value).is_absolute()]


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
    """Whether the folder holds the finished run of this very configuration."""
    try:
        record = json.loads((path / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return (
        isinstance(record, dict)
        and record.get("status") == "done"
        and record.get("settings") == config.plain()
    )
