"""What a kind of lesion is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mammosim.config import Settings
from mammosim.phantom.lesion_kinds.site import Site

Code = tuple[str, str, str]
"""A coded term of DICOM: value, coding scheme, meaning."""


@dataclass(frozen=True)
class LesionForm:
    """How lesions of a kind are made.

    Parameters
    ----------
    diameter_mm : float
        Diameter where none is given, mm.
    arises_in : tuple of tuple of str
        Tissues in which a place is drawn: the first group of which the breast has any.
    paint : callable
        Function of the site, the lesion's settings and a random generator that labels the voxels,
        in place. Returns the volume of the lesion's material, mm3, or None for that of its voxels.
    room_mm : float or None
        Distance that a drawn place keeps from skin and other lesions, mm; None: the radius.
    """

    diameter_mm: float
    arises_in: tuple[tuple[str, ...], ...]
    paint: Callable[[Site, Any, np.random.Generator], float | None]
    room_mm: float | None = None


@dataclass(frozen=True)
class LesionKind:
    """A kind of lesion: how it is made, shown and written.

    Parameters
    ----------
    title : str
        What the report calls it.
    tissue : str
        Tissue of the table that it consists of. Where it has the kind's own name, every piece of
        it in a file is a lesion of this kind.
    form : callable
        The `LesionForm` for a lesion's settings.
    dicom_category, dicom_type : Code
        Category (PS3.16 CID 7150) and type (CID 7159, 6014 or 7193) of its segment.
    keys : type of Settings or None
        Keys of a lesion's settings that belong to this kind alone.
    victre_type : int or None
        VICTRE's number of this type of lesion (Constants.py); None: it has none.
    clustered : bool
        Whether pieces in a file that are near each other are one lesion, which then is no ball.
    crumbles : bool
        Whether its pieces in a file may lie apart, as ends of spicules that are thinner than a
        voxel: pieces near each other are one lesion.
    few_voxels : bool
        Whether its brightness is in a few voxels, which smoothing would take away.
    """

    title: str
    tissue: str
    form: Callable[[Any], LesionForm]
    dicom_category: Code
    dicom_type: Code
    keys: type[Settings] | None = None
    victre_type: int | None = None
    clustered: bool = False
    crumbles: bool = False
    few_voxels: bool = False


ABNORMAL_STRUCTURE: Code = ("49755003", "SCT", "Morphologically Abnormal Structure")
PHYSICAL_OBJECT: Code = ("260787004", "SCT", "Physical object")
