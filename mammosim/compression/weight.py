"""The equilibrium of a breast without plates, under its weight alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.breast_elements import elements_of
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.hyperelastic.mesh import Mesh
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.stages import HISTORY, Stages
from mammosim.compression.hyperelastic_model import field_of
from mammosim.compression.plates import Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_case import DOWN
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom, Posture

DOWNWARD: dict[Posture, tuple[float, float, float]] = {
    "standing": DOWN,
    "prone": (1.0, 0.0, 0.0),
    "supine": (-1.0, 0.0, 0.0),
}
"""Where weight pulls, breast frame: x anterior, z superior."""

FAR_MM = 1e5
"""Height of plates that touch nothing."""


@dataclass(frozen=True, eq=False)
class HangingBreast:
    """A breast in equilibrium with its weight.

    Parameters
    ----------
    mesh : Mesh
    state : State
    view : View
        Whose compression frame the elements have.
    history : ndarray, structured
        One row per Newton step.
    """

    mesh: Mesh
    state: State
    view: View
    history: NDArray[np.void]

    @property
    def field(self) -> DisplacementField:
        """Displacement from the shape without weight."""
        return field_of(self.mesh, self.state, self.view)

    @property
    def error_mm(self) -> tuple[float, float]:
        """Estimated distance from equilibrium, mean and largest."""
        edge = float(self.mesh.nodes.spacing_mm[0])
        return self.state.last.error * edge, self.state.last.largest_error * edge

    @property
    def wall_mm(self) -> float:
        """Place of the chest wall along x."""
        return float(self.mesh.nodes.origin_mm[0])

    @property
    def skin_mm(self) -> float | None:
        """Thickness of the skin; None where it is no sheet."""
        skin = self.mesh.body.structure.skin
        return None if skin is None else skin.thickness * float(self.mesh.nodes.spacing_mm[0])


def hang(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    posture: Posture,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> HangingBreast:
    """Let the weight of a breast act on its voxels' shape, which is taken as free of weight.

    Parameters
    ----------
    breast : BreastPhantom
        As it is held in the view (`as_held`).
    view : View
        Whose compression frame the elements have; nothing is compressed.
    settings : CompressionSettings
        Moduli, skin, fascia and resolution, of the model `hyperelastic`.
    posture : {"standing", "prone", "supine"}
    watch : callable, optional
        Called with each row of the history.
    lattice_shift : tuple of float
        As `compress_hyperelastic` takes it.
    """
    mesh = elements_of(breast, view, settings, DOWNWARD[posture], lattice_shift)
    wall_mm = float(mesh.nodes.origin_mm[0])
    stages = Stages(mesh, wall_mm, settings.tolerance_mm, watch)
    state = stages.compress(Plates(-FAR_MM, FAR_MM, wall_mm))
    return HangingBreast(mesh, state, view, np.array(stages.rows, HISTORY))
