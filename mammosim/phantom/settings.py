"""The `phantom` section of a configuration."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from mammosim.config import Settings
from mammosim.phantom.anatomy import GenerateSettings


class LesionSettings(Settings):
    """A lesion to put into the breast before compression."""

    name: str = Field(min_length=1, max_length=64)
    """Name of the lesion, each used once."""

    kind: Literal["mass", "calcification", "clip"]
    """A mass, a cluster of calcifications, or a biopsy clip."""

    diameter_mm: float | None = Field(None, gt=0.0, le=100.0)
    """Diameter of the mass or cluster, or length of the clip, mm; left out, 10, 10 and 3."""

    position_mm: tuple[float, float, float] | None = None
    """Centre in the breast frame, mm; left out, a place where such lesions occur is drawn."""

    margin: Literal["smooth", "lobulated", "spiculated"] = "lobulated"
    """Outline of a mass."""

    count: int | None = Field(None, ge=1, le=200)
    """Number of calcifications in a cluster; left out, drawn from 5 to 30."""

    calcification_mm: float | None = Field(None, ge=0.05, le=3.0)
    """Diameter of each calcification, mm; left out, drawn for each from 0.1 to 0.8."""

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Self:
        belongs = {"margin": "mass", "count": "calcification", "calcification_mm": "calcification"}
        foreign = [
            key for key, kind in belongs.items()
            if kind != self.kind and getattr(self, key) != type(self).model_fields[key].default
        ]  # fmt: skip
        if foreign:
            raise ValueError(f"{', '.join(foreign)} does not belong to kind '{self.kind}'")
        return self

    @property
    def size_mm(self) -> float:
        """Diameter given, or the kind's own, mm.

        A mass of 10 mm is a choice, the upper end of stage T1b; a cluster lies within 1 cm (ACR
        BI-RADS Atlas, 5th edition, 2013, "Grouped"); clips are some millimetres long.
        """
        return self.diameter_mm or {"mass": 10.0, "calcification": 10.0, "clip": 3.0}[self.kind]


class LandmarkSettings(Settings):
    """A point to follow through compression."""

    name: str = Field(min_length=1, max_length=64)
    """Name of the landmark, each used once."""

    position_mm: tuple[float, float, float]
    """Position in the breast frame, mm; it must lie in tissue."""


class PhantomSettings(Settings):
    """The uncompressed breast: read from a file, or generated."""

    file: str | None = None
    """Voxel file, relative to the configuration's folder."""

    labels: str | None = None
    """Label map of the file: a known name, or path of a YAML file; left out, `mammosim`."""

    generate: GenerateSettings | None = None
    """Settings of the built-in generator."""

    lesions: tuple[LesionSettings, ...] = ()
    """Lesions put in before compression."""

    landmarks: tuple[LandmarkSettings, ...] = ()
    """Points to follow through compression."""

    @model_validator(mode="after")
    def _whole(self) -> Self:
        problems = []
        if (self.file is None) == (self.generate is None):
            given = "neither" if self.file is None else "both"
            problems.append(f"exactly one of 'file' and 'generate' must be given, found {given}")
        if self.labels is not None and self.file is None and self.generate is not None:
            problems.append("'labels' belongs to 'file', not to 'generate'")
        names = [le.name for le in self.lesions] + [mark.name for mark in self.landmarks]
        for name in sorted({name for name in names if names.count(name) > 1}):
            problems.append(f"the name '{name}' is used more than once")
        if problems:
            raise ValueError("; ".join(problems))
        return self
