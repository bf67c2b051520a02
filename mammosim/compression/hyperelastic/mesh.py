"""The elements of a phantom: where they are, what they are made of, what holds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.body import SMALLEST_PART, Body, nodes_of
from mammosim.compression.lattice import Lattice, bounds_mm, gather_tissue
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom
from mammosim.tissues import Moduli, poisson_ratio

WALL = 1
"""x index of the chest wall's nodes."""

ALIGNED = 8
"""The wall's mid-line is a node of the coarse bodies too, down to elements this much larger."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A body and where it lies.

    Parameters
    ----------
    body : Body
    nodes : VoxelFrame
        Nodes at rest, compression frame, mm.
    elements : Lattice
        Elements as a lattice of blocks, for what concerns plates.
    """

    body: Body
    nodes: VoxelFrame
    elements: Lattice


def build_mesh(
    breast: BreastPhantom,
    view: View,
    resolution_mm: float,
    moduli: Moduli,
    chest_wall: str,
    muscle_fixed: bool,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """Elements of a phantom in the compression frame of a view.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    resolution_mm : float
        Edge of an element, mm.
    moduli : Moduli
        Young's modulus of each tissue.
    chest_wall : {"fixed", "sliding"}
        `sliding` holds the wall along its normal, and along y on its mid-line.
    muscle_fixed : bool
        Whether elements that are mostly muscle are held.
    shift : tuple of float
        By which part of an edge the elements lie off their usual place along y and z; what is held
        on the mid-line goes with them.

    Raises
    ------
    InputError
        If no element touches the chest wall.
    """
    blocks, middle = _element_frame(breast, view, resolution_mm, shift)
    fraction, modulus, muscle = gather_tissue(breast, view, blocks, moduli)
    for axis in range(3):
        np.moveaxis(fraction, axis, 0)[[0, -2, -1]] = 0.0
    ratio = poisson_ratio(moduli.stiffness_set)
    weighted = modulus * fraction
    shear, bulk = weighted / (2.0 * (1.0 + ratio)), weighted / (3.0 * (1.0 - 2.0 * ratio))
    solid = fraction >= SMALLEST_PART
    stuck = solid & (muscle >= SMALLEST_PART) & muscle_fixed
    body = Body.of(fraction, shear, bulk, _held(solid, stuck, chest_wall, middle))
    if not body.active[WALL].any():
        raise InputError(
            f"{breast.source}: no element at the chest wall with compression.resolution_mm "
            f"{resolution_mm}; use a finer resolution"
        )
    apart = int(np.count_nonzero(solid & ~body.active))
    notes = (f"{apart} elements are not tied to the chest wall and were left out",)
    modulus[~body.active] = 0.0
    return Mesh(
        body,
        VoxelFrame(blocks.origin_mm - 0.5 * resolution_mm, blocks.spacing_mm, blocks.shape),
        Lattice(blocks, modulus, muscle >= SMALLEST_PART, notes if apart else ()),
    )


def _element_frame(
    breast: BreastPhantom, view: View, h: float, shift: tuple[float, float]
) -> tuple[VoxelFrame, int]:
    """Centres of elements that cover all tissue: from the chest wall forward, even about y and z
    but for the shift; and the y index of the nodes on the mid-line.

    Element 0 along each axis is empty, and so are the last two. The middle of y and z is a node
    whose number is one more than a multiple of `ALIGNED`.
    """
    low, high = bounds_mm(breast, view)
    aside = np.array(shift)
    half = (high - low)[1:] / (2.0 * h) - 1e-6
    before = -(-np.ceil(half + aside).astype(int) // ALIGNED) * ALIGNED
    after = np.ceil(half - aside).astype(int)
    depth = int(np.ceil((high[0] - low[0]) / h - 1e-6))
    middle = 0.5 * (low + high)
    origin = np.append(low[0] - 0.5 * h, middle[1:] + (aside - before - 0.5) * h)
    ny, nz = (int(n) for n in before + after + 3)
    return VoxelFrame(origin, np.full(3, h), (depth + 3, ny, nz)), int(before[0]) + 1


def _held(
    solid: NDArray[np.bool_], stuck: NDArray[np.bool_], chest_wall: str, middle: int
) -> NDArray[np.bool_]:
    """Displacements that are held, [3, x, y, z]."""
    held = np.repeat(nodes_of(stuck)[None], 3, axis=0)
    wall = nodes_of(solid)[WALL]
    if chest_wall == "fixed":
        held[:, WALL] |= wall
    else:
        held[0, WALL] |= wall
        held[1, WALL, middle] |= wall[middle]
    return held
