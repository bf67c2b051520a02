"""What a user may say about the compression."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from mammosim.compression.model import MODELS, compressing_models
from mammosim.config import MAX_FORCE_N, MAX_LENGTH_MM, Coordinate, Settings
from mammosim.tissues import (
    SKIN_SHEETS,
    STIFFNESS_SETS,
    TISSUES,
    Moduli,
    SkinSheet,
    nearest_tissue,
)

MAX_RATIO = 1e4
"""Of the moduli of two tissues; a core in fat converges with 1e-2 to 1e3 of its modulus, and beyond
this single precision does not resolve the softer of the two (assumed)."""

MAX_TILT_DEG = 10.0
"""Beyond this no paddle tilts."""

PaddleSize = Annotated[float, Field(ge=10, le=400)]


def _known_model(value: Any) -> Any:
    if not isinstance(value, str) or value not in MODELS:
        *others, last = map(repr, MODELS)
        raise ValueError(f"expected {', '.join(others)} or {last}")
    return value


def _with_names(schema: dict[str, Any]) -> None:
    schema["enum"] = list(MODELS)


class PlatesInVoxels(Settings):
    """Plates and chest wall as the source thesis counts them, in the phantom's voxels.

    Heights count from the lowest tissue layer, 0, upwards; depths from the foremost tissue layer,
    0, backwards to the chest wall. Both are places of voxels' centres, and hold for the view CC.
    """

    lower: float = Field(ge=-1e5, le=1e5)
    """Height of the breast support's face (the thesis' LowerPlate), voxels from the lowest tissue
    layer."""

    upper: float = Field(ge=-1e5, le=1e5)
    """Height of the paddle's face (UpperPlate), voxels from the lowest tissue layer."""

    edge: float | None = Field(default=None, gt=0, le=1e5)
    """Depth of the plates' edge (platePosition), voxels from the nipple; left out: as
    `plate_edge_mm`."""

    chest_wall: float | None = Field(default=None, gt=0, le=1e5)
    """Depth from which on tissue is held (chestPosition), voxels from the nipple; left out: the
    last tissue layer."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.upper <= self.lower:
            raise ValueError("upper must be greater than lower")
        if self.edge is not None and self.chest_wall is not None and self.chest_wall <= self.edge:
            raise ValueError("chest_wall must be greater than edge")
        return self


class SkinSettings(Settings):
    """Skin as a thin sheet around the breast (model `hyperelastic`)."""

    young_kpa: float | None = Field(default=None, gt=0, le=1e4)
    """Young's modulus, kPa; left out: `stiffness_kpa.skin`, else that of the stiffness set, else
    that of `krouskop`, 344 kPa (measured in vivo)."""

    thickness_mm: float | None = Field(default=None, ge=0.1, le=10)
    """Thickness, mm; left out: as the phantom's voxels show it, else 1.55 mm."""


class FibreSettings(Settings):
    """Tissue that is stiffer along fibres from the chest wall towards the skin."""

    ratio: float = Field(default=1.0, ge=1, le=20)
    """Young's modulus in tension along the fibres over that across them; 1 for none. Compressed in
    vivo, breasts stretch less from front to back than isotropic models say (Tanner 2011)."""


class TiltSettings(Settings):
    """A paddle that is tilted, or that tilts against a spring until the moments balance."""

    angle_deg: float | None = Field(default=None, ge=-MAX_TILT_DEG, le=MAX_TILT_DEG)
    """Fixed angle of the paddle, degrees; positive: its front is closer to the breast support."""

    spring_nm_per_deg: float | None = Field(default=None, ge=1e-3, le=1e3)
    """Stiffness of the spring about the hinge, N m for each degree, in place of a fixed angle."""

    max_deg: float = Field(default=5.0, gt=0, le=MAX_TILT_DEG)
    """Angle at which a spring-loaded paddle is stopped, degrees (assumed: such paddles give way by
    a few degrees)."""

    hinge_mm: float | None = Field(default=None, ge=-MAX_LENGTH_MM, le=MAX_LENGTH_MM)
    """Distance of the hinge from the paddle's edge at the chest wall, mm; a thickness is the gap
    there. Left out: half of the paddle's depth (assumed)."""

    @model_validator(mode="after")
    def _one_way_to_tilt(self) -> Self:
        if (self.angle_deg is None) == (self.spring_nm_per_deg is None):
            raise ValueError("give one of angle_deg and spring_nm_per_deg")
        return self


