"""What a view is and how it lies in the patient, in DICOM's words."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mammosim.geometry import MAGNIFIED, Gantry, View

# Codes of PS3.16 CID 4014 "View for Mammography": value and meaning in SNOMED CT.
VIEW_CODES: dict[str, tuple[str, str]] = {
    "CC": ("399162004", "cranio-caudal"),
    "MLO": ("399368009", "medio-lateral oblique"),
    "ML": ("399260004", "medio-lateral"),
}
"""Code value and meaning of each view."""

# Codes of PS3.16 CID 4015 "View Modifier for Mammography": value and meaning in SNOMED CT.
_MAGNIFICATION = ("399163009", "Magnification")
_SPOT_COMPRESSION = ("399055006", "Spot Compression")

# Letters of Patient Orientation (PS3.3 C.7.6.1.1.1) of the breast frame's axes, + and -. Equally
# strong directions are named in this order: a mediolateral oblique at 45 degrees reads FR.
_LETTERS = ((2, "H", "F"), (0, "A", "P"), (1, "L", "R"))

_NEGLIGIBLE = 1e-6  # far below the least angle anyone sets, far above the rounding of cosines


def view_modifiers(gantry: Gantry) -> list[tuple[str, str]]:
    """Codes and meanings of how a view differs from the usual one."""
    found = [
        (_SPOT_COMPRESSION, gantry.view.spot),
        (_MAGNIFICATION, gantry.magnification >= MAGNIFIED),
    ]
    return [code for code, holds in found if holds]


def patient_orientation(view: View) -> list[str]:
    """Letters of the directions of the image's rows and columns.

    Parameters
    ----------
    view : View

    Returns
    -------
    list of str
        Direction along a row (towards higher columns), and along a column (towards higher rows),
        strongest letter first.

    Notes
    -----
    Along a row a left breast's image runs to the nipple and a right one's away from it; down a
    column y of the compression frame falls for a left breast and rises for a right one.

    Examples
    --------
    >>> patient_orientation(View("MLO", "L"))
    ['A', 'FR']
    """
    sign = 1.0 if view.laterality == "L" else -1.0
    along_row, down_column = np.array([[sign, 0.0, 0.0], [0.0, -sign, 0.0]]) @ view.patient_rotation
    return [_letters(along_row), _letters(down_column)]


def _letters(direction: ArrayLike) -> str:
    strength = np.round(np.asarray(direction, dtype=np.float64), 9)
    named = [
        (abs(strength[axis]), plus if strength[axis] > 0 else minus)
        for axis, plus, minus in _LETTERS
        if abs(strength[axis]) > _NEGLIGIBLE
    ]
    return "".join(letter for _, letter in sorted(named, key=lambda pair: -pair[0]))


def positioner_angle_deg(view: View) -> float:
    """Positioner Primary Angle, degrees: negative for a left breast, 0 for CC.

    The X-ray beam vector in the coronal plane, the patient standing and facing the equipment,
    vertical being zero (PS3.3 C.8.11.7); the sense goes with Positioner Primary Angle Direction
    CC, counter-clockwise.
    """
    if view.angle_deg == 0.0:
        return 0.0
    return -view.angle_deg if view.laterality == "L" else view.angle_deg
