"""The configuration of a run: its sections, in the order of the stages."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from mammosim.acquisition import AcquisitionSettings
from mammosim.compression import CompressionSettings
from mammosim.config import Settings, parse_value, read_yaml, to_settings
from mammosim.errors import InputError
from mammosim.export import ExportSettings
from mammosim.phantom import PhantomSettings
from mammosim.pipeline.configuration.view_settings import VIEW_SECTIONS, ViewSettings
from mammosim.projection import ProjectionSettings
from mammosim.report import ReportSettings
from mammosim.targets import BiopsySettings, TargetsSettings

PLATE_KEYS = {"thickness_mm", "force_n", "support_z_mm", "paddle_z_mm", "plates_voxel"}
"""Ways to say how far a breast is compressed; a view's own replaces the section's."""

PATH_KEYS = (
    ("phantom", "file"),
    ("phantom", "labels"),
    ("acquisition", "spectrum_file"),
    ("acquisition", "composition"),
)
"""Keys whose value is, or may be, a path relative to the configuration's file."""


class RunConfig(Settings):
    """Everything that decides a run."""

    phantom: PhantomSettings
    """The uncompressed breast: a file, or settings of the generator."""

    compression: CompressionSettings = CompressionSettings()
    """Compression between paddle and support."""

    projection: ProjectionSettings = ProjectionSettings()
    """Geometry of the X-ray projection."""

    acquisition: AcquisitionSettings = AcquisitionSettings()
    """Spectrum, detector, exposure and presentation."""

    targets: TargetsSettings = TargetsSettings()
    """What is reported of lesions and landmarks."""

    export: ExportSettings = ExportSettings()
    """Which files are written."""

    report: ReportSettings = ReportSettings()
    """The HTML page."""

    seed: int = Field(1, ge=0)
    """Seed of everything random: the generated breast, lesions, visiting order, noise."""

    views: tuple[ViewSettings, ...] = Field(
        (ViewSettings(view="CC"), ViewSettings(view="MLO")),
        min_length=1,
    )
    """Views to make: names, or mappings with the view's own values."""

    laterality: Literal["L", "R"] | None = None
    """Which breast it is; left out: what the phantom shows, else L. It never mirrors."""

    @field_validator("views")
    @classmethod
    def _each_view_once(cls, views: tuple[ViewSettings, ...]) -> tuple[ViewSettings, ...]:
        names = [view.label for view in views]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is listed twice; each view may be listed once")
        return views

    @model_validator(mode="after")
    def _views_fit_their_sections(self) -> Self:
        problems: list[str] = []
        for number, view in enumerate(self.views):
            for section in VIEW_SECTIONS:
                try:
                    self.section_for(view, section)
                except InputError as error:
                    problems.extend(
                        line.removeprefix(": ").replace(section, f"views.{number}.{section}", 1)
                        for line in error.problems
                    )
        if not problems and self.targets.uncertainty is not None:
            problems += self._models_that_cannot_be_varied()
        if problems:
            raise InputError(problems)
        return self

    def _models_that_cannot_be_varied(self) -> list[str]:
        sections = {view.label: self.section_for(view, "compression") for view in self.views}
        if self.targets.biopsy is not None and self.targets.biopsy.view != "none":
            sections["biopsy"] = self.biopsy_section(self.views[0])[1]
        return [
            f"targets.uncertainty: {name} has compression.model none; only springs and "
            "hyperelastic can be varied"
            for name, section in sections.items()
            if section.model == "none"
        ]

    def section_for(self, view: ViewSettings, section: str) -> Any:
        """Settings of a section as they hold for one view."""
        base = getattr(self, section).model_dump(mode="json", exclude_unset=True)
        own = getattr(view, section)
        if section == "compression" and PLATE_KEYS & own.keys():
            base = {key: value for key, value in base.items() if key not in PLATE_KEYS}
        return to_settings(VIEW_SECTIONS[section], {**base, **own}, "", (section,))

    def biopsy_section(self, view: ViewSettings) -> tuple[str, CompressionSettings]:
        """View and compression in which a needle goes for what one view's mammogram showed.

        Plates are those of the biopsy where it says, else of the mammogram in the biopsy's view.
        """
        biopsy = self.targets.biopsy or BiopsySettings()
        name = view.view if biopsy.view in ("same", "none") else biopsy.view
        if biopsy.view == "none":
            angle = self.section_for(view, "compression").mlo_angle_deg
            return name, CompressionSettings(model="none", mlo_angle_deg=angle)
        of_name = [view, *self.views, ViewSettings(view=name)]
        own = dict(next(one for one in of_name if one.view == name).compression)
        plates = biopsy.model_dump(include={"thickness_mm", "force_n"}, exclude_none=True)
        if plates:
            own = {key: value for key, value in own.items() if key not in PLATE_KEYS} | plates
        held = ViewSettings(view=name, compression=own)
        return name, self.section_for(held, "compression")

    def plain(self) -> dict[str, Any]:
        """All values as YAML holds them, defaults filled in but for those that mean "left out"."""
        return self.model_dump(mode="json", exclude_none=True)


