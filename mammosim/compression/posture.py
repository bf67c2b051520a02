"""The breast without plates, pulled by its weight as the woman stands or lies."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mammosim._jit import one_blas_thread
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.hyperelastic.stages import HISTORY, Stages
from mammosim.compression.hyperelastic_model import elements_of, field_of
from mammosim.compression.plates import Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_case import DOWN
from mammosim.errors import Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, as_held

Posture = Literal["standing", "prone", "supine"]

DOWNWARD: dict[Posture, tuple[float, float, float]] = {
    "standing": DOWN,
    "prone": (1.0, 0.0, 0.0),
    "supine": (-1.0, 0.0, 0.0),
}
"""Where weight pulls, breast frame: x anterior, z superior."""

FAR_MM = 1e5
"""Height of plates that touch nothing."""

EXPERIMENTAL = (
    "the posture is experimental: the phantom's shape is taken as free of weight, and with the "
    "moduli used for compression the breast moves less from prone to supine than in women"
)
"""What a user must know about every such result."""


@one_blas_thread
def in_posture(
    breast: BreastPhantom, view: View, settings: CompressionSettings, posture: Posture
) -> CompressedBreast:
    """A breast without plates under its weight, hanging from the chest wall or lying on it.

    Parameters
    ----------
    breast : BreastPhantom
        Its shape is taken as free of weight.
    view : View
        Whose compression frame the elements have; nothing is compressed.
    settings : CompressionSettings
        Moduli, skin, fascia and resolution, of the model `hyperelastic`.
    posture : {"standing", "prone", "supine"}

    Returns
    -------
    CompressedBreast
        Of the model `none`: no plates, but tissue has moved.

    Raises
    ------
    NotConverged
        If the solver stopped before its tolerance; it carries what was reached.
    Interrupted
        If the user stopped it.
    """
    held = as_held(breast, view.rotation[1])
    mesh = elements_of(held, view, settings, DOWNWARD[posture])
    wall_mm = float(mesh.nodes.origin_mm[0])
    stages = Stages(mesh, wall_mm, settings.tolerance_mm)
    state = stages.compress(Plates(-FAR_MM, FAR_MM, wall_mm))
    bottom, top = mesh.elements.height_mm
    edge = float(mesh.nodes.spacing_mm[0])
    found = CompressedBreast(
        held, view, "none", field_of(mesh, state, view), bottom, top, wall_mm, state.converged,
        {"force_n": 0.0, "error_mm": state.last.error * edge,
         "largest_error_mm": state.last.largest_error * edge, "smallest_j": state.value.smallest},
        np.array(stages.rows, HISTORY), mesh.elements.notes, state.interrupted, posture=posture,
    )  # fmt: skip
    if state.interrupted:
        raise Interrupted(f"{posture}: the posture was interrupted", found)
    if not state.converged:
        raise NotConverged(
            f"{posture}: the breast under its weight stopped at an estimated error of "
            f"{state.last.error * edge:.3g} mm (allowed {settings.tolerance_mm:g})",
            found,
        )
    return found
