"""The `springs` model of a phantom: lattice, plates, equilibrium, displacement field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mammosim._interruption import hold_interruptions
from mammosim._wording import counted
from mammosim.compression.breast import CompressedBreast
from mammosim.compression.continuation import continued
from mammosim.compression.credibility import contact_quantities
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.force_control import settled
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
from mammosim.compression.spring_case import SpringCase, make_case
from mammosim.compression.springs import SpringProblem, SpringState, relax, solve
from mammosim.compression.springs.equilibrium import HISTORY
from mammosim.compression.springs.measures import plate_forces, spring_measures
from mammosim.compression.springs.resolution import coarsened
from mammosim.compression.thesis_units import in_millimetres
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom

Watch = Callable[[np.void], None]

AIR_LAYERS = 3
"""Of lattice nodes around the tissue that move with it."""

BYTES_PER_NODE = 150.0
"""Of the lattice's box: displacement and force in double, multigrid in single precision."""

SECONDS_PER_NODE = {"multigrid": 6e-6, "relaxation": 2e-3}
"""Of one compression on two cores (measured with benchmarks/pipeline.py)."""

STIFFENS_TOO_MUCH = (
    "compression.spring_law: exponential, with the thesis' constants, gives unrealistically high "
    "forces at an ordinary thickness: use linear, or model: hyperelastic"
)

BALANCE_NODES = 20_000
"""Tissue nodes of the coarse lattice on which the plates' height is sought, at most."""

BALANCE_TOLERANCE = 0.02
"""Of its equilibrium, its own lattice units."""

SAMPLE_TOLERANCE = 0.01
"""Of a sample's equilibrium, lattice units: a hundredth of what samples of a 1 mm lattice differ
by."""


def _by_multigrid(
    problem: SpringProblem,
    settings: CompressionSettings,
    seed: int,
    start: SpringState | None,
    watch: Watch | None,
) -> SpringState:
    return solve(problem, settings.tolerance_voxel, start, watch)


def _by_relaxation(
    problem: SpringProblem,
    settings: CompressionSettings,
    seed: int,
    start: SpringState | None,
    watch: Watch | None,
) -> SpringState:
    limit = settings.relaxation_limit_voxel
    return relax(problem, limit, settings.max_sweeps, seed, start, watch)


SPRING_SOLVERS = {"multigrid": _by_multigrid, "relaxation": _by_relaxation}
"""Solvers of the spring model by the name a configuration gives them."""


def compress_springs(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
    lattice_shift: tuple[float, float] = (0.0, 0.0),
) -> CompressedBreast:
    """Compress a breast as a lattice of springs.

    Parameters
    ----------
    breast : BreastPhantom
    view : View
    settings : CompressionSettings
    seed : int
        Of the visiting order of `relaxation`.
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
    Nodes, not the fine surface, are bounded by the plates: up to half a node spacing of a finer
    phantom may stand out beyond a plate's face. The model loses some volume under strong
    compression and may fold cells near the plates' edge; both are measured, not hidden.
    """
    settings = in_millimetres(settings, breast, view)
    reach, muscle_fixed = held_tissue(settings, breast)
    case = make_case(breast, view, settings, reach, muscle_fixed, lattice_shift)
    edge = plate_edge_mm(settings, reach, muscle_fixed)
    plates, notes = place_plates(settings, breast, view, case.lattice, edge)

    def equilibrium(plates: Plates, start: SpringState | None) -> tuple[SpringState, PlateForces]:
        problem = case.problem(plates)
        state = SPRING_SOLVERS[settings.solver](problem, settings, seed, start, watch)
        return state, plate_forces(problem, state, case.spacing_mm)

    bottom, top = case.lattice.height_mm

    def at_rest() -> tuple[Plates, SpringState]:
        opened = replace(plates, support_z_mm=bottom, paddle_z_mm=top)
        return opened, _at_rest(case)

    plates, state = settled(
        plates, settings, top - bottom, _balanced_height(case, edge), equilibrium, at_rest
    )
    hold_interruptions()
    return _result(
        breast, view, case, plates, state, (*_cautions(settings), *case.lattice.notes, *notes)
    )


def _balanced_height(case: SpringCase, edge_mm: float) -> BalancedHeight:
    weightless = all(force is None for force in case.force)
    heights = heights_beyond_edge_mm(case.lattice, edge_mm)
    return BalancedHeight(_coarse_forces(case), *heights, weightless)


