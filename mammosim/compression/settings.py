"""What a user may say about the compression."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from mammosim.compression.model import MODELS, compressing_models
from mammosim.config import MAX_FORCE_N, MAX_LENGTH_MM, Coordinate, Settings
from mammosim.tissues import (
    SKIN_SHEETS,
    SKIN_STIFFENING,
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
    """Height of the breast support's face (the thesis' LowerPlate), voxels above the lowest tissue
    layer."""

    upper: float = Field(ge=-1e5, le=1e5)
    """Height of the paddle's face (UpperPlate), voxels above the lowest tissue layer."""

    edge: float | None = Field(default=None, gt=0, le=1e5)
    """Depth of the plates' edge (platePosition), voxels from the nipple; default: as
    `plate_edge_mm`."""

    chest_wall: float | None = Field(default=None, gt=0, le=1e5)
    """Depth beyond which tissue is held (chestPosition), voxels from the nipple; default: the last
    tissue layer."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.upper <= self.lower:
            raise ValueError("upper must be greater than lower")
        if self.edge is not None and self.chest_wall is not None and self.chest_wall <= self.edge:
            raise ValueError("chest_wall must be greater than edge")
        return self


class SkinSettings(Settings):
    """Skin as a thin membrane around the breast (model `hyperelastic`)."""

    young_kpa: float | None = Field(default=None, gt=0, le=1e4)
    """Young's modulus, kPa; default: `stiffness_kpa.skin`, or else that of the stiffness set, or
    else that of `krouskop`, 344 kPa (measured in vivo)."""

    thickness_mm: float | None = Field(default=None, ge=0.1, le=10)
    """Thickness, mm; default: that of the phantom's skin voxels, or else 1.55 mm."""

    stiffening: float | None = Field(default=None, ge=0, le=100)
    """How skin stiffens with stretch: stretched one way by a factor l, it is 1 + stiffening (l^2 +
    2 / l - 3) times as stiff as a neo-Hookean sheet. Default: 6 with the stiffness set
    `aspiration`, whose modulus is one at small strain; else 0."""


class FibreSettings(Settings):
    """Tissue that is stiffer along fibres from the chest wall to the skin."""

    ratio: float = Field(default=1.0, ge=1, le=20)
    """Young's modulus in tension along the fibres divided by that across them; 1 for isotropic
    tissue. Under compression in vivo, breasts extend less from front to back than isotropic models
    predict (Tanner 2011)."""


class TiltSettings(Settings):
    """A paddle that is tilted, or that tilts against a spring until the moments balance."""

    angle_deg: float | None = Field(default=None, ge=-MAX_TILT_DEG, le=MAX_TILT_DEG)
    """Fixed angle of the paddle, degrees; positive: its front is closer to the breast support."""

    spring_nm_per_deg: float | None = Field(default=None, ge=1e-3, le=1e3)
    """Stiffness of the spring about the hinge, N m per degree, instead of a fixed angle."""

    max_deg: float = Field(default=5.0, gt=0, le=MAX_TILT_DEG)
    """Largest angle of a spring-loaded paddle, degrees (assumed: such paddles tilt by a few
    degrees)."""

    hinge_mm: float | None = Field(default=None, ge=-MAX_LENGTH_MM, le=MAX_LENGTH_MM)
    """Distance of the hinge from the paddle's edge at the chest wall, mm; a thickness is the gap at
    the hinge. Default: half of the paddle's depth (assumed)."""

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
    """A paddle that covers only part of the breast, or tilts (model `hyperelastic`)."""

    size_mm: tuple[PaddleSize, PaddleSize] = SMALL_PADDLE_MM
    """Depth (from the chest wall forward) and width of the paddle, mm; spot paddles are some 60 to
    100 mm. Default: the smaller usual image format."""

    centre_mm: tuple[Coordinate, Coordinate] | None = None
    """Centre of the paddle: breast-frame x, and the position along the plates' edge relative to the
    breast frame's origin, mm. Default: the paddle begins at the plates' edge and is centred on the
    origin."""

    tilt: TiltSettings | None = None
    """How the paddle is tilted; default: not at all."""


