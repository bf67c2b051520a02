"""The `springs` model of a phantom: lattice, plates, equilibrium, displacement field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mammosim.compression.breast import CompressedBreast
from mammosim.compression.continuation import continued
from mammosim.compression.displacement import DisplacementField
from mammosim.compression.lattice import (
    Lattice,
    breast_volume_ml,
    build_lattice,
    tissue_front,
)
from mammosim.compression.plates import Plates, muscle_is_fixed, place_plates, plate_edge_mm
from mammosim.compression.settings import CompressionSettings
from mammosim.compression.springs import SpringProblem, SpringState, relax, solve
from mammosim.compression.springs.measures import spring_measures
from mammosim.compression.springs.problem import CHEST_WALL_INDEX
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom

AIR_LAYERS = 3
"""Of lattice nodes around the tissue that move with it."""

FORCE_TOLERANCE = 0.01
"""Relative, of the force that a thickness is sought for."""

SMALLEST_GAP = 0.3
"""Of the breast's height: the thinnest that is tried when a thickness for a force is sought."""


@dataclass(frozen=True, eq=False)
class _Case:
    """A lattice with its boundary conditions, ready for any place of the plates."""

    lattice: Lattice
    fixed: np.ndarray
    settings: CompressionSettings
    seed: int
    watch: Callable[[np.void], None] | None

    def problem(self, plates: Plates) -> SpringProblem:
        """The spring problem in lattice units."""
        frame = self.lattice.frame
        heights = np.array([[0.0, 0.0, plates.support_z_mm], [0.0, 0.0, plates.paddle_z_mm]])
        lower, upper = frame.index(heights)[:, 2]
        # A point is moved by nodes up to one spacing behind it: where those behind the edge were
        # free, tissue just beyond it would stand out through the plates.
        edge = float((plates.edge_mm - frame.origin_mm[0]) / frame.spacing_mm[0]) - 1.0
        return SpringProblem(self.lattice.modulus, self.fixed, float(lower), float(upper), edge)

    def solve(self, plates: Plates, start: SpringState | None = None) -> SpringState:
        """Equilibrium by the solver that the settings name."""
        return SPRING_SOLVERS[self.settings.solver](self, self.problem(plates), start)


def _by_multigrid(case: _Case, problem: SpringProblem, start: SpringState | None) -> SpringState:
    return solve(problem, case.settings.tolerance_voxel, start, case.watch)


def _by_relaxation(case: _Case, problem: SpringProblem, start: SpringState | None) -> SpringState:
    limit, sweeps = case.settings.relaxation_limit_voxel, case.settings.max_sweeps
    return relax(problem, limit, sweeps, case.seed, start, case.watch)


SPRING_SOLVERS = {"multigrid": _by_multigrid, "relaxation": _by_relaxation}
"""Solvers of the spring model by the name a configuration gives them."""


def compress_springs(
    breast: BreastPhantom,
    view: View,
    settings: CompressionSettings,
    seed: int = 1,
    watch: Callable[[np.void], None] | None = None,
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
    lattice = build_lattice(breast, view, settings.resolution_mm, settings.stiffness)
    reach = tissue_front(breast)
    muscle_fixed = muscle_is_fixed(settings, reach)
    fixed = np.zeros(lattice.modulus.shape, bool)
    fixed[CHEST_WALL_INDEX] = lattice.tissue[CHEST_WALL_INDEX]
    if muscle_fixed:
        fixed |= lattice.muscle
    edge = plate_edge_mm(settings, reach, muscle_fixed)
    plates, notes = place_plates(settings, lattice, edge, view.name, breast_volume_ml(breast))
    case = _Case(lattice, fixed, settings, seed, watch)
    if settings.force_n is not None:
        plates, state = _reach_force(case, plates, settings.force_n)
    else:
        state = case.solve(plates)
    return _result(breast, view, case, plates, state, (*lattice.notes, *notes))


def _result(
    breast: BreastPhantom,
    view: View,
    case: _Case,
    plates: Plates,
    state: SpringState,
    notes: tuple[str, ...],
) -> CompressedBreast:
    lattice, spacing = case.lattice, float(case.lattice.frame.spacing_mm[0])
    measures = spring_measures(case.problem(plates), state, spacing)
    moved = np.stack(state.displacement).astype(np.float32) * np.float32(spacing)
    moved = continued(moved, lattice.tissue, AIR_LAYERS)
    moved[:, : CHEST_WALL_INDEX + 1] = 0.0  # air beside the chest wall stays with it
    field = DisplacementField(
        lattice.frame, np.ascontiguousarray(np.moveaxis(moved, 0, -1)), lattice.tissue,
        view.rotation,
    )  # fmt: skip
    return CompressedBreast(
        breast, view, "springs", field, plates.support_z_mm, plates.paddle_z_mm, plates.edge_mm,
        state.converged, measures, state.history, notes, state.interrupted,
    )  # fmt: skip


def _reach_force(case: _Case, widest: Plates, wanted_n: float) -> tuple[Plates, SpringState]:
    """Plates' place at which the paddle bears a force, by a bracketing secant in the thickness."""
    bottom, top = case.lattice.height_mm
    middle, height = 0.5 * (bottom + top), top - bottom

    def at(thickness: float, start: SpringState | None) -> tuple[Plates, SpringState, float]:
        plates = replace(
            widest, support_z_mm=middle - 0.5 * thickness, paddle_z_mm=middle + 0.5 * thickness
        )
        state = case.solve(plates, start)
        spacing = float(case.lattice.frame.spacing_mm[0])
        return plates, state, spring_measures(case.problem(plates), state, spacing)["force_n"]

    thin, wide = SMALLEST_GAP * height, height
    plates, state, force = at(thin, None)
    if force < wanted_n:
        raise InputError(
            f"compression.force_n: found {wanted_n:g} N, but these springs carry at most "
            f"{force:.3g} N, at a thickness of {thin:.1f} mm; must be smaller"
        )
    force_thin, force_wide = force, 0.0
    while abs(force - wanted_n) > FORCE_TOLERANCE * wanted_n and wide - thin > 1e-3:
        share = (force_thin - wanted_n) / (force_thin - force_wide)
        thickness = thin + min(max(share, 0.15), 0.85) * (wide - thin)
        plates, state, force = at(thickness, state)
        if force > wanted_n:
            thin, force_thin = thickness, force
        else:
            wide, force_wide = thickness, force
    return plates, state
