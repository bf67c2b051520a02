"""The `hyperelastic` model of a phantom: elements, plates, equilibrium, displacement field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeGuard

import numpy as np

from mammosim._interruption import hold_interruptions
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.breast_elements import elements_of
from mammosim.compression.continuation import continued
from mammosim.compression.credibility import contact_quantities
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.force_control import settled
from mammosim.compression.hyperelastic.measures import (
    body_measures,
    plate_forces,
    unbalanced_place,
    weakest_place,
)
from mammosim.compression.hyperelastic.mesh import WALL, Mesh
from mammosim.compression.hyperelastic.newton import State
from mammosim.compression.hyperelastic.stages import HISTORY, Stages
from mammosim.compression.hyperelastic.tilt import level_paddle, moment_nm, tilted
from mammosim.compression.model import MechanicalModel
from mammosim.compression.plate_balance import BalancedHeight, PlateForces
from mammosim.compression.plates import (
    Plates,
    heights_beyond_edge_mm,
    held_tissue,
    place_plates,
    plate_edge_mm,
)
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.spring_case import DOWN
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom
from mammosim.plausibility import plausibility_warnings

AIR_LAYERS = 3
"""Of nodes around the tissue that move with it, the first along the slope of the field."""

WIDEST_STEP = 0.1
"""Part of the gap by which plates may move in one go from a state that is known."""

WIDEST_COARSE_STEP = 0.3
"""The same of the coarse body, which is compressed anew where that leads nowhere."""

FIRST_SLOPE = 1.4
"""`BalancedHeight.slope` at first: 0.9 to 2 in 12 compressions of generated breasts."""

BALANCE_LEVEL = 1
"""Of the nested bodies, the one on which the plates' height is sought: elements twice as large."""

BYTES_PER_NODE = 1550.0
"""Of the lattice's box; displacement and force in double precision; a block stencil holds 126
numbers per node, and so does its copy in bundles, for the part of the box that is tissue."""

SECONDS_PER_COMPRESSION, SECONDS_PER_NODE = 1.0, 5e-5
"""Of the lattice's box, with the search of the plates' height; threads hardly share them. Measured
with the set `aspiration`: 3.1e-5 s per node in CC and 6e-5 in MLO for elements of 3 mm."""

FRICTION_REPEATS = 3.0
"""Factor of that time with friction, whose pressure is found by repetition; 1 to 4 were seen."""


FORCE_TOLERANCE_IS_GONE = (
    "compression.force_tolerance is deprecated and has no effect; use compression.tolerance_mm"
)


