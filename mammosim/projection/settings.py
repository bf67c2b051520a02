"""Settings of the projection: detector, focal spot, conservation of mass."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from mammosim.config import MAX_LENGTH_MM, Coordinate, Settings
from mammosim.geometry import magnification
from mammosim.projection.systems import SYSTEMS


def _system(value: str) -> str:
    if value not in SYSTEMS:
        raise ValueError(f"expected one of {', '.join(SYSTEMS)}")
    return value


_NAMES_OF_SYSTEMS = WithJsonSchema({"type": "string", "enum": list(SYSTEMS)})
DetectorSide = Annotated[float, Field(ge=1.0, le=MAX_LENGTH_MM)]


class ProjectionSettings(Settings):
    """How the compressed breast is projected onto the detector."""

    # 0.1 mm is the pitch of caesium iodide flat panels; amorphous selenium has 0.07 to 0.085 mm.
    pixel_mm: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.1
    """Pixel pitch of the detector, mm."""

    # 650 mm as in VICTRE (Badano et al. 2018, JAMA Netw Open 1(7):e185474); clinical units have
    # 650 to 700 mm.
    source_to_detector_mm: Annotated[float, Field(ge=1.0, le=2000.0)] = 650.0
    """Distance from the focal spot to the detector plane, mm."""

    # 10 to 20 mm on clinical units; 15 mm is the air gap of the scatter measurements of Boone
    # et al. 2000 (Med Phys 27:2408-2416), which the scatter model builds on.
    support_to_detector_mm: Annotated[float, Field(ge=0.0, le=MAX_LENGTH_MM)] = 15.0
    """Gap between the breast support's upper surface and the detector plane, mm."""

    detector_edge_mm: Coordinate | None = None
    """Breast-frame x of the detector's chest-wall edge, mm; default: the plates' edge."""

    detector_mm: tuple[DetectorSide, DetectorSide] | None = None
    """Height (along the chest wall) and width of the detector, mm; default: the smaller of the two
    usual formats, 240 x 180 and 300 x 240 mm, that contains the breast's shadow."""

    focal_spot_y_mm: Coordinate | None = None
    """Compression-frame y of the focal spot, mm; default: 0 if the breast extends over it,
    otherwise the centre of the breast."""

    conserve_mass: bool = True
    """Whether tissue attenuates in proportion to its density after compression, so that mass is
    conserved."""

    # The weave that voxels of 0.4 mm draw is stronger than the quantum noise near the skin line.
    smooth_voxels: bool = True
    """Whether the steps of voxels larger than a pixel are smoothed in the attenuation (not if
    conserve_mass is false); path lengths and lesion masks stay exact."""

    @property
    def magnification(self) -> float:
        """How many times larger an object on the breast support appears on the detector."""
        return magnification(self.source_to_detector_mm, self.support_to_detector_mm)


class TomosynthesisSettings(Settings):
    """A view taken as a series of projections: how the tube moves while the breast is held.

    The tube turns about an axis parallel to x; the detector stays where it is, or turns with it by
    a smaller angle. Pivot, range and number are by default those of FDA's VICTRE trial (Badano et
    al. 2018, JAMA Netw Open 1(7):e185474; `rotation_axis_distance` 60 cm of 65 cm in
    DIDSR/VICTRE_PIPELINE), which replicates a Siemens Mammomat Inspiration.
    """

    view: Literal["CC", "MLO", "ML"]
    """Compression view in which the projections are taken."""

    system: Annotated[str, AfterValidator(_system), _NAMES_OF_SYSTEMS] | None = None
    """Arc, number of projections, pivot and detector rotation like those of a clinical system:
    like-dimensions (15 degrees, 15 projections, the detector rotates by 4.2 degrees),
    like-senoclaire (25, 9) or like-inspiration (50, 25); keys given beside it take precedence."""

    angle_range_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 50.0
    """Angle between the first and the last position of the tube, degrees, half on each side."""

    projections: Annotated[int, Field(ge=1, le=200)] = 25
    """Number of projections, evenly spaced over the angle range; 1 is the upright tube only."""

    pivot_to_detector_mm: Annotated[float, Field(ge=0.0, le=300.0)] = 50.0
    """Height of the pivot above the detector plane, mm."""

    # 4.2 of 15 degrees on Hologic's systems; Siemens' and GE's detectors stay (see systems.py).
    detector_angle_range_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 0.0
    """Angle by which the detector rotates about the same pivot, in the same direction, while the
    tube moves over its range, degrees; 0 for a stationary detector."""

    shares: tuple[Annotated[float, Field(gt=0.0, le=1e6)], ...] | None = None
    """Relative tube load of each projection, in the order of their angles; default: equal, as on
    the systems above."""

    @model_validator(mode="before")
    @classmethod
    def _filled_by_its_system(cls, value: Any) -> Any:
        """Fill in the keys that are not given from the named system."""
        if not isinstance(value, dict):
            return value
        if isinstance(value.get("shares"), list):
            # After a "before" validator pydantic takes the value for Python input, in which strict
            # mode accepts no list as a tuple.
            value = {**value, "shares": tuple(value["shares"])}
        name = value.get("system")
        system = SYSTEMS.get(name) if isinstance(name, str) else None
        if system is None:
            return value
        filled = {**asdict(system), **value}
        arc = value.get("angle_range_deg")
        if "detector_angle_range_deg" not in value and isinstance(arc, int | float):
            # Over another arc the detector turns by the same part of the tube's angle.
            part = system.detector_angle_range_deg / system.angle_range_deg
            filled["detector_angle_range_deg"] = part * float(arc)
        return filled

    @model_validator(mode="after")
    def _one_share_a_projection(self) -> Self:
        if self.shares is not None and len(self.shares) != self.projections:
            raise ValueError(
                f"shares: found {len(self.shares)}, expected one for each of the "
                f"{self.projections} projections"
            )
        return self

    @model_validator(mode="after")
    def _detector_behind_the_tube(self) -> Self:
        if self.detector_angle_range_deg > self.angle_range_deg:
            raise ValueError(
                f"detector_angle_range_deg: found {self.detector_angle_range_deg:g}, expected at "
                f"most angle_range_deg, {self.angle_range_deg:g}: the detector rotates with the "
                f"tube"
            )
        return self

    def detector_angle_deg(self, tube_angle_deg: float) -> float:
        """Angle of the detector while the tube is at another, degrees."""
        if self.detector_angle_range_deg == 0.0:
            return 0.0
        return tube_angle_deg * self.detector_angle_range_deg / self.angle_range_deg

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """Angle of each projection, degrees, from negative (towards -y) to positive."""
        half = 0.5 * self.angle_range_deg
        if self.projections == 1:
            return (0.0,)
        return tuple(float(angle) for angle in np.linspace(-half, half, self.projections))

    @property
    def load_parts(self) -> tuple[float, ...]:
        """Part of the tube load that each projection is given; they add up to 1."""
        shares = self.shares or (1.0,) * self.projections
        total = sum(shares)
        return tuple(share / total for share in shares)
