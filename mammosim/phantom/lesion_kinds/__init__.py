"""Kinds of lesions, one file a kind: name in a configuration -> `LesionKind`."""

from mammosim.phantom.lesion_kinds.calcification import CALCIFICATION, CalcificationKeys
from mammosim.phantom.lesion_kinds.clip import CLIP
from mammosim.phantom.lesion_kinds.kind import (
    ABNORMAL_STRUCTURE,
    PHYSICAL_OBJECT,
    Code,
    LesionForm,
    LesionKind,
)
from mammosim.phantom.lesion_kinds.mass import MASS, MassKeys
from mammosim.phantom.lesion_kinds.site import (
    Site,
    distance_mm,
    nearest_voxel,
    paint_ball,
    window_around,
)

LESION_KINDS: dict[str, LesionKind] = {
    "mass": MASS,
    "calcification": CALCIFICATION,
    "clip": CLIP,
}
"""Kinds of lesions by the name that `phantom.lesions[].kind` gives them."""


class OwnKeys(CalcificationKeys, MassKeys):
    """Keys that belong to one kind each, for the settings of any lesion; listed last kind first."""


def lesion_tissues() -> dict[str, str]:
    """Tissues that only lesions are made of.

    Returns
    -------
    dict
        Kind of lesion by the tissue's name. Every piece of such a tissue in a phantom that is read
        is a lesion of that kind.

    Examples
    --------
    >>> lesion_tissues()["mass"]
    'mass'
    """
    return {kind.tissue: name for name, kind in LESION_KINDS.items() if kind.tissue == name}


__all__ = [
    "ABNORMAL_STRUCTURE",
    "LESION_KINDS",
    "PHYSICAL_OBJECT",
    "Code",
    "LesionForm",
    "LesionKind",
    "OwnKeys",
    "Site",
    "distance_mm",
    "lesion_tissues",
    "nearest_voxel",
    "paint_ball",
    "window_around",
]
