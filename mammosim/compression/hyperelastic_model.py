"""The `hyperelastic` model of a phantom: elements, plates, equilibrium, displacement field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.continuation import continued
from mammosim.compression.credibility import contact_quantities
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.force_control import reach_force
from mammosim.compression.hyperelastic.measures import (
    body_measures,
    unbalanced_place,
    weakest_place,
)
from mammosim.compression.hyperelastic.mesh import WALL, build_mesh
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.stages import HISTORY, Stages
from mammosim.compression.model import MechanicalModel
from mammosim.compression.plates import Plates, held_tissue, place_plates, plate_edge_mm
from mammosim.compression.settings import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom

AIR_LAYERS = 3
"""Of nodes around the tissue that move with it, the first along the slope of the field."""

WIDEST_STEP = 0.1
"""Part of the gap by which plates may move in one go from a state that is known."""

BYTES_PER_NODE = 1300.0
"""Of the lattice's box: displacement and force in double precision; a block stencil holds 126
numbers a node."""

SECONDS_PER_COMPRESSION, SECONDS_PER_NODE = 6.0, 8e-5
"""On two cores: bodies of some ten thousand elements take as many Newton steps as large ones, and
threads hardly share them (measured with benchmarks/biopsy_shift.py)."""


@dataclass(frozen=True, eq=False)
class _Reached:
    """A state and the plates that it lies between."""

    state: State
    plates: Plates

    @property
    def converged(self) -> bool:
        return self.state.converged and not self.state.interrupted


def compress_hyperelastic(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """Compress a breast as a near-incompressible neo-Hookean solid, a finite element a block.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    settings : CompressionSettings
    seed : int
        Of no effect: nothing is random.
    watch : callable, optional
        Called with each row of the history.
    lattice_shift : tuple of float
        By which part of the spacing the lattice lies off its usual place along y and z.

    Returns
    -------
    CompressedBreast
        Its `converged` and `interrupted` say how the solver ended.

    Notes
    -----
    W = mu/2 (J^(-2/3) I1 - 3) + kappa/2 (J - 1)^2, the volume being kept on the mean of an element.
    No skin tension, gravity, friction or bending of the plates.
    """
    reach, fixed = held_tissue(settings, breast)
    mesh = build_mesh(
        breast, view, settings.resolution_mm, settings.moduli, settings.chest_wall, fixed,
        lattice_shift,
    )  # fmt: skip
    edge = plate_edge_mm(settings, reach, fixed)
    plates, notes = place_plates(settings, breast, view, mesh.elements, edge)
    stages = Stages(mesh, edge, settings.force_tolerance, watch)

    def with_force(plates: Plates, start: _Reached | None) -> tuple[_Reached, float]:
        near = start is not None and start.plates.thickness_mm - plates.thickness_mm < (
            WIDEST_STEP * plates.thickness_mm
        )
        state = stages.settle(plates, start.state.u) if near and start else stages.compress(plates)
        return _Reached(state, plates), body_measures(mesh, stages.contact(0, plates), state)[
            "force_n"
        ]

    if settings.force_n is not None:
        bottom, top = mesh.elements.height_mm
        plates, reached = reach_force(plates, top - bottom, settings.force_n, with_force)
        state = reached.state
    else:
        state = stages.compress(plates)
    return _result(breast, view, stages, plates, state, (*mesh.elements.notes, *notes))


def _result(
    breast: BreastPhantom,
    view: View,
    stages: Stages,
    plates: Plates,
    state: State,
    notes: tuple[str, ...],
) -> CompressedBreast:
    mesh = stages.mesh
    measures = body_measures(mesh, stages.contact(0, plates), state)
    whole = measures["inverted_cells"] == 0.0
    if not whole:
        place = weakest_place(mesh, state, view.rotation)
        notes = (
            *notes,
            f"{measures['inverted_cells']:.0f} elements are folded, the worst at "
            f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f}) mm",
        )
    if not state.converged and state.last.out_of_balance > 0.0:
        place = unbalanced_place(mesh, state, view.rotation)
        notes = (
            *notes,
            "the largest unbalanced force is at "
            f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f}) mm",
        )
    moved = continued(state.u, mesh.body.nodes, AIR_LAYERS, straight=1)
    moved[:, :WALL] = moved[:, WALL : WALL + 1]
    spacing = float(mesh.nodes.spacing_mm[0])
    field = DisplacementField(
        mesh.nodes,
        np.ascontiguousarray(np.moveaxis(moved * spacing, 0, -1), dtype=np.float32),
        mesh.body.nodes,
        view.rotation,
    )
    return CompressedBreast(
        breast, view, "hyperelastic", field, plates.support_z_mm, plates.paddle_z_mm,
        plates.edge_mm, state.converged and whole, measures, np.array(stages.rows, HISTORY), notes,
        state.interrupted, mesh.elements.modulus,
    )  # fmt: skip


def _where_it_stopped(compressed: CompressedBreast, settings: CompressionSettings) -> str:
    measures = compressed.measures
    return (
        f"hyperelastic stopped at an out-of-balance force of {measures['out_of_balance']:.3g} "
        f"(allowed {settings.force_tolerance:g}), smallest J {measures['smallest_j']:.3g}, "
        f"after {compressed.history.size} steps; "
        + (compressed.notes[-1] if compressed.notes else "")
    )


def _seconds(settings: CompressionSettings, nodes: float) -> float:
    return SECONDS_PER_COMPRESSION + nodes * SECONDS_PER_NODE


def _quantities(compressed: CompressedBreast, settings: CompressionSettings) -> dict[str, float]:
    return {
        **contact_quantities(compressed, settings),
        "folded_elements": compressed.measures["inverted_cells"],
    }


HYPERELASTIC = MechanicalModel(
    compress_hyperelastic,
    method=lambda settings: "hyperelastic",
    where_it_stopped=_where_it_stopped,
    quantities=_quantities,
    bytes_per_node=BYTES_PER_NODE,
    seconds=_seconds,
)