class BodyBetweenPlates(NamedTuple):
    """Elements of a breast, the final place of the plates, and what was assumed."""

    mesh: Mesh
    plates: Plates
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Reached:
    """A state, the plates that it lies between, and whether a spring-loaded paddle met its stop."""

    state: State
    plates: Plates
    at_stop: bool = False

    @property
    def converged(self) -> bool:
        return self.state.converged and not self.state.interrupted

    @property
    def interrupted(self) -> bool:
        return self.state.interrupted

    def stopped(self) -> _Reached:
        """The same, where the user stopped the search."""
        return replace(self, state=replace(self.state, converged=False, interrupted=True))


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
    W = mu/2 (J^(-2/3) I1 - 3) + kappa/2 (J - 1)^2, the volume being kept on the mean of an element;
    skin is a membrane in tension, fascia an elastic layer behind the breast (`hyperelastic`). The
    plates do not bend; time plays no part.
    """
    mesh, plates, notes = body_between_plates(breast, view, settings, lattice_shift)
    edge_mm = float(mesh.nodes.spacing_mm[0])
    depth_mm = plates.panel.front_mm if plates.panel else 0.0
    stages = Stages(mesh, plates.edge_mm, settings.tolerance_mm, watch, depth_mm, settings.friction)
    coarse = _CoarseBody(stages)
    balance = BalancedHeight(
        coarse.forces, *heights_beyond_edge_mm(mesh.elements, plates.edge_mm),
        weightless=not settings.gravity, slope=FIRST_SLOPE,
    )  # fmt: skip

    tilt = settings.paddle.tilt if settings.paddle else None

    def equilibrium(plates: Plates, start: _Reached | None) -> tuple[_Reached, PlateForces]:
        if _is_near(start, plates):
            if start.plates.panel is not None:
                plates = tilted(plates, start.plates.panel.tilt_deg)
            state = stages.settle(plates, start.state)
        else:
            state = stages.compress(plates, start=coarse.start(plates))
        stopped = False
        if tilt is not None and tilt.spring_nm_per_deg is not None:
            plates, state, stopped = level_paddle(
                stages, plates, state, tilt.spring_nm_per_deg, tilt.max_deg
            )
        forces = plate_forces(stages.contact(0, plates), state, edge_mm)
        return _Reached(state, plates, stopped), forces

    bottom, top = mesh.elements.height_mm

    def at_rest() -> tuple[Plates, _Reached]:
        opened = replace(plates, support_z_mm=bottom - edge_mm, paddle_z_mm=top + edge_mm)
        return opened, _Reached(stages.at_rest(opened), opened)

    hold_interruptions()
    _, reached = settled(plates, settings, top - bottom, balance, equilibrium, at_rest)
    if tilt is not None and reached.at_stop:
        stop = f"{view.folder}: the paddle reaches its stop at {tilt.max_deg:g} degrees"
        notes = (*notes, stop)
    notes = (*_cautions(settings), *notes)
    sought = settings.support_z_mm is None and not settings.gravity
    height = balance if sought else None
    return _result(breast, view, stages, reached.plates, reached.state, height, notes)


class _CoarseBody:
    """A coarse body without weight, on which the height of the plates is sought.

    The solution at each height starts from the one before.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages = stages.without_weight()
        self._level = min(BALANCE_LEVEL, len(stages.bodies) - 1)
        self._before: _Reached | None = None

    def forces(self, plates: Plates) -> PlateForces | None:
        """Forces of plates at a place; None where the solver did not converge there."""
        state = None
        if _is_near(self._before, plates, WIDEST_COARSE_STEP):
            state = self._stages.settle(plates, self._before.state, self._level)
        if state is None or not (state.converged or state.interrupted):
            state = self._stages.compress(plates, self._level)
        if state.interrupted:
            raise KeyboardInterrupt
        reached = _Reached(state, plates)
        self._before = reached if reached.converged else None
        if not reached.converged:
            return None
        edge_mm = 2.0**self._level * float(self._stages.mesh.nodes.spacing_mm[0])
        return plate_forces(self._stages.contact(self._level, plates), state, edge_mm)

    def start(self, plates: Plates) -> State | None:
        """State of the next coarser body than the mesh, if it is known near a place of plates."""
        if self._level == 1 and _is_near(self._before, plates):
            return self._before.state
        return None


def _is_near(
    reached: _Reached | None, plates: Plates, widest: float = WIDEST_STEP
) -> TypeGuard[_Reached]:
    """Whether a state may be led to other plates in one go."""
    if reached is None:
        return False
    moves = (
        reached.plates.thickness_mm - plates.thickness_mm,
        reached.plates.centre_mm - plates.centre_mm,
    )
    return max(map(abs, moves)) < widest * plates.thickness_mm


