"""The elements of a phantom: where they are, what they are made of, what holds them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic.body import SMALLEST_PART, Body, nodes_of
from mammosim.compression.hyperelastic.fascia import RIM_MM
from mammosim.compression.hyperelastic.fascia import WALL as WALL
from mammosim.compression.hyperelastic.structure import Skin, Structure
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.lattice import (
    Lattice,
    block_mean,
    bounds_mm,
    gather_tissue,
    tissue_part,
)
from mammosim.errors import InputError
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import BreastPhantom
from mammosim.tissues import (
    SKIN_THICKNESS_MM,
    Moduli,
    SkinSheet,
    density_g_cm3,
    poisson_ratio,
)

VOXELS_ACROSS = 1.5
"""Skin thinner than this many voxels has no thickness that could be measured."""

BEHIND_WALL = 0.5
"""Distance behind the chest wall from which fibres spread, in depths of the breast (assumed): they
run forward in the middle and fan out to the skin beside it, as Cooper's ligaments do."""

ALIGNED = 8
"""The wall's mid-line is a node of the coarse bodies too, down to elements this much larger."""


@dataclass(frozen=True)
class Support:
    """What holds a breast, and whether it has weight.

    Parameters
    ----------
    chest_wall : {"fixed", "sliding", "fascia"}
        `sliding` holds the wall along its normal, and along y on its mid-line; `fascia` along its
        normal, and ties it in its plane.
    muscle_fixed : bool
        Whether elements that are mostly muscle are held.
    skin : SkinSheet, optional
        Skin that is a membrane on the surface.
    fascia_kpa_per_mm : float
        Tangential stiffness of the tie to the chest wall.
    gravity_m_s2 : tuple of float, optional
        Acceleration by gravity, compression frame; None: no weight.
    fibre_ratio : float
        Young's modulus along fibres over that across; 1 for none.
    """

    chest_wall: str
    muscle_fixed: bool
    skin: SkinSheet | None = None
    fascia_kpa_per_mm: float = 0.0
    gravity_m_s2: tuple[float, float, float] | None = None
    fibre_ratio: float = 1.0


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
    support: Support,
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
        Young's modulus of each tissue; elements beneath skin that is a sheet hold fat.
    support : Support
        What holds the breast, and whether it has weight.
    shift : tuple of float
        By which part of an edge the elements lie off their usual place along y and z; what is held
        on the mid-line goes with them.

    Raises
    ------
    InputError
        If no element touches the chest wall.
    """
    blocks, middle = _element_frame(breast, view, resolution_mm, shift)
    inside = _beneath(moduli) if support.skin else moduli
    fraction, modulus, muscle = gather_tissue(breast, view, blocks, inside)
    for axis in range(3):
        np.moveaxis(fraction, axis, 0)[[0, -2, -1]] = 0.0
    ratio = poisson_ratio(moduli.stiffness_set)
    weighted = modulus * fraction
    shear, bulk = weighted / (2.0 * (1.0 + ratio)), weighted / (3.0 * (1.0 - 2.0 * ratio))
    solid = fraction >= SMALLEST_PART
    stuck = solid & (muscle >= SMALLEST_PART) & support.muscle_fixed
    body = Body.of(fraction, shear, bulk, _held(solid, stuck, support.chest_wall, middle))
    if not body.active[WALL].any():
        raise InputError(
            f"{breast.source}: no element at the chest wall with compression.resolution_mm "
            f"{resolution_mm}; use a finer resolution"
        )
    body = replace(body, structure=_structure(breast, view, blocks, body, support))
    apart = int(np.count_nonzero(solid & ~body.active))
    notes = (
        f"{view.folder}: {apart} elements are not connected to the chest wall and were omitted",
    )
    modulus[~body.active] = 0.0
    return Mesh(
        body,
        VoxelFrame(blocks.origin_mm - 0.5 * resolution_mm, blocks.spacing_mm, blocks.shape),
        Lattice(blocks, modulus, muscle >= SMALLEST_PART, notes if apart else ()),
    )


def _beneath(moduli: Moduli) -> Moduli:
    """Moduli of the elements beneath a membrane: fat where skin is."""
    return Moduli(moduli.stiffness_set, {**moduli.given, "skin": moduli("adipose")})


def _structure(
    breast: BreastPhantom, view: View, blocks: VoxelFrame, body: Body, support: Support
) -> Structure:
    edge, mass = float(blocks.spacing_mm[0]), None
    skin = _skin(breast, view, blocks, body, support.skin) if support.skin else None
    if support.gravity_m_s2 is not None:
        mass = block_mean(breast, view, blocks, density_g_cm3) * body.fraction
    # 1 g/cm3 is 1e-6 kg/mm3, and 1 kPa 1 mN/mm2: rho g in kPa/mm is 1e-3 of its value in m/s2.
    x, y, z = (1e-3 * edge * part for part in support.gravity_m_s2 or (0.0, 0.0, 0.0))
    fascia, rim = support.fascia_kpa_per_mm * edge, RIM_MM / edge
    origin = _behind(body) if support.fibre_ratio > 1.0 else (0.0, 0.0, 0.0)
    return Structure(skin, fascia, rim, mass, (x, y, z), support.fibre_ratio, origin)


def _behind(body: Body) -> tuple[float, float, float]:
    """Where fibres come from: behind the middle of the wall, by half the breast's depth."""
    layers = np.flatnonzero(body.active.any(axis=(1, 2)))
    middle = np.argwhere(body.active[WALL]).mean(axis=0) + 0.5
    depth = float(layers[-1] + 1 - WALL)
    return WALL - BEHIND_WALL * depth, float(middle[0]), float(middle[1])


def _skin(
    breast: BreastPhantom, view: View, blocks: VoxelFrame, body: Body, sheet: SkinSheet
) -> Skin:
    """Skin of a body; its thickness is measured where it is left open and voxels show it."""
    part, edge = tissue_part(breast, view, blocks, "skin"), float(blocks.spacing_mm[0])
    usual = SKIN_THICKNESS_MM if sheet.thickness_mm is None else sheet.thickness_mm
    skin = Skin(part, sheet.young_kpa / 3.0, usual / edge, sheet.stiffening)
    if sheet.thickness_mm is not None:
        return skin
    points = SurfacePoints.of(body.fraction, body.free)
    area = float(points.area[skin.covers(points)].sum())
    measured = float(part.sum()) * edge / area if area > 0.0 else 0.0
    if measured < VOXELS_ACROSS * breast.voxel_mm.max():
        return skin
    return replace(skin, thickness=measured / edge)


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
        return held
    held[0, WALL] |= wall
    if chest_wall == "sliding":
        held[1, WALL, middle] |= wall[middle]
    return held
