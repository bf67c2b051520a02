"""A breast's lattice with what holds it and pulls at it, ready for any place of the plates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.lattice import Lattice, PosteriorLimits, build_lattice, tissue_mean
from mammosim.compression.plates import Plates
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.springs import SpringProblem
from mammosim.compression.springs.problem import CHEST_WALL_INDEX, Forces
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom
from mammosim.tissues import density_g_cm3, stiffening

GRAVITY_M_S2 = 9.80665
"""Standard acceleration of free fall (CGPM 1901)."""

DOWN = (0.0, 0.0, -1.0)
"""Where weight pulls, breast frame: the patient stands."""


@dataclass(frozen=True, eq=False)
class SpringCase:
    """A lattice with its boundary conditions and loads.

    Parameters
    ----------
    lattice : Lattice
    fixed : ndarray of bool, [x, y, z]
        Nodes that are held.
    chest : int
        x index of the foremost layer of the chest wall.
    stiffening : ndarray of float32, [x, y, z], or None
        Enl of springs that stiffen, None for linear ones.
    force : tuple of three (ndarray of float32 or None), [x, y, z]
        Weight of each node along x, y, z, as `SpringProblem` takes it.
    """

    lattice: Lattice
    fixed: NDArray[np.bool_]
    chest: int
    stiffening: NDArray[np.float32] | None
    force: Forces

    @property
    def spacing_mm(self) -> float:
        """Node spacing, mm."""
        return float(self.lattice.frame.spacing_mm[0])

    def problem(self, plates: Plates) -> SpringProblem:
        """The spring problem in lattice units."""
        if plates.paddle != "straight":
            raise InputError(
                f"the model springs supports straight plates only, found the paddle "
                f"{plates.paddle}; "
                "use the model hyperelastic"
            )
        frame = self.lattice.frame
        heights = np.array([[0.0, 0.0, plates.support_z_mm], [0.0, 0.0, plates.paddle_z_mm]])
        lower, upper = frame.index(heights)[:, 2]
        # A point is moved by nodes up to one spacing behind it: where those behind the edge were
        # free, tissue just beyond it would stand out through the plates. For the same reason the
        # edge is not rounded: what rises behind it would come forward above the rounding, where
        # the detector begins, and draw a white line along the chest wall.
        edge = float((plates.edge_mm - frame.origin_mm[0]) / self.spacing_mm) - 1.0
        return SpringProblem(
            self.lattice.modulus, self.fixed, float(lower), float(upper), edge,
            force=self.force, edge_radius=0.0, stiffening=self.stiffening, chest=float(self.chest),
        )  # fmt: skip


def make_case(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    reach: PosteriorLimits,
    muscle_fixed: bool,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> SpringCase:
    """Lattice, held nodes, stiffening and weight of a breast in a view.

    Raises
    ------
    InputError
        If the chest wall that the settings name would hold all tissue or none.
    """
    lattice = build_lattice(breast, view, settings.resolution_mm, settings.moduli, lattice_shift)
    chest = _chest_layer(lattice, reach)
    fixed = np.zeros(lattice.modulus.shape, bool)
    fixed[: chest + 1] = lattice.tissue[: chest + 1]
    if muscle_fixed:
        fixed |= lattice.muscle
    enl = None
    if settings.spring_law == "exponential":
        enl = tissue_mean(breast, view, lattice, stiffening)
    force = _weight(breast, view, lattice) if settings.gravity else (None, None, None)
    return SpringCase(lattice, fixed, chest, enl, force)


def _chest_layer(lattice: Lattice, reach: PosteriorLimits) -> int:
    """Foremost layer of nodes at or behind the chest wall, at least the first of tissue."""
    frame = lattice.frame
    chest = int(np.floor((reach.chest_wall_mm - frame.origin_mm[0]) / frame.spacing_mm[0] + 1e-6))
    if not lattice.tissue[max(chest, CHEST_WALL_INDEX) + 1 :].any():
        raise InputError(
            f"compression.chest_wall_mm: found {reach.chest_wall_mm:g}, but all tissue lies behind "
            "it; must be smaller"
        )
    return max(chest, CHEST_WALL_INDEX)


def _weight(breast: BreastPhantom, view: View, lattice: Lattice) -> Forces:
    """Weight of each node, kPa x lattice units: 9 F / h^2 for F = rho g h^3 in mN.

    rho in g/cm3 is 1e-6 kg/mm3, so that F = 1e-3 rho g h^3 mN for h in mm.
    """
    spacing = float(lattice.frame.spacing_mm[0])
    weight = tissue_mean(breast, view, lattice, density_g_cm3)
    weight *= np.float32(9.0 * 1e-3 * GRAVITY_M_S2 * spacing)
    down = view.compression_from_breast(DOWN)
    x, y, z = (weight * np.float32(part) if part != 0.0 else None for part in down)
    return (x, y, z)