def _coarse_forces(case: SpringCase) -> Callable[[Plates], PlateForces | None]:
    """``forces(plates)`` on a coarse lattice without weight, which is solved anew each time."""

    def forces(plates: Plates) -> PlateForces | None:
        problem, spacing = replace(case.problem(plates), force=(None, None, None)), case.spacing_mm
        while np.count_nonzero(problem.modulus) > BALANCE_NODES:
            problem, spacing = coarsened(problem), 2.0 * spacing
        state = solve(problem, BALANCE_TOLERANCE)
        if state.interrupted:
            raise KeyboardInterrupt
        return plate_forces(problem, state, spacing) if state.converged else None

    return forces


def _at_rest(case: SpringCase) -> SpringState:
    """The lattice before anything moves."""
    x, y, z = (np.zeros(case.lattice.modulus.shape) for _ in range(3))
    return SpringState((x, y, z), False, np.inf, np.zeros(0, HISTORY))


def _result(
    breast: BreastPhantom,
    view: View,
    case: SpringCase,
    plates: Plates,
    state: SpringState,
    notes: tuple[str, ...],
) -> CompressedBreast:
    measures = spring_measures(case.problem(plates), state, case.spacing_mm)
    field = displacement_field(view, case, state)
    return CompressedBreast(
        breast, view, "springs", field, plates.support_z_mm, plates.paddle_z_mm, plates.edge_mm,
        state.converged, measures, state.history, notes, state.interrupted, case.lattice.modulus,
    )  # fmt: skip


def displacement_field(view: View, case: SpringCase, state: SpringState) -> DisplacementField:
    """The nodes' displacement in mm, continued into the air around the tissue."""
    lattice, spacing = case.lattice, case.spacing_mm
    moved = np.stack(state.displacement).astype(np.float32) * np.float32(spacing)
    moved = continued(moved, lattice.tissue, AIR_LAYERS)
    moved[:, : case.chest + 1] = 0.0  # air beside the chest wall stays with it
    return DisplacementField(
        lattice.frame, np.ascontiguousarray(np.moveaxis(moved, 0, -1)), lattice.tissue,
        view.rotation,
    )  # fmt: skip


def _where_it_stopped(compressed: CompressedBreast, settings: CompressionSettings) -> str:
    return (
        f"{settings.solver} stopped at an estimated error of "
        f"{compressed.measures['error_voxel']:.3g} lattice units after "
        f"{counted(compressed.history.size, 'iteration')}"
    )


def _quantities(compressed: CompressedBreast, settings: CompressionSettings) -> dict[str, float]:
    return {
        **contact_quantities(compressed, settings),
        "springs_volume_loss_percent": compressed.measures["volume_change_percent"],
        "springs_folded_percent": _folded_percent(compressed),
    }


def _folded_percent(compressed: CompressedBreast) -> float:
    measures = compressed.measures
    return 100.0 * measures["inverted_cells"] / max(measures["cells"], 1.0)


def _foreseen(coarse: CompressedBreast, settings: CompressionSettings) -> dict[str, float]:
    """Folded cells of a finer lattice: their share grows as the spacing falls.

    Tissue between the plates' edge and the chest wall is sheared so that layers pass through each
    other, the more the nearer to the edge. From 3 mm to 1 mm the share grew by factors of 2.3 to
    6.6 (median 3.6) in eight generated breasts, to 2 mm by 1.2 to 2.7 (2.0): about as the inverse
    of the spacing.
    """
    spacing_mm = float(coarse.field.frame.spacing_mm[0])
    finer = max(1.0, spacing_mm / settings.resolution_mm)
    return {"springs_folded_percent": _folded_percent(coarse) * finer}


def _cautions(settings: CompressionSettings) -> tuple[str, ...]:
    return (STIFFENS_TOO_MUCH,) if settings.spring_law == "exponential" else ()


SPRINGS = MechanicalModel(
    compress_springs,
    method=lambda settings: f"springs, {settings.solver}",
    where_it_stopped=_where_it_stopped,
    quantities=_quantities,
    cautions=_cautions,
    foreseen=_foreseen,
    keeps_volume=False,
    own_keys=(
        "solver",
        "spring_law",
        "gravity",
        "chest_wall_mm",
        "plates_voxel",
        "tolerance_voxel",
        "relaxation_limit_voxel",
        "max_sweeps",
    ),
    chest_walls=("fixed",),
    bytes_per_node=BYTES_PER_NODE,
    seconds=lambda settings, nodes: nodes * SECONDS_PER_NODE[settings.solver],
    sample_keys={"solver": "multigrid", "tolerance_voxel": SAMPLE_TOLERANCE},
    references=("springs",),
)
