"""The `phantom` section of a configuration."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, WithJsonSchema, field_validator, model_validator

from mammosim.config import Name, Position, Settings
from mammosim.phantom.anatomy import GenerateSettings
from mammosim.phantom.cut_ends import WAY_EXPECTED, is_way_out
from mammosim.phantom.lesion_kinds import LESION_KINDS, OwnKeys
from mammosim.phantom.lesion_pieces import MERGE_MM, MIN_VOLUME_MM3
from mammosim.phantom.memory import MAX_REDUCED
from mammosim.phantom.readers.axes import AXES_EXPECTED, are_axes
from mammosim.tissues import LESION_LABELS

FILE_EXPECTED = "one file, or one file per side, as {L: left.mhd, R: right.mhd}"

VOXEL_RANGE_MM = (1e-3, 10.0)
"""Voxel sizes of files, mm: micro-CT has 1e-3."""

VoxelSize = Annotated[
    float,
    WithJsonSchema({"type": "number", "minimum": VOXEL_RANGE_MM[0], "maximum": VOXEL_RANGE_MM[1]}),
]


def _known_kind(kind: str) -> str:
    if kind not in LESION_KINDS:
        raise ValueError(f"expected one of {', '.join(LESION_KINDS)}")
    return kind


Kind = Annotated[
    str,
    AfterValidator(_known_kind),
    WithJsonSchema({"type": "string", "enum": list(LESION_KINDS)}),
]


Side = Literal["L", "R"]
"""A breast: the patient's left or right one."""

Angle = Annotated[float, Field(ge=-360.0, le=360.0)]


class _AnyLesion(Settings):
    """Keys of a lesion of any kind."""

    name: Name
    """Unique name of the lesion."""

    kind: Kind
    """A mass, a cluster of calcifications, or a biopsy clip."""

    diameter_mm: float | None = Field(default=None, ge=0.05, le=100.0)
    """Diameter of the mass or cluster, or length of the clip, mm; default: 10, 10 and 3; 25 for
    calcifications along an artery; or the size in the lesion's file."""

    position_mm: Position | None = None
    """Centre in the breast frame, mm; default: drawn where such lesions occur."""

    laterality: Side | None = None
    """Breast that contains it, if both are imaged; default: the first of `laterality`."""

    file: str | None = None
    """Shape of the lesion: a voxel file in which values other than 0 are lesion (or values from 0
    to 1 are the fraction of each voxel that is), or a closed surface in mm (STL, OBJ, PLY, OFF);
    relative to the configuration's folder. Its axes are those of the breast frame. It is scaled if
    `diameter_mm` is given, the diameter of the sphere around it."""

    voxel_mm: float | None = Field(default=None, ge=1e-3, le=10.0)
    """Edge length of that file's voxels, mm; default: from the file."""

    rotation_deg: tuple[Angle, Angle, Angle] | None = None
    """Rotations of that shape about the x, then y, then z axis of the breast frame, right-handed,
    degrees; default: none."""


class LesionSettings(OwnKeys, _AnyLesion):
    """A lesion to insert into the breast before compression."""

    @model_validator(mode="after")
    def _keys_of_its_kind(self) -> Self:
        foreign = [key for name in LESION_KINDS if name != self.kind for key in self._given(name)]
        if foreign:
            raise ValueError(f"{', '.join(foreign)} does not belong to kind '{self.kind}'")
        return self

    @model_validator(mode="after")
    def _keys_of_a_file(self) -> Self:
        if self.file is None:
            keys = [key for key in ("voxel_mm", "rotation_deg") if getattr(self, key) is not None]
            if keys:
                raise ValueError(f"{', '.join(keys)} belongs to a lesion with a file")
            return self
        drawn = self._given(self.kind)
        if drawn:
            raise ValueError(f"{', '.join(drawn)} does not belong to a lesion with a file")
        return self

    def _given(self, kind: str) -> list[str]:
        """Keys of a kind's own that are not left at their defaults."""
        keys = LESION_KINDS[kind].keys
        fields = {} if keys is None else keys.model_fields
        return [key for key, field in fields.items() if getattr(self, key) != field.default]


class LandmarkSettings(Settings):
    """A point to follow through compression."""

    name: Name
    """Unique name of the landmark."""

    position_mm: Position
    """Position in the breast frame, mm; it must lie in tissue."""

    laterality: Side | None = None
    """Breast that contains it, if both are imaged; default: the first of `laterality`."""


class FoundLesionSettings(Settings):
    """Which mass voxels of a file form one lesion."""

    merge_mm: float = Field(default=MERGE_MM, ge=0, le=100)
    """Gap up to which pieces of a mass form one lesion, mm; with 0 each piece is a lesion."""

    min_volume_mm3: float = Field(default=MIN_VOLUME_MM3, ge=0, le=1e5)
    """Volume below which a piece belongs to the nearest mass, mm3; 0 merges none."""


