"""How the tubes of clinical tomosynthesis systems move: one entry a kind of system."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class System:
    """Movement of a system's tube; the load is split evenly over the projections on all of them.

    Parameters
    ----------
    angle_range_deg : float
        Between the first and the last position of the tube.
    projections : int
    pivot_to_detector_mm : float
        Height of the pivot above the detector plane, mm.
    """

    angle_range_deg: float
    projections: int
    pivot_to_detector_mm: float


SYSTEMS: dict[str, System] = {
    # Hologic Selenia Dimensions: 15 images in 15 degrees (maker's page "How it works",
    # breasttomo.co.uk). That its tube turns about the detector's plane is assumed. Its
    # detector turns a little with the tube, which is not modelled.
    "like-dimensions": System(15.0, 15, 0.0),
    # GE SenoClaire, step and shoot. Arc, number and the pivot's height are assumed: no source that
    # can be read was found.
    "like-senoclaire": System(25.0, 9, 40.0),
    # Siemens Mammomat Inspiration: an image every two degrees of 50, 25 in all (AXIS Imaging News,
    # "Siemens breast tomosynthesis option gets FDA OK"); pivot as in VICTRE
    # (Badano et al. 2018, JAMA Netw Open 1(7):e185474).
    "like-inspiration": System(50.0, 25, 50.0),
}
"""Systems by name."""