def body_between_plates(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> BodyBetweenPlates:
    """The elements of a breast and where its plates go, before anything moves.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    settings : CompressionSettings
    lattice_shift : tuple of float
        As `compress_hyperelastic` takes it.
    """
    reach, fixed = held_tissue(settings, breast)
    mesh = elements_of(breast, view, settings, DOWN if settings.gravity else None, lattice_shift)
    edge = plate_edge_mm(settings, reach, fixed)
    plates, notes = place_plates(settings, breast, view, mesh.elements, edge)
    if settings.force_tolerance is not None:
        notes = (*notes, FORCE_TOLERANCE_IS_GONE)
    return BodyBetweenPlates(mesh, plates, (*mesh.elements.notes, *notes))


def _result(
    breast: BreastPhantom,
    view: View,
    stages: Stages,
    plates: Plates,
    state: State,
    height: BalancedHeight | None,
    notes: tuple[str, ...],
) -> CompressedBreast:
    mesh = stages.mesh
    measures = body_measures(mesh, stages.contact(0, plates), state)
    if height is not None:
        forces = PlateForces(measures["force_n"], measures["support_force_n"])
        measures["height_error_mm"] = abs(height.move_mm(plates, forces))
    if plates.panel is not None:
        measures["paddle_tilt_deg"] = plates.panel.tilt_deg
        measures["paddle_moment_nm"] = moment_nm(stages, plates, state)
    whole = measures["inverted_cells"] == 0.0
    if not whole:
        place = weakest_place(mesh, state, view.rotation)
        notes = (
            *notes,
            f"{view.folder}: {measures['inverted_cells']:.0f} elements are folded, the worst at "
            f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f}) mm",
        )
    if not state.converged and state.last.out_of_balance > 0.0:
        place = unbalanced_place(mesh, state, view.rotation)
        notes = (
            *notes,
            f"{view.folder}: the largest unbalanced force is at "
            f"({place[0]:.1f}, {place[1]:.1f}, {place[2]:.1f}) mm",
        )
    return CompressedBreast(
        breast, view, "hyperelastic", field_of(mesh, state, view),
        plates.support_z_mm, plates.paddle_z_mm, plates.edge_mm,
        state.converged and whole, measures, np.array(stages.rows, HISTORY), notes,
        state.interrupted, mesh.elements.modulus,
    )  # fmt: skip


def field_of(mesh: Mesh, state: State, view: View) -> DisplacementField:
    """Displacement of a state in mm, continued into the air around the tissue."""
    moved = continued(state.u, mesh.body.nodes, AIR_LAYERS, straight=1)
    moved[:, :WALL] = moved[:, WALL : WALL + 1]
    spacing = float(mesh.nodes.spacing_mm[0])
    return DisplacementField(
        mesh.nodes,
        np.ascontiguousarray(np.moveaxis(moved * spacing, 0, -1), dtype=np.float32),
        mesh.body.nodes,
        view.rotation,
    )


def _where_it_stopped(compressed: CompressedBreast, settings: CompressionSettings) -> str:
    measures = compressed.measures
    return (
        f"hyperelastic stopped at an estimated error of {measures['error_mm']:.3g} mm "
        f"(allowed {settings.tolerance_mm:g}), minimum J {measures['smallest_j']:.3g}, "
        f"after {compressed.history.size} steps; "
        + (compressed.notes[-1] if compressed.notes else "")
    )


def _seconds(settings: CompressionSettings, nodes: float) -> float:
    seconds = SECONDS_PER_COMPRESSION + nodes * SECONDS_PER_NODE
    return seconds * (FRICTION_REPEATS if settings.friction else 1.0)


def _quantities(compressed: CompressedBreast, settings: CompressionSettings) -> dict[str, float]:
    return {
        **contact_quantities(compressed, settings),
        "folded_elements": compressed.measures["inverted_cells"],
    }


def _cautions(settings: CompressionSettings) -> tuple[str, ...]:
    fat, gland = settings.moduli("adipose"), settings.moduli("gland")
    ratio = max(fat, gland) / min(fat, gland)
    return tuple(map(str, plausibility_warnings({"stiffness_ratio": ratio})))


HYPERELASTIC = MechanicalModel(
    compress_hyperelastic,
    method=lambda settings: "hyperelastic",
    where_it_stopped=_where_it_stopped,
    quantities=_quantities,
    cautions=_cautions,
    own_keys=(
        "gravity",
        "skin",
        "fibres",
        "fascia_kpa_per_mm",
        "friction",
        "tolerance_mm",
        "force_tolerance",
        "paddle",
    ),
    usual={"resolution_mm": 3.0, "stiffness": "aspiration"},
    chest_walls=("fascia", "fixed", "sliding"),
    frees_from_weight=True,
    bytes_per_node=BYTES_PER_NODE,
    seconds=_seconds,
)