def load_config(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> RunConfig:
    """Read and check a configuration.

    Parameters
    ----------
    path : path
        A YAML file, or a run's `run.json`; paths in it are relative to it.
    changes : sequence of str
        ``section.key=value`` each, in place of what the file says; paths in them are relative to
        the current folder.

    Returns
    -------
    RunConfig

    Raises
    ------
    InputError
        With one line a mistake: file, key path, value found, what is allowed.
    """
    values = _run_settings(read_yaml(path), path)
    _make_paths_absolute(values, Path(path).resolve().parent)
    for change in changes:
        apply_change(values, change)
    return config_of(values, Path.cwd(), str(path))


def config_of(values: dict[str, Any], folder: Path, where: str) -> RunConfig:
    """Check plain values and make a configuration of them.

    Parameters
    ----------
    values : dict
        Plain values as YAML gives them; paths in them are made absolute in place.
    folder : Path
        What paths are relative to.
    where : str
        Where the values stand, for messages.

    Raises
    ------
    InputError
        With one line a mistake.
    """
    _make_paths_absolute(values, folder)
    try:
        return to_settings(RunConfig, values, where)
    except InputError as error:
        raise InputError(
            line if line.startswith(where) else f"{where}: {line}" for line in error.problems
        ) from None


def is_cohort(values: Any) -> bool:
    """Whether a file's plain values are a cohort's, not a run's configuration."""
    return isinstance(values, dict) and not values.keys().isdisjoint(("cohort", "cohort_of"))


def _run_settings(values: Any, path: str | os.PathLike[str]) -> dict[str, Any]:
    """The configuration, also where it stands in a run's record."""
    if isinstance(values, dict) and {"run_hash", "settings"} <= values.keys():
        values = values["settings"]
    if is_cohort(values):
        raise InputError(f"{path}: is a cohort's file; use mammosim cohort run")
    if not isinstance(values, dict):
        raise InputError(f"{path}: expected a mapping with the section 'phantom'")
    return values


def _make_paths_absolute(values: dict[str, Any], folder: Path) -> None:
    for where, value in named_paths(values):
        block = values
        for key in where[:-1]:
            block = block[key]
        block[where[-1]] = str(folder / Path(value).expanduser())


def named_paths(values: dict[str, Any]) -> list[tuple[tuple[Any, ...], str]]:
    """Where a configuration's plain values name files, and the paths: in sections and in views."""
    found: list[tuple[tuple[Any, ...], Any]] = []
    views = values.get("views")
    for section, key in PATH_KEYS:
        places: list[tuple[Any, ...]] = [(section,)]
        if section in VIEW_SECTIONS and isinstance(views, list):
            for number in range(len(views)):
                places += [("views", number), ("views", number, section)]
        found += [((*place, key), _inside(values, (*place, key))) for place in places]
    return [
        (where, value)
        for where, value in found
        if isinstance(value, str) and (where[-1].endswith("file") or Path(value).suffix)
    ]


def input_paths(config: RunConfig) -> list[tuple[tuple[Any, ...], str]]:
    """Key paths at which a configuration names files, and the absolute paths."""
    named = named_paths(config.plain())
    return [(where, value) for where, value in named if Path(value).is_absolute()]


def without_paths(config: RunConfig) -> dict[str, Any]:
    """The configuration's values, without where its input files lie."""
    values = config.plain()
    for where, value in input_paths(config):
        block = values
        for key in where[:-1]:
            block = block[key]
        block[where[-1]] = Path(value).name
    return values


def _inside(values: Any, where: tuple[Any, ...]) -> Any:
    """What stands at a key path; None where nothing does."""
    for key in where:
        if isinstance(key, int):
            values = values[key] if isinstance(values, list) else None
        else:
            values = values.get(key) if isinstance(values, dict) else None
    return values


def apply_change(values: dict[str, Any], change: str) -> None:
    """Put ``section.key=value`` in place of what plain values say."""
    name, equals, text = change.partition("=")
    keys = name.strip().split(".")
    if not equals or not all(keys):
        raise InputError(f"--set: found '{change}', expected section.key=value")
    block = values
    for key in keys[:-1]:
        below = block.get(key)
        if below is None:
            below = block[key] = {}
        if not isinstance(below, dict):
            raise InputError(f"--set: '{name}': {key} is not a section")
        block = below
    block[keys[-1]] = parse_value(text, f"--set {name}")