SMALL_PADDLE_MM = (180.0, 240.0)
"""Depth and width of a paddle whose size is not given: those of the smaller usual image format."""

SPOT_PADDLE_MM = 120.0
"""Longer side up to which a paddle is a spot paddle, mm. Assumed: those of clinical units have 60
to 100 mm, and the next larger paddles, for the smaller image format, some 240 mm."""


class PaddleSettings(Settings):
    """A paddle that covers only a part of the breast, or tilts (model `hyperelastic`)."""

    size_mm: tuple[PaddleSize, PaddleSize] = SMALL_PADDLE_MM
    """Depth (from the chest wall forward) and width of the paddle, mm; a spot paddle has some 60
    to 100 mm. Default: the smaller usual image format."""

    centre_mm: tuple[Coordinate, Coordinate] | None = None
    """Middle of the paddle: breast-frame x, and the place along the plates' edge counted from the
    breast frame's origin, mm. Left out: behind, the paddle ends at the plates' edge, and sideways
    it lies about the origin."""

    tilt: TiltSettings | None = None
    """How it is tilted; left out: not at all."""


class CompressionSettings(Settings):
    """How the breast is compressed."""

    model: Annotated[str, BeforeValidator(_known_model)] = Field(
        default="springs", json_schema_extra=_with_names
    )
    """Mechanical model: `springs`, the thesis' and the fastest; `hyperelastic`, finite elements
    that keep their volume; `none` leaves the breast as it is (or as it was compressed before)."""

    solver: Literal["multigrid", "relaxation"] = "multigrid"
    """Solver of the spring model: `relaxation` is the thesis' own, `multigrid` reaches the same
    equilibrium far sooner."""

    thickness_mm: float | None = Field(default=None, ge=1, le=MAX_LENGTH_MM)
    """Gap between the plates' faces, mm; left out: from the breast's volume by the population fit
    of Hogg et al. (M-PACT), at most 80 % of the breast's height between the plates."""

    force_n: float | None = Field(default=None, ge=0.1, le=MAX_FORCE_N)
    """Force on the paddle, N, in place of a thickness."""

    support_z_mm: Coordinate | None = None
    """Final height of the breast support's face, compression frame, mm; with `paddle_z_mm`. Left
    out: both plates stand where they press alike."""

    paddle_z_mm: Coordinate | None = None
    """Final height of the paddle's face, compression frame, mm; with `support_z_mm`."""

    plates_voxel: PlatesInVoxels | None = None
    """Plates and chest wall in the phantom's voxels, as the source thesis gives them, in place of
    the keys in mm; view CC only."""

    resolution_mm: float = Field(default=1.0, ge=0.1, le=10)
    """Node spacing of the mechanical lattice, mm; 1 mm resolves skin and glandular lobes. Left out:
    1 mm with `springs`, 3 mm with `hyperelastic`, whose elements hold a gradient of strain each."""

    mlo_angle_deg: float = Field(default=45.0, ge=30, le=60)
    """Angle of the plates' normal from superior towards medial in MLO, degrees."""

    chest_wall: Literal["fixed", "sliding", "fascia"] | None = None
    """How the chest-wall plane is held: `fixed` wholly; or, with the model `hyperelastic`,
    `fascia`, in its own plane by a thin elastic layer, or `sliding`, not at all in its own plane.
    Left out: `fascia` with `hyperelastic`, else `fixed`."""

    fascia_kpa_per_mm: float = Field(default=0.7, ge=0.01, le=1e3)
    """Stiffness of the retromammary fascia in shear: kPa of stress for each mm by which the breast
    glides over the chest wall. Loose tissue has a shear modulus of 0.9 kPa (Iatridis et al. 2003,
    rats); that the layer is 1.3 mm thick is assumed."""

    chest_wall_mm: Coordinate | None = None
    """Breast-frame x up to which tissue is held as the chest wall, mm; left out: the first tissue
    layer."""

    muscle: Literal["fixed", "soft"] | None = None
    """Whether labelled muscle is held or deforms with the breast; left out: `soft` where it
    reaches more than 12 mm in front of the chest wall, so that it lies between the plates, else
    `fixed`, as FDA's VICTRE has it."""

    plate_edge_mm: Coordinate | None = None
    """Breast-frame x of the plates' edge, mm; left out: 5 mm in front of the chest wall and, where
    muscle is `fixed`, of the muscle."""

    paddle: PaddleSettings | None = None
    """A paddle that covers only a part of the breast, or tilts; left out: it is level and covers
    all in front of the plates' edge."""

    stiffness: str = "thesis"
    """Stiffness set of the tissue table. Left out: `thesis` with `springs`, which were published
    with it, and `aspiration`, measured in women, with `hyperelastic`."""

    stiffness_kpa: dict[str, Annotated[float, Field(ge=1e-3, le=1e4)]] = Field(default_factory=dict)
    """Young's modulus of single tissues in place of the set's, as {skin: 60, mass: 100}; tissues
    that the set does not name follow the one they are like."""

    skin: SkinSettings | None = None
    """Skin as a thin sheet that carries tension only, in place of what the stiffness set has. Left
    out: as the set has it; `krouskop` (344 kPa) and `aspiration` (56 kPa) have such a sheet."""

    fibres: FibreSettings = FibreSettings()
    """Fibres of the tissue (model `hyperelastic`)."""

    spring_law: Literal["linear", "exponential"] = "linear"
    """Whether springs keep their stiffness or gain with strain as in the thesis' listing, E = Ec
    exp(Enl e); clinical forces need the latter."""

    gravity: bool = False
    """Let the breast's weight act, the patient standing; tissue moves from its shape in the
    phantom, which is taken as free of weight."""

    tolerance_mm: float = Field(default=0.02, ge=1e-5, le=1)
    """Distance from equilibrium at which `hyperelastic` stops: the mean over all nodes, as the
    solver estimates it, mm."""

    force_tolerance: float | None = Field(default=None, ge=1e-9, le=0.5)
    """Deprecated and of no effect: `tolerance_mm` has taken its place."""

    tolerance_voxel: float = Field(default=1e-3, ge=1e-9, le=0.1)
    """Largest estimated distance of a node from equilibrium at which `multigrid` stops, lattice
    units."""

    relaxation_limit_voxel: float = Field(default=1e-4, ge=1e-9, le=0.1)
    """Mean displacement of a node in a sweep at which `relaxation` stops, lattice units; 1/10 000
    in the thesis."""

    max_sweeps: int = Field(default=20_000, ge=1, le=10_000_000)
    """Sweeps after which `relaxation` gives up."""

    @field_validator("stiffness")
    @classmethod
    def _known_set(cls, value: str) -> str:
        if value not in STIFFNESS_SETS:
            raise ValueError(f"expected one of {', '.join(STIFFNESS_SETS)}")
        return value

    @field_validator("stiffness_kpa")
    @classmethod
    def _known_tissues(cls, value: dict[str, float]) -> dict[str, float]:
        unknown = sorted(set(value) - (set(TISSUES) - {"air"}))
        if unknown:
            names = ", ".join(sorted(set(TISSUES) - {"air"}))
            near = nearest_tissue(unknown[0])
            hint = f"did you mean '{near}'? " if near else ""
            raise ValueError(f"unknown tissue {', '.join(unknown)}; {hint}expected one of {names}")
        return value

    @property
    def moduli(self) -> Moduli:
        """Young's modulus of each tissue."""
        return Moduli(self.stiffness, self.stiffness_kpa)

    @property
    def wall(self) -> str:
        """How the chest wall is held: `chest_wall`, or what the model has where it is left out."""
        return self.chest_wall or MODELS[self.model].chest_walls[0]

    @property
    def skin_sheet(self) -> SkinSheet | None:
        """Skin as a thin sheet; None where it is a solid tissue."""
        young = SKIN_SHEETS.get(self.stiffness)
        if self.skin is None and young is None:
            return None
        young = self.stiffness_kpa.get("skin", young or SKIN_SHEETS["krouskop"])
        skin = self.skin or SkinSettings()
        return SkinSheet(young if skin.young_kpa is None else skin.young_kpa, skin.thickness_mm)

    @property
    def spot(self) -> bool:
        """Whether the paddle is a spot paddle."""
        return self.paddle is not None and max(self.paddle.size_mm) <= SPOT_PADDLE_MM

    @model_validator(mode="after")
    def _usual_of_the_model(self) -> Self:
        for key, value in MODELS[self.model].usual.items():
            if key not in self.model_fields_set:
                self.__dict__[key] = value
        return self

    @model_validator(mode="after")
    def _wall_that_the_model_knows(self) -> Self:
        if self.chest_wall is not None and self.chest_wall not in MODELS[self.model].chest_walls:
            able = " or ".join(compressing_models(self.chest_wall))
            raise ValueError(f"chest_wall: {self.chest_wall} needs model: {able}")
        return self

    @model_validator(mode="after")
    def _moduli_that_can_be_joined(self) -> Self:
        if self.stiffness_kpa and self.model == "hyperelastic":
            young = {name: self.moduli(name) for name in (*self.stiffness_kpa, "adipose", "gland")}
            low, high = min(young, key=young.__getitem__), max(young, key=young.__getitem__)
            if young[high] > MAX_RATIO * young[low]:
                raise ValueError(
                    f"stiffness_kpa: {high} ({young[high]:g} kPa) is more than {MAX_RATIO:g} times "
                    f"as stiff as {low} ({young[low]:g} kPa); the model hyperelastic does not "
                    "converge for such a ratio"
                )
        return self

    @model_validator(mode="after")
    def _one_way_to_say_what_skin_is(self) -> Self:
        if self.skin is not None and self.skin.young_kpa and "skin" in self.stiffness_kpa:
            raise ValueError("give one of skin.young_kpa and stiffness_kpa.skin")
        return self

    @model_validator(mode="after")
    def _one_way_to_say_how_far(self) -> Self:
        heights = (self.support_z_mm is not None, self.paddle_z_mm is not None)
        if heights[0] != heights[1]:
            raise ValueError("support_z_mm and paddle_z_mm are given together or not at all")
        ways = [self.thickness_mm is not None, self.force_n is not None, all(heights)]
        ways.append(self.plates_voxel is not None)
        if sum(ways) > 1:
            raise ValueError(
                "give one of thickness_mm, force_n, support_z_mm with paddle_z_mm, or plates_voxel"
            )
        if all(heights) and self.paddle_z_mm <= self.support_z_mm:  # type: ignore[operator]
            raise ValueError("paddle_z_mm must be greater than support_z_mm")
        return self

    @model_validator(mode="after")
    def _depths_in_one_unit(self) -> Self:
        for key, depth in (("plate_edge_mm", "edge"), ("chest_wall_mm", "chest_wall")):
            given = self.plates_voxel is not None and getattr(self.plates_voxel, depth) is not None
            if given and getattr(self, key) is not None:
                raise ValueError(f"give one of {key} and plates_voxel.{depth}")
        return self

    @model_validator(mode="after")
    def _keys_that_the_model_knows(self) -> Self:
        usual = type(self).model_fields
        for name, model in MODELS.items():
            foreign = set(model.own_keys) - set(MODELS[self.model].own_keys)
            given = [
                key
                for key in model.own_keys
                if key in foreign and getattr(self, key) != usual[key].default
            ]
            if given:
                raise ValueError(f"{', '.join(given)}: only the model {name} knows that")
        return self