class CompressionSettings(Settings):
    """How the breast is compressed."""

    model: Annotated[str, BeforeValidator(_known_model)] = Field(
        default="hyperelastic", json_schema_extra=_with_names
    )
    """Mechanical model: `hyperelastic`, near-incompressible finite elements; `springs`, that of the
    source thesis and the fastest; `none`, the breast as it is (or as it was already compressed)."""

    solver: Literal["multigrid", "relaxation"] = "multigrid"
    """Solver of the spring model: `relaxation` is the thesis' own; `multigrid` reaches the same
    equilibrium much faster."""

    thickness_mm: float | None = Field(default=None, ge=1, le=MAX_LENGTH_MM)
    """Gap between the plates' faces, mm; default: estimated from the breast's volume by the
    population fit of Hogg et al. (M-PACT), at most 80 % of the breast's height between the
    plates."""

    force_n: float | None = Field(default=None, ge=0.1, le=MAX_FORCE_N)
    """Force on the paddle, N, instead of a thickness."""

    support_z_mm: Coordinate | None = None
    """Final height of the breast support's face, compression frame, mm; with `paddle_z_mm`.
    Default: both plates are placed where they press equally."""

    paddle_z_mm: Coordinate | None = None
    """Final height of the paddle's face, compression frame, mm; with `support_z_mm`."""

    plates_voxel: PlatesInVoxels | None = None
    """Plates and chest wall in the phantom's voxels, as the source thesis gives them, instead of
    the keys in mm; view CC only."""

    resolution_mm: float = Field(default=1.0, ge=0.1, le=10)
    """Node spacing of the mechanical lattice, mm; 1 mm resolves skin and glandular lobes. Default:
    1 mm with `springs`; 3 mm with `hyperelastic`, whose elements each represent a strain
    gradient."""

    mlo_angle_deg: float = Field(default=45.0, ge=30, le=60)
    """Angle in MLO of the plates' normal from superior towards medial, degrees."""

    chest_wall: Literal["fixed", "sliding", "fascia"] | None = None
    """Chest-wall condition: `fixed`; or, with the model `hyperelastic`, `fascia`, tied by a thin
    elastic layer that lets the breast glide along the wall, or `sliding`, free to glide. Default:
    `fascia` with `hyperelastic`, otherwise `fixed`."""

    fascia_kpa_per_mm: float = Field(default=0.7, ge=0.01, le=1e3)
    """Shear stiffness of the retromammary fascia: kPa of stress per mm that the breast glides over
    the chest wall. Loose connective tissue has a shear modulus of 0.9 kPa (Iatridis et al. 2003,
    rats); the thickness of the layer, 1.3 mm, is assumed."""

    chest_wall_mm: Coordinate | None = None
    """Breast-frame x up to which tissue is held as the chest wall, mm; default: the first tissue
    layer."""

    muscle: Literal["fixed", "soft"] | None = None
    """Whether labelled muscle is fixed or deforms with the breast; default: `soft` if it extends
    more than 12 mm in front of the chest wall, so that it lies between the plates, otherwise
    `fixed`, as in FDA's VICTRE."""

    plate_edge_mm: Coordinate | None = None
    """Breast-frame x of the plates' edge, mm; default: 5 mm in front of the chest wall and, if
    muscle is `fixed`, of the muscle."""

    friction: float = Field(default=0.0, ge=0, le=2)
    """Coefficient of friction between skin and plates (model `hyperelastic`). Default: 0, skin
    glides freely. Dry skin has more than 0.2, typically 0.5, against various materials (Derler &
    Gerhardt 2012); no value for skin on a paddle was found."""

    paddle: PaddleSettings | None = None
    """A paddle that covers only part of the breast, or tilts; default: level, and covering
    everything in front of the plates' edge."""

    stiffness: str = "thesis"
    """Stiffness set of the tissue table. Default: `thesis` with `springs`, which were published
    with it; `aspiration`, measured in women, with `hyperelastic`."""

    stiffness_kpa: dict[str, Annotated[float, Field(ge=1e-3, le=1e4)]] = Field(default_factory=dict)
    """Young's moduli of single tissues that replace the set's, for example {skin: 60, mass: 100},
    kPa; a tissue that the set does not contain has the modulus of the one it is like."""

    skin: SkinSettings | None = None
    """Skin as a thin membrane that carries tension only, instead of what the stiffness set has.
    Default: that of the set; `krouskop` (344 kPa) and `aspiration` (56 kPa) have such a
    membrane."""

    fibres: FibreSettings = FibreSettings()
    """Fibres in the tissue (model `hyperelastic`)."""

    spring_law: Literal["linear", "exponential"] = "linear"
    """Whether springs keep their stiffness or stiffen with strain as in the thesis' listing, E = Ec
    exp(Enl e), which at the usual thickness gives forces far beyond clinical ones."""

    gravity: bool = False
    """Let the breast's weight act, with the patient standing; the shape in the phantom is taken as
    free of weight."""

    tolerance_mm: float = Field(default=0.02, ge=1e-5, le=1)
    """Distance from equilibrium at which `hyperelastic` stops: the solver's estimate of the mean
    over all nodes, mm."""

    force_tolerance: float | None = Field(default=None, ge=1e-9, le=0.5)
    """Deprecated, without effect; replaced by `tolerance_mm`."""

    tolerance_voxel: float = Field(default=1e-3, ge=1e-9, le=0.1)
    """Largest estimated distance of any node from equilibrium at which `multigrid` stops, lattice
    units."""

    relaxation_limit_voxel: float = Field(default=1e-4, ge=1e-9, le=0.1)
    """Mean displacement of a node per sweep at which `relaxation` stops, lattice units; 1/10 000 in
    the thesis."""

    max_sweeps: int = Field(default=20_000, ge=1, le=10_000_000)
    """Maximum number of sweeps of `relaxation`."""

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
        if skin.young_kpa is not None:
            young = skin.young_kpa
        stiffening = skin.stiffening
        if stiffening is None:
            stiffening = SKIN_STIFFENING.get(self.stiffness, 0.0)
        return SkinSheet(young, skin.thickness_mm, stiffening)

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
            raise ValueError("support_z_mm and paddle_z_mm must be given together or not at all")
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
        for key, field in type(self).model_fields.items():
            able = [name for name, model in MODELS.items() if key in model.own_keys]
            if able and self.model not in able and getattr(self, key) != field.default:
                models = f"model{'s' if len(able) > 1 else ''} {' and '.join(able)}"
                raise ValueError(f"{key}: valid for the {models} only")
        return self
