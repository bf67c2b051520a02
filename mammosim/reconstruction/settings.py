"""Settings of the reconstruction of a tomosynthesis series."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from mammosim.config import Settings
from mammosim.projection import TomosynthesisSettings


class ReconstructionSettings(Settings):
    """How slices are reconstructed from the projections of a series."""

    method: Literal["fdk", "sart"] = "fdk"
    """`fdk`, filtered back-projection (Feldkamp, Davis and Kress), or `sart`, the simultaneous
    algebraic reconstruction technique."""

    slice_mm: Annotated[float, Field(ge=0.1, le=20.0)] = 1.0
    """Slice spacing, mm; clinical systems use 1 mm."""

    pixel_mm: Annotated[float, Field(ge=0.02, le=2.0)] | None = None
    """Pixel size within a slice, mm; default: the detector's pixel size."""

    iterations: Annotated[int, Field(ge=1, le=50)] = 1
    """Number of passes of `sart` over all projections."""

    relaxation: Annotated[float, Field(gt=0.0, lt=2.0)] = 0.5
    """Relaxation factor of `sart`; it converges between 0 and 2. Assumed."""

    hann: Annotated[float, Field(ge=0.0, le=1.0)] = 1.0
    """Cut-off of `fdk`'s Hann window as a fraction of the Nyquist frequency; 0 is the ramp filter
    alone."""

    synthetic_2d: bool = False
    """Whether a synthetic mammogram is made from the slices (of `sart`), by mammosim's own method,
    not a manufacturer's."""

    @model_validator(mode="after")
    def _synthetic_of_known_values(self) -> Self:
        if self.synthetic_2d and self.method != "sart":
            raise ValueError(
                f"synthetic_2d: found true with method: {self.method}, whose values are relative "
                "to the neighbourhood; expected method: sart"
            )
        return self


class SeriesSettings(TomosynthesisSettings):
    """A view taken as a series of projections, and the slices that are reconstructed from it."""

    reconstruct: ReconstructionSettings | None = None
    """Reconstruct slices with itk-rtk; default: no slices, since that library is an extra."""

    @model_validator(mode="after")
    def _several_angles(self) -> Self:
        if self.reconstruct is not None and (self.projections < 2 or self.angle_range_deg == 0.0):
            raise ValueError(
                f"reconstruct: found {self.projections} projections over "
                f"{self.angle_range_deg:g} degrees, expected at least 2 over more than 0 degrees"
            )
        return self