class PhantomSettings(Settings):
    """The breast: read from a file, or generated."""

    file: str | dict[Side, str] | None = None
    """Voxel file, or folder of a DICOM series, relative to the configuration's folder; for both
    breasts a mapping such as `{L: left.mhd, R: right.mhd}`."""

    labels: str | None = None
    """Label map: a name, or the path of a YAML file; default: the one in a .vctx file, otherwise
    `mammosim`."""

    axes: str | None = None
    """Directions of the file's axes, such as `ALS`; default: from the file, or else inferred from
    its voxels."""

    voxel_mm: VoxelSize | tuple[VoxelSize, VoxelSize, VoxelSize] | None = None
    """Voxel size along the file's axes, mm, one number or three; default: from the file."""

    reduce: int = Field(default=1, ge=1, le=MAX_REDUCED)
    """Keep one of every n voxels of the file along each axis, for files larger than memory."""

    compressed_for: Literal["CC", "MLO", "ML"] | None = None
    """View for which the breast in the file is already compressed, with z from the breast support
    to the paddle; other views are refused. Default: from a volume that mammosim wrote; with
    labelled plates (50), the only view of the run."""

    shaped_under: Literal["none", "standing", "prone", "supine"] = "none"
    """Posture under whose weight the breast has the shape of its voxels, such as `prone` in MRI or
    `supine` in CT; the model `hyperelastic` first removes this weight (experimental). `none`: the
    shape is free of weight, as in generated breasts."""

    open_end: Literal["auto", "none"] | Position = "auto"
    """Where the breast is cut off though the body goes on, as towards the axilla: oblique images
    end there, other views leave it out. `auto`: a plane of tissue without skin, or on the array's
    end, is looked for; `none`: what the voxels show is the breast's own surface; or the way out
    there in the breast frame, such as `[0, 1, 1]`."""

    lesions_from_labels: FoundLesionSettings = FoundLesionSettings()
    """Which mass voxels of the file form one lesion."""

    generate: GenerateSettings | None = None
    """Settings of the built-in generator."""

    lesions: tuple[LesionSettings, ...] = Field(default=(), max_length=len(LESION_LABELS))
    """Lesions inserted before compression."""

    landmarks: tuple[LandmarkSettings, ...] = Field(default=(), max_length=1000)
    """Points to follow through compression."""

    @field_validator("file", mode="before")
    @classmethod
    def _a_file_or_one_a_side(cls, file: Any) -> Any:
        if isinstance(file, dict):
            if not file or not all(
                side in ("L", "R") and isinstance(name, str) for side, name in file.items()
            ):
                raise ValueError(f"expected {FILE_EXPECTED}")
            if len(set(file.values())) < len(file):
                raise ValueError("names one file for both sides; expected a file for each breast")
        elif file is not None and not isinstance(file, str):
            raise ValueError(f"expected {FILE_EXPECTED}")
        return file

    @field_validator("axes")
    @classmethod
    def _three_directions(cls, axes: str | None) -> str | None:
        if axes is not None and not are_axes(axes):
            raise ValueError(f"expected {AXES_EXPECTED}")
        return axes

    @field_validator("open_end", mode="before")
    @classmethod
    def _a_way_out(cls, open_end: Any) -> Any:
        if open_end not in ("auto", "none") and not is_way_out(open_end):
            raise ValueError(f"expected {WAY_EXPECTED}")
        return open_end

    @field_validator("voxel_mm")
    @classmethod
    def _a_size(cls, voxel_mm: Any) -> Any:
        sizes = voxel_mm if isinstance(voxel_mm, tuple) else (voxel_mm,)
        low, high = VOXEL_RANGE_MM
        if voxel_mm is not None and not all(low <= size <= high for size in sizes):
            raise ValueError(f"expected lengths of {low:g} to {high:g} mm")
        return voxel_mm

    @model_validator(mode="after")
    def _whole(self) -> Self:
        problems = []
        if (self.file is None) == (self.generate is None):
            given = "neither" if self.file is None else "both"
            problems.append(f"exactly one of 'file' and 'generate' must be given, found {given}")
        if self.file is None and self.generate is not None:
            keys = (
                "labels", "axes", "voxel_mm", "reduce", "compressed_for", "open_end",
                "lesions_from_labels",
            )  # fmt: skip
            problems += [
                f"'{key}' belongs to 'file', not to 'generate'"
                for key in keys if getattr(self, key) != type(self).model_fields[key].default
            ]  # fmt: skip
        if self.compressed_for is not None and self.shaped_under != "none":
            problems.append(
                f"shaped_under: found {self.shaped_under} with compressed_for: "
                f"{self.compressed_for}; a breast between plates has their shape, so leave one out"
            )
        if isinstance(self.open_end, tuple):
            problems += self._problems_of_way()
        names = [le.name for le in self.lesions] + [mark.name for mark in self.landmarks]
        for name in sorted({name for name in names if names.count(name) > 1}):
            problems.append(f"the name '{name}' is used more than once")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _problems_of_way(self) -> list[str]:
        """What is wrong with a way out that is given."""
        if self.compressed_for is not None:
            return ["open_end: a breast between plates ends where its voxels do; leave it out"]
        if isinstance(self.file, dict):
            return ["open_end: one way does not hold for both sides; expected auto or none"]
        return []

    def of_side(self, side: Side, *, first: bool = True) -> PhantomSettings:
        """One breast's phantom, with the lesions and landmarks that are in it.

        Parameters
        ----------
        side : {"L", "R"}
        first : bool
            Whether it is the breast of all lesions and landmarks that do not name one.
        """
        own: dict[str, Any] = {}
        if isinstance(self.file, dict):
            own["file"] = self.file[side]
        for key in ("lesions", "landmarks"):
            entries = getattr(self, key)
            if first and all(entry.laterality is None for entry in entries):
                continue
            own[key] = tuple(
                entry.model_copy(update={"laterality": None}) for entry in entries
                if entry.laterality == side or (first and entry.laterality is None)
            )  # fmt: skip
        return self.model_copy(update=own) if own else self
