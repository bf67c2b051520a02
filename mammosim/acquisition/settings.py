"""Settings of the section `acquisition`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Annotated, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from mammosim.acquisition.attenuation import SUPPORT_MATERIALS
from mammosim.acquisition.detectors import DETECTORS
from mammosim.acquisition.looks import DRAWN, LOOKS
from mammosim.acquisition.scatter import DEFAULT_SCATTER, SCATTER_MODELS
from mammosim.acquisition.spectrum import FILTER_MM
from mammosim.acquisition.tube import KVP_RANGE, TARGETS
from mammosim.config import Settings
from mammosim.tissues import CALCIFICATIONS, COMPOSITION_SETS

MAS_RANGE = (1e-3, 1e4)
"""Tube loads that can be computed, mAs; a thousand times less and ten times more than units give,
for phantoms and for noise without dose."""


def _one_of(names: Collection[str]) -> Callable[[str], str]:
    """Check against a table as it is when a value is checked, with what was added to it."""

    def check(value: str) -> str:
        if value not in names:
            raise ValueError(f"expected one of {', '.join(names)}")
        return value

    return check


def _set_or_file(value: str) -> str:
    if value not in COMPOSITION_SETS and not value.endswith((".yaml", ".yml")):
        raise ValueError(
            f"expected one of {', '.join(COMPOSITION_SETS)} or the path of a .yaml file"
        )
    return value


def _some_dose(value: float | None) -> float | None:
    low, high = MAS_RANGE
    if value is not None and not value > 0.0:
        raise ValueError("expected more than 0 mAs (zero dose)")
    if value is not None and not low <= value <= high:
        raise ValueError(f"expected {low:g} to {high:g} mAs")
    return value


def _voltage(value: float | None) -> float | None:
    low, high = KVP_RANGE
    if value is not None and not low <= value <= high:
        raise ValueError(f"expected {low:g} to {high:g} kV, the range of the spectrum model")
    return value


def _numbers(low: float, high: float) -> WithJsonSchema:
    number = {"type": "number", "minimum": low, "maximum": high}
    return WithJsonSchema({"anyOf": [number, {"type": "null"}]})


def _names(names: Iterable[str]) -> WithJsonSchema:
    return WithJsonSchema({"type": "string", "enum": list(names)})


Target = Annotated[str, AfterValidator(_one_of(TARGETS)), _names(TARGETS)]
Filter = Annotated[str, AfterValidator(_one_of(FILTER_MM)), _names(FILTER_MM)]
DetectorName = Annotated[str, AfterValidator(_one_of(DETECTORS)), _names(DETECTORS)]
ScatterModel = Annotated[str, AfterValidator(_one_of(SCATTER_MODELS)), _names(SCATTER_MODELS)]
SupportMaterial = Annotated[
    str, AfterValidator(_one_of(SUPPORT_MATERIALS)), _names(SUPPORT_MATERIALS)
]
Calcification = Annotated[str, AfterValidator(_one_of(CALCIFICATIONS)), _names(CALCIFICATIONS)]
LookName = Annotated[str, AfterValidator(_one_of((DRAWN, *LOOKS))), _names((DRAWN, *LOOKS))]
Voltage = Annotated[float | None, AfterValidator(_voltage), _numbers(*KVP_RANGE)]
TubeLoad = Annotated[float | None, AfterValidator(_some_dose), _numbers(*MAS_RANGE)]
Composition = Annotated[str, AfterValidator(_set_or_file)]


class ScatterSettings(Settings):
    """How scattered radiation is computed."""

    model: ScatterModel = DEFAULT_SCATTER
    """Scatter model: monte-carlo (photons followed through the compressed breast), kernels (layers
    built from path lengths) or none."""

    photons: int | None = Field(default=None, ge=10_000, le=1_000_000_000)
    """Number of photons that monte-carlo follows, 10 thousand to 1 billion; default: 160 thousand,
    for about 2 per cent noise in the breast."""


def _scatter_kind(value: object) -> str | None:
    if isinstance(value, dict | ScatterSettings):
        return "ScatterSettings"
    return "bool" if isinstance(value, bool) else None


Scatter = Annotated[
    Annotated[bool, Tag("bool")] | Annotated[ScatterSettings, Tag("ScatterSettings")],
    Discriminator(
        _scatter_kind,
        custom_error_type="scatter",
        custom_error_message="true, false, or a section as {model: monte-carlo}",
    ),
]


class ContrastSettings(Settings):
    """A contrast agent in the breast, and the high-energy exposure that follows the mammogram."""

    lesion_mg_ml: float = Field(default=1.0, ge=0.0, le=50.0)
    """Iodine in masses, mg/mL; 1 is in the middle of the 0.5 to 2 of test phantoms."""

    parenchyma_mg_ml: float = Field(default=0.1, ge=0.0, le=50.0)
    """Iodine in gland, ducts and lobules, mg/mL; 0.1 is minimal background enhancement
    (assumed)."""

    blood_mg_ml: float = Field(default=1.3, ge=0.0, le=50.0)
    """Iodine in vessels, mg/mL; 1.3 if 1.5 mL/kg of 300 mg/mL have spread over 0.2 L/kg of
    extracellular volume, and plasma is 0.58 of blood (assumed)."""

    filter: Filter = "Cu"
    """Filter of the high-energy exposure: Cu or Ti, or any other."""

    filter_mm: float | None = Field(default=None, ge=1e-4, le=5.0)
    """Filter thickness, mm; default: the usual one, Cu 0.300, Ti 1.000."""

    kvp: float = Field(default=49.0, ge=34.0, le=KVP_RANGE[1])
    """Tube voltage of the high-energy exposure, kV; systems use 45 to 49, and below 34 no photon
    exceeds the K edge of iodine (33.2 keV)."""

    mas: TubeLoad = None
    """Tube load of the high-energy exposure, mAs; default: for 0.43 of the low-energy exposure's
    glandular dose, the middle of what was measured in patients."""


class AcquisitionSettings(Settings):
    """How the compressed breast is exposed and what the detector records."""

    target: Target = "W"
    """Anode material: W, Mo or Rh; most systems sold today have tungsten."""

    filter: Filter = "Rh"
    """Filter material: Mo, Rh, Ag or Al; Cu or Ti for high energies."""

    filter_mm: float | None = Field(default=None, ge=1e-4, le=5.0)
    """Filter thickness, mm; default: Mo 0.030, Rh 0.025 (on tungsten 0.050), Ag 0.050, Al 0.700, Cu
    0.300, Ti 1.000."""

    kvp: Voltage = None
    """Tube voltage, kV, 20 to 49; default: chosen by the compressed thickness."""

    mas: TubeLoad = None
    """Tube load, mAs; default: automatic exposure control, up to 600 mAs."""

    spectrum_file: str | None = None
    """Path of a spectrum in two columns, keV and photons per bin, per mm2 and mAs, at 1 m behind
    the filter, used instead of the tube model."""

    heel: bool = False
    """Whether the beam weakens towards the nipple, which is on the anode side (heel effect); off,
    since clinical systems correct for it."""

    focal_spot_mm: float = Field(default=0.3, ge=0.0, le=2.0)
    """Side of the square focal spot, mm; 0.3 is the nominal large focal spot of mammography
    tubes."""

    paddle_mm: float = Field(default=3.0, ge=0.0, le=20.0)
    """Thickness of the polycarbonate paddle, mm."""

    support_mm: float = Field(default=1.0, ge=0.0, le=10.0)
    """Thickness of the breast support and detector cover, mm."""

    support_material: SupportMaterial = "carbon fibre"
    """Material of the breast support and detector cover: carbon fibre, polystyrene or
    polycarbonate."""

    composition: Composition = "hammerstein"
    """Composition of the tissues: hammerstein, icru44, woodard, or the path of a YAML file."""

    calcification: Calcification = "hydroxyapatite"
    """Material of calcifications: hydroxyapatite, oxalate or carbonate."""

    scatter: Scatter = True
    """Scattered radiation: true for the default model, false for none, or a section with the
    model's name."""

    contrast: ContrastSettings | None = None
    """A contrast agent: a high-energy exposure follows the mammogram, and both are recombined into
    an iodine image. Default: none."""

    grid: bool = True
    """Whether an anti-scatter grid is in front of the detector."""

    grid_primary_transmission: float | None = Field(default=0.75, ge=0.01, le=1.0)
    """Fraction of the primary that the grid transmits; 0.75 is usual for 5:1 at 31 lines per cm;
    null: that of the grid's strips, from their thickness."""

    grid_scatter_transmission: float | None = Field(default=0.10, ge=0.0, le=1.0)
    """Fraction of the scatter that the grid transmits; published values are 0.07 to 0.14; null: by
    the direction of each photon (monte-carlo only)."""

    detector: DetectorName = "a-Se-70"
    """Detector: a-Se-70, a-Se-85, CsI-100 or ideal; each works with any pixel size."""

    look: LookName = DRAWN
    """Processing of the For Presentation image: crisp enhances local contrast and leaves the grain
    visible, soft does little of either, and drawn takes the processing of a unit that is drawn from
    the seed, about as strong as crisp or stronger. The For Processing image does not change."""

    unit_seed: int | None = Field(default=None, ge=0, le=2**63 - 1)
    """Seed from which the unit of `look: drawn` is drawn, so that several runs can share one;
    default: the run's seed."""

    noise: bool = True
    """Whether quantum, electronic and fixed-pattern noise are added."""

    noise_seed: int | None = Field(default=None, ge=0, le=2**63 - 1)
    """Seed of the noise alone, for another exposure of the same breast; default: derived from the
    run's seed."""

    realisations: int | None = Field(default=None, ge=1, le=999)
    """Number of noise realisations of one exposure, each written as `..._001` and so on; default:
    one."""

    @property
    def scatter_model(self) -> str:
        """Name of the scatter model, of `SCATTER_MODELS`."""
        if isinstance(self.scatter, bool):
            return DEFAULT_SCATTER if self.scatter else "none"
        return self.scatter.model

    def of_unit(self, seed: int) -> Self:
        """These settings with a seed for the unit, unless they name one."""
        return self if self.unit_seed is not None else self.model_copy(update={"unit_seed": seed})

    @model_validator(mode="after")
    def _heel_of_a_known_tube(self) -> Self:
        if self.heel and self.spectrum_file is not None:
            raise ValueError("heel: found true with a spectrum_file, expected the tube model")
        return self
