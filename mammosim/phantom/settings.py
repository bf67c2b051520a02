"""The `phantom` section of a configuration."""

from __future__ import annotations

from typing import Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from mammosim.config import Settings
from mammosim.phantom.anatomy import GenerateSettings
from mammosim.phantom.memory import MOST_REDUCED
from mammosim.phantom.readers.axes import AXES_EXPECTED, are_axes


class LesionSettings(Settings):
    """A lesion to put into the breast before compression."""

    name: str = Field(min_length=1, max_length=64)
    """Name of the lesion, each used once."""

    kind: Literal["mass", "calcification", "clip"]
    """A mass, a cluster of calcifications, or a biopsy clip."""

    diameter_mm: float | None = Field(default=None, gt=0.0, le=100.0)
    """Diameter of the mass or cluster, or length of the clip, mm; left out, 10, 10 and 3, and 25
    along an artery."""

    position_mm: tuple[float, float, float] | None = None
    """Centre in the breast frame, mm; left out, a place where such lesions occur is drawn."""

    margin: Literal["smooth", "lobulated", "spiculated", "distortion"] = "lobulated"
    """Outline of a mass; `distortion` is architectural distortion, spicules without a mass."""

    morphology: Literal["punctate", "pleomorphic", "linear", "vascular"] = "pleomorphic"
    """Form of calcifications: round, irregular, in a row that forks along ducts, or in the wall of
    an artery, which the breast must have there."""

    count: int | None = Field(default=None, ge=1, le=200)
    """Number of calcifications in a cluster, not of an artery; left out, drawn from 5 to 30."""

    calcification_mm: float | None = Field(default=None, ge=0.05, le=3.0)
    """Diameter of a ball of each calcification's volume, mm, or thickness of calcified wall; left
    out, drawn for each from 0.1 to 0.8, and 0.08 in a wall."""

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Self:
        own = ("morphology", "count", "calcification_mm")
        belongs = {"margin": "mass", **dict.fromkeys(own, "calcification")}
        foreign = [
            key for key, kind in belongs.items()
            if kind != self.kind and getattr(self, key) != type(self).model_fields[key].default
        ]  # fmt: skip
        if foreign:
            raise ValueError(f"{', '.join(foreign)} does not belong to kind '{self.kind}'")
        if self.count is not None and self.morphology == "vascular":
            raise ValueError("count does not belong to morphology 'vascular'")
        return self

    @property
    def size_mm(self) -> float:
        """Diameter given, or the kind's own, mm.

        A mass of 10 mm is a choice, the upper end of stage T1b; a cluster lies within 1 cm (ACR
        BI-RADS Atlas, 5th edition, 2013, "Grouped"); clips are some millimetres long; the length
        along an artery is a choice.
        """
        if self.diameter_mm is None and self.morphology == "vascular":
            return 25.0
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
    """Voxel file, or folder of a DICOM series, relative to the configuration's folder."""

    labels: str | None = None
    """Label map: a name, or path of a YAML file; left out, what a .vctx says, else `mammosim`."""

    axes: str | None = None
    """Towards what the file's axes run, as `ALS`; left out, what it says or its voxels show."""

    voxel_mm: float | tuple[float, float, float] | None = None
    """Voxel size along the file's axes, mm, one number or three; left out, what the file says."""

    reduce: int = Field(default=1, ge=1, le=MOST_REDUCED)
    """Of every n voxels of the file along each axis one is kept, for what exceeds memory."""

    generate: GenerateSettings | None = None
    """Settings of the built-in generator."""

    lesions: tuple[LesionSettings, ...] = ()
    """Lesions put in before compression."""

    landmarks: tuple[LandmarkSettings, ...] = ()
    """Points to follow through compression."""

    @field_validator("axes")
    @classmethod
    def _three_directions(cls, axes: str | None) -> str | None:
        if axes is not None and not are_axes(axes):
            raise ValueError(f"expected {AXES_EXPECTED}")
        return axes

    @field_validator("voxel_mm")
    @classmethod
    def _a_size(cls, voxel_mm: Any) -> Any:
        sizes = voxel_mm if isinstance(voxel_mm, tuple) else (voxel_mm,)
        if voxel_mm is not None and not all(0.0 < size <= 10.0 for size in sizes):
            raise ValueError("expected lengths above 0 and up to 10 mm")
        return voxel_mm

    @model_validator(mode="after")
    def _whole(self) -> Self:
        problems = []
        if (self.file is None) == (self.generate is None):
            given = "neither" if self.file is None else "both"
            problems.append(f"exactly one of 'file' and 'generate' must be given, found {given}")
        if self.file is None and self.generate is not None:
            keys = ("labels", "axes", "voxel_mm", "reduce")
            problems += [
                f"'{key}' belongs to 'file', not to 'generate'"
                for key in keys if getattr(self, key) != type(self).model_fields[key].default
            ]  # fmt: skip
        names = [le.name for le in self.lesions] + [mark.name for mark in self.landmarks]
        for name in sorted({name for name in names if names.count(name) > 1}):
            problems.append(f"the name '{name}' is used more than once")
        if problems:
            raise ValueError("; ".join(problems))
        return self
