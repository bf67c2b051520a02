"""Settings of the projection: detector, focal spot, conservation of mass."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from mammosim.config import Settings

Length = Annotated[float, Field(gt=0.0)]


class ProjectionSettings(Settings):
    """How the compressed breast is projected onto the detector."""

    # 0.1 mm is the pitch of caesium iodide flat panels; amorphous selenium has 0.07 to 0.085 mm.
    pixel_mm: Annotated[float, Field(gt=0.0, le=10.0)] = 0.1
    """Pixel pitch of the detector, mm."""

    # 650 mm as in VICTRE (Badano et al. 2018, JAMA Netw Open 1(7):e185474); clinical units have
    # 650 to 700 mm.
    source_to_detector_mm: Length = 650.0
    """Distance of the focal spot from the detector plane, mm."""

    # 10 to 20 mm on clinical units; 15 mm is the air gap of the scatter measurements of Boone
    # et al. 2000 (Med Phys 27:2408-2416), which the scatter model builds on.
    support_to_detector_mm: Annotated[float, Field(ge=0.0)] = 15.0
    """Gap between the breast support's upper surface and the detector plane, mm."""

    detector_edge_mm: float | None = None
    """Breast-frame x of the detector's chest-wall edge, mm; left out: the plates' edge."""

    detector_mm: tuple[Length, Length] | None = None
    """Height (along the chest wall) and width of the detector, mm; left out: the smaller of the
    two usual formats, 240 x 180 and 300 x 240 mm, that holds the breast's shadow."""

    focal_spot_y_mm: float | None = None
    """Compression-frame y of the focal spot, mm; left out: 0 where the breast spans it, else the
    middle of the breast."""

    conserve_mass: bool = True
    """Whether tissue that compression squeezes together attenuates more, so that mass is kept."""
