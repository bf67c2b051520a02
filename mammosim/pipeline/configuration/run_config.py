"""The configuration of a run: its sections, in the order of the stages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from mammosim.acquisition import AcquisitionSettings
from mammosim.compression import MODELS, CompressionSettings, compressing_models, weightless
from mammosim.config import Settings, to_settings
from mammosim.errors import InputError
from mammosim.export import ExportSettings, PatientSettings, age_problems
from mammosim.phantom import PhantomSettings, Side
from mammosim.pipeline.configuration.exam_sides import named_sides, side_problems
from mammosim.pipeline.configuration.resolved_view import BiopsyPosition, ResolvedView
from mammosim.pipeline.configuration.view_settings import VIEW_SECTIONS, ViewSettings
from mammosim.projection import ProjectionSettings
from mammosim.report import ReportSettings
from mammosim.targets import TargetsSettings

PLATE_KEYS = {"thickness_mm", "force_n", "support_z_mm", "paddle_z_mm", "plates_voxel"}
"""Ways to say how far a breast is compressed; a view's own replaces the section's."""


class RunConfig(Settings):
    """Everything that decides a run."""

    patient: PatientSettings | None = None
    """The patient in the DICOM objects."""

    phantom: PhantomSettings
    """The uncompressed breast: a file, or settings of the generator."""

    compression: CompressionSettings = CompressionSettings()
    """Compression between paddle and support."""

    projection: ProjectionSettings = ProjectionSettings()
    """Geometry of the X-ray projection."""

    acquisition: AcquisitionSettings = AcquisitionSettings()
    """Spectrum, detector, exposure and presentation."""

    targets: TargetsSettings = TargetsSettings()
    """What is computed for lesions and landmarks."""

    export: ExportSettings = ExportSettings()
    """Which files are written."""

    report: ReportSettings = ReportSettings()
    """The HTML report."""

    seed: int = Field(default=1, ge=0, le=2**63 - 1)
    """Seed of everything random: the generated breast, lesions, visiting order, noise."""

    views: tuple[ViewSettings, ...] = Field(
        default=(ViewSettings(view="CC"), ViewSettings(view="MLO")),
        min_length=1,
    )
    """Views to make: names, or mappings with values for that view only."""

    laterality: Side | tuple[Side, Side] | None = None
    """Which breast it is, or both as `[R, L]`; default: as the phantom shows, otherwise L. It never
    mirrors the phantom."""

    @field_validator("laterality", mode="before")
    @classmethod
    def _each_side_once(cls, value: Any) -> Any:
        sides = list(value) if isinstance(value, (list, tuple)) else [value]
        if not sides or (value is not None and any(side not in ("L", "R") for side in sides)):
            raise ValueError("expected L, R, or both as [R, L]")
        twice = sorted({side for side in sides if sides.count(side) > 1})
        if twice:
            raise ValueError(f"names {twice[0]} twice; each side may be named once")
        return tuple(sides) if len(sides) > 1 else sides[0]

    _resolved: tuple[ResolvedView, ...] = PrivateAttr(())
    _breast_number: int = PrivateAttr(0)

    @model_validator(mode="after")
    def _parts_fit_each_other(self) -> Self:
        sides = named_sides(self.laterality, self.phantom)
        problems = side_problems(sides, self.phantom, self.views)
        if self.patient is not None:
            problems += age_problems(self.patient, self.export.date)
        if problems:
            raise InputError(problems)
        self._resolved = self._resolve()
        return self

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other values, its views resolved anew."""
        copied = super().model_copy(update=update, deep=deep)
        copied._resolved = copied._resolve()
        return copied

    @property
    def resolved_views(self) -> tuple[ResolvedView, ...]:
        """The views in order, each with its settings; resolved once, when they are checked."""
        return self._resolved

    @property
    def breast_number(self) -> int:
        """Which breast of the exam this is: 0, or 1 for the second of two."""
        return self._breast_number

    @property
    def sides(self) -> tuple[Self, ...]:
        """A configuration for each breast alone, in order; of one breast the whole itself."""
        named = named_sides(self.laterality, self.phantom)
        if not named:
            return (self,)
        return tuple(self._of_side(side, number) for number, side in enumerate(named))

    @property
    def first_side(self) -> Side | None:
        """The side that is named, of two the first; None where the phantom is to show it."""
        named = named_sides(self.laterality, self.phantom)
        return named[0] if named else None

    def of_side(self, laterality: str) -> Self:
        """The configuration for one breast alone."""
        return next(one for one in self.sides if one.laterality in (laterality, None))

    def _of_side(self, side: Side, number: int) -> Self:
        own: dict[str, Any] = {"phantom": self.phantom.of_side(side, first=number == 0)}
        if any(view.laterality is not None for view in self.views):
            views = [view for view in self.views if view.laterality in (side, None)]
            own["views"] = tuple(view.model_copy(update={"laterality": None}) for view in views)
        if side == self.laterality and own == {"phantom": self.phantom}:
            return self
        one = self.model_copy(update={**own, "laterality": side})
        one._breast_number = number
        return one

    def _resolve(self) -> tuple[ResolvedView, ...]:
        problems: list[str] = []
        resolved = []
        for number, view in enumerate(self.views):
            sections: dict[str, Any] = {}
            for section in VIEW_SECTIONS:
                try:
                    sections[section] = self._section_for(view, section)
                except InputError as error:
                    problems.extend(
                        line.removeprefix(": ").replace(section, f"views.{number}.{section}", 1)
                        for line in error.problems
                    )
            if not problems:
                problems += _draws_problems(number, view, sections["acquisition"])
            if not problems:
                biopsy = self._biopsy_position(view, sections["compression"])
                one = ResolvedView(
                    view.view, **sections, tomosynthesis=view.dbt, biopsy=biopsy,
                    dose_map=self.export.dose_map, title=view.title,
                )  # fmt: skip
                resolved.append(one)
        if not problems:
            problems += self._models_without_weight(resolved)
        if not problems and self.targets.uncertainty is not None:
            problems += self._models_that_cannot_be_varied(resolved)
        if problems:
            raise InputError(problems)
        return tuple(resolved)

    def _section_for(self, view: ViewSettings, section: str) -> Any:
        """Settings of a section as they hold for one view."""
        base = getattr(self, section).model_dump(mode="json", exclude_unset=True)
        own = getattr(view, section)
        if section == "compression" and PLATE_KEYS & own.keys():
            base = {key: value for key, value in base.items() if key not in PLATE_KEYS}
        return to_settings(VIEW_SECTIONS[section], {**base, **own}, "", (section,))

    def _biopsy_position(
        self, view: ViewSettings, compression: CompressionSettings
    ) -> BiopsyPosition | None:
        """View and compression in which a needle goes for what one view's mammogram showed.

        Plates are those of the biopsy where it says, else of the mammogram in the biopsy's view.
        """
        biopsy = self.targets.biopsy
        if biopsy is None:
            return None
        name = view.view if biopsy.view == "same" or biopsy.view == "none" else biopsy.view
        if biopsy.view == "none":
            angle = compression.mlo_angle_deg
            if biopsy.posture is None:
                return BiopsyPosition(name, CompressionSettings(model="none", mlo_angle_deg=angle))
            elements = compression
            if compression.model != "hyperelastic":
                elements = CompressionSettings(model="hyperelastic", mlo_angle_deg=angle)
            return BiopsyPosition(name, elements, biopsy.posture)
        of_name = [view, *self.views, ViewSettings(view=name)]
        own = dict(next(one for one in of_name if one.view == name).compression)
        plates = biopsy.model_dump(include={"thickness_mm", "force_n"}, exclude_none=True)
        if plates:
            own = {key: value for key, value in own.items() if key not in PLATE_KEYS} | plates
        held = ViewSettings(view=name, compression=own)
        return BiopsyPosition(name, self._section_for(held, "compression"))

    def _models_without_weight(self, views: Sequence[ResolvedView]) -> list[str]:
        """Views, and biopsies between plates, whose model cannot free the breast from weight."""
        shaped = self.phantom.shaped_under
        if shaped == "none":
            return []
        models = {view.compression.model for view in views}
        models |= {view.biopsy.compression.model for view in views if view.biopsy is not None}
        return [text for model in sorted(models) for text in weightless(shaped, model)]

    def _models_that_cannot_be_varied(self, views: Sequence[ResolvedView]) -> list[str]:
        held = {view.label: view.compression for view in views}
        if self.targets.biopsy is not None and self.targets.biopsy.view != "none":
            position = views[0].biopsy
            if position is not None:
                held["biopsy"] = position.compression
        return [
            f"targets.uncertainty: {name} has compression.model {settings.model}; only "
            f"{' and '.join(compressing_models())} can be varied"
            for name, settings in held.items()
            if not MODELS[settings.model].compresses
        ]

    def plain(self) -> dict[str, Any]:
        """All values as in YAML, with defaults filled in except for those that are None."""
        return self.model_dump(mode="json", exclude_none=True)


def _draws_problems(number: int, view: ViewSettings, acquisition: AcquisitionSettings) -> list[str]:
    """Several draws of what is not one exposure."""
    of = "a series of projections" if view.dbt is not None else ""
    if acquisition.contrast is not None:
        of = "a pair of exposures with contrast agent"
    if not of or acquisition.realisations in (None, 1):
        return []
    return [
        f"views.{number}.acquisition.realisations: found {acquisition.realisations} for {of}, of "
        "which one draw is made; expected 1"
    ]
