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
    detector_angle_range_deg : float
        By which the detector turns meanwhile about the same pivot.
    """

    angle_range_deg: float
    projections: int
    pivot_to_detector_mm: float
    detector_angle_range_deg: float = 0.0


SYSTEMS: dict[str, System] = {
    # Hologic Selenia Dimensions: 15 images in 15 degrees (maker's page "How it works",
    # breasttomo.co.uk). That tube and detector turn about an axis in the detector's plane, the
    # latter by 4.2 degrees in all, is as in the geometry of Hologic's system in pyDBT (Vimieiro
    # et al., LAVI, University of Sao Paulo: pydbt/parameters/parameterSettings.py).
    "like-dimensions": System(15.0, 15, 0.0, 4.2),
    # GE SenoClaire: nine exposures, step and shoot (GE's announcement of its approval, 2014-09-03).
    # 25 degrees, a pivot 40 mm above the detector and a detector that stays are as in the geometry
    # of GE's system in pyDBT (as above), which is that of the Senographe Essential it was built on.
    "like-senoclaire": System(25.0, 9, 40.0),
    # Siemens Mammomat Inspiration: an image every two degrees of 50, 25 in all (AXIS Imaging News,
    # "Siemens breast tomosynthesis option gets FDA OK"); pivot as in VICTRE
    # (Badano et al. 2018, JAMA Netw Open 1(7):e185474).
    "like-inspiration": System(50.0, 25, 50.0),
}
"""Systems by name."""
