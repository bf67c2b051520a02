"""What a compressed body shows: force, contact, volume, folded elements."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.hyperelastic._element_kernels import element_volumes
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.mesh import Mesh
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.plate_balance import PlateForces

FRONT_MM = 20.0
"""Distance from the plates' edge beyond which their force counts as one on the breast itself, not
on the tissue at the chest wall (assumed; sensors tell the two apart: Dustler et al. 2021)."""


def body_measures(mesh: Mesh, contact: Contact, state: State) -> dict[str, float]:
    """Force, contact, volume and folded elements of a state.

    Returns
    -------
    dict
        `force_n` (on the paddle) and `support_force_n`; `contact_area_mm2` and
        `support_contact_area_mm2`, of the deformed surface that touches; `pressure_kpa` (mean over
        the paddle's area); `front_force_n` and `front_pressure_kpa`, the same for the paddle more
        than 20 mm in front of the plates' edge; `volume_before_ml` and `volume_after_ml` of the
        elements' tissue, their `volume_ratio` and `volume_change_percent` (positive for a loss);
        `inverted_cells`, elements with J <= 0 at any of nine points, of `cells`; `smallest_j`;
        `out_of_balance`, the norm of the nodes' unbalanced forces over that of the plates' forces
        on them; `depth_mm`, how far the surface is inside the plates (root mean square); `error_mm`
        and `largest_error_mm`, the estimated distance of the nodes from equilibrium, mean and
        largest; `energy_mj`, by which two equilibria between the same plates can be compared;
        `skin_mm`, the skin's thickness, where it is a sheet.
    """
    edge = float(mesh.nodes.spacing_mm[0])
    pressure, push = contact.pressure(state.u)
    paddle_n, support_n = plate_forces(contact, state, edge)
    area = _touching_area(contact, state.u, pressure) * edge**2
    measures = {
        "force_n": paddle_n,
        "support_force_n": support_n,
        "contact_area_mm2": float(area[0]),
        "support_contact_area_mm2": float(area[1]),
        "pressure_kpa": 1e3 * paddle_n / area[0] if area[0] > 0.0 else 0.0,
    }
    measures.update(_front(contact, state.u, pressure[0], push[0], edge))
    volume, smallest = _volumes(mesh, state)
    tissue = mesh.body.fraction * mesh.body.active
    before, after = float(tissue.sum()), float((tissue * volume).sum())
    ratio = after / before
    measures.update(
        volume_before_ml=before * edge**3 * 1e-3,
        volume_after_ml=after * edge**3 * 1e-3,
        volume_ratio=ratio,
        volume_change_percent=100.0 * (1.0 - ratio),
        inverted_cells=float(np.count_nonzero(smallest[mesh.body.active] <= 0.0)),
        cells=float(np.count_nonzero(mesh.body.active)),
        smallest_j=float(smallest[mesh.body.active].min()),
        out_of_balance=state.last.out_of_balance,
        depth_mm=state.last.depth * edge,
        error_mm=state.last.error * edge,
        largest_error_mm=state.last.largest_error * edge,
        energy_mj=state.value.energy * edge**3 * 1e-3,
    )
    if mesh.body.structure.skin is not None:
        measures["skin_mm"] = mesh.body.structure.skin.thickness * edge
    return measures


def plate_forces(contact: Contact, state: State, edge_mm: float) -> PlateForces:
    """Forces on paddle and support of a state of a body whose elements have that edge.

    With friction, they contain that of the surface along the plates' rounded edge.
    """
    paddle, support = contact.plate_force(*contact.pressure(state.u))
    if state.grip is not None:
        along = state.grip.stress[:, :, 2] @ contact.points.area
        paddle, support = paddle + float(along[0]), support - float(along[1])
    newton = edge_mm**2 * 1e-3
    return PlateForces(paddle * newton, support * newton)


def weakest_place(mesh: Mesh, state: State, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) centre at rest of the element with the smallest J, breast frame, mm."""
    _, smallest = _volumes(mesh, state)
    cell = np.unravel_index(np.argmin(smallest), smallest.shape)
    place = mesh.nodes.origin_mm + (np.array(cell) + 0.5) * mesh.nodes.spacing_mm
    return np.asarray(place @ rotation)


def unbalanced_place(
    mesh: Mesh, state: State, rotation: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Place at rest of the node with the largest unbalanced force, breast frame, mm."""
    square = (state.value.force**2).sum(axis=0)
    node = np.unravel_index(np.argmax(square), square.shape)
    place = mesh.nodes.origin_mm + np.array(node) * mesh.nodes.spacing_mm
    return np.asarray(place @ rotation)


def _volumes(mesh: Mesh, state: State) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Volume ratio and smallest J of each element, 1 where there is none."""
    volume, smallest = (np.ones(mesh.body.shear.shape) for _ in range(2))
    element_volumes(state.u, mesh.body.element_span, volume, smallest)
    none = ~mesh.body.active
    volume[none] = smallest[none] = 1.0
    return volume, smallest


def _touching_area(
    contact: Contact, u: NDArray[np.float64], pressure: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deformed area of the surface that each plate presses, faces of an element.

    Nanson's formula: a surface element n dA of the rest becomes J F^(-T) n dA.
    """
    return np.array(
        [_deformed_area(contact.points, u, pressed > 0.0).sum() for pressed in pressure]
    )


def _deformed_area(
    points: SurfacePoints, u: NDArray[np.float64], some: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Deformed area that some of the points stand for, faces of an element."""
    gradient = _gradient(u, points.cells[some], points.local[some])
    cofactor = np.linalg.det(gradient)[:, None, None] * np.linalg.inv(gradient)
    turned = np.einsum("nji,nj->ni", cofactor, points.normal[some])
    return np.asarray(np.linalg.norm(turned, axis=1) * points.area[some])


def _front(
    contact: Contact,
    u: NDArray[np.float64],
    pressure: NDArray[np.float64],
    push: NDArray[np.float64],
    edge_mm: float,
) -> dict[str, float]:
    """Force and mean pressure of the paddle on the breast itself, away from the chest wall."""
    start = contact.plates[1].edge + FRONT_MM / edge_mm
    front = (pressure > 0.0) & (contact.points.places(u)[:, 0] > start)
    force = -float((pressure * push[:, 2] * contact.points.area)[front].sum())
    area = float(_deformed_area(contact.points, u, front).sum())
    return {
        "front_force_n": force * edge_mm**2 * 1e-3,
        "front_pressure_kpa": force / area if area > 0.0 else 0.0,
    }


def _gradient(
    u: NDArray[np.float64], cells: NDArray[np.int32], local: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3, 3) deformation gradient at points of elements."""
    gradient = np.repeat(np.eye(3)[None], len(cells), axis=0)
    for corner in np.ndindex(2, 2, 2):
        node = cells + corner
        moved = u[:, node[:, 0], node[:, 1], node[:, 2]].T
        weights = np.where(corner, local, 1.0 - local)
        for axis in range(3):
            others = weights[:, [d for d in range(3) if d != axis]].prod(axis=1)
            sign = 1.0 if corner[axis] else -1.0
            gradient[:, :, axis] += (sign * others)[:, None] * moved
    return gradient
