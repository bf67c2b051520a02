"""What a compressed spring lattice shows: force, contact, volume, folded cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.plate_balance import PlateForces
from mammosim.compression.springs._measure_kernels import (
    cell_volumes,
    held_columns,
    touching_area,
)
from mammosim.compression.springs.exponential import strained
from mammosim.compression.springs.levels import level_of
from mammosim.compression.springs.problem import SpringProblem, SpringState
from mammosim.compression.springs.resolution import Displacement

TOUCH_VOXEL = 1e-6
"""A node this near a plate's face touches it, lattice units."""

SPRINGS_ABOVE = 9
"""Springs from a node to the layer above it: a lattice stretched along z has modulus 9 w in the
bulk, so a spring of tissue modulus E carries E / 9."""


def spring_measures(
    problem: SpringProblem, state: SpringState, spacing_mm: float
) -> dict[str, float]:
    """Force, contact, volume and inverted cells of a state.

    Parameters
    ----------
    problem : SpringProblem
    state : SpringState
    spacing_mm : float
        Node spacing, mm.

    Returns
    -------
    dict
        `force_n` (on the paddle) and `support_force_n`; `contact_area_mm2` and
        `support_contact_area_mm2`; `pressure_kpa` (mean over the paddle's area); `volume_before_ml`
        and `volume_after_ml` of the lattice's tissue cells, their `volume_ratio` and
        `volume_change_percent` (the thesis' DVol, positive for a loss); `inverted_cells` (the
        thesis' Bugs) of `cells`; `error_voxel`, the solver's estimate of what is left.

    Notes
    -----
    A spring carries (E/9) h Delta mN for E in kPa, h and Delta in mm.
    """
    contact = _contact(problem, state)
    forces = _forces(*contact, spacing_mm)
    ux, uy, _ = state.displacement
    measures = {}
    for side, plate, newton in ((1, "", forces.paddle_n), (-1, "support_", forces.support_n)):
        place = np.zeros((*contact[0].shape[:2], 2))
        touching = np.zeros(contact[0].shape[:2], bool)
        held_columns(contact[0], ux, uy, side, place, touching)
        measures[f"{plate}force_n"] = newton
        measures[f"{plate}contact_area_mm2"] = touching_area(place, touching) * spacing_mm**2
    area = measures["contact_area_mm2"]
    measures["pressure_kpa"] = 1e3 * measures["force_n"] / area if area > 0.0 else 0.0
    measures.update(volume_measures(problem, state, spacing_mm))
    measures["error_voxel"] = state.error
    return measures


def plate_forces(problem: SpringProblem, state: SpringState, spacing_mm: float) -> PlateForces:
    """Forces on paddle and support of a state; see `spring_measures`."""
    return _forces(*_contact(problem, state), spacing_mm)


def _forces(
    contact: NDArray[np.int8], force: NDArray[np.float32], spacing_mm: float
) -> PlateForces:
    newton = spacing_mm**2 / SPRINGS_ABOVE * 1e-3
    paddle, support = (float(np.abs(force[contact == side]).sum()) * newton for side in (1, -1))
    return PlateForces(paddle, support)


def volume_measures(
    problem: SpringProblem, state: SpringState, spacing_mm: float
) -> dict[str, float]:
    """Volume and inverted cells of a state; see `spring_measures`."""
    cells, volume, inverted = cell_totals(problem, state.displacement)
    ratio = volume / cells if cells else 1.0
    return {
        "volume_before_ml": cells * spacing_mm**3 * 1e-3,
        "volume_after_ml": volume * spacing_mm**3 * 1e-3,
        "volume_ratio": ratio,
        "volume_change_percent": 100.0 * (1.0 - ratio),
        "inverted_cells": inverted,
        "cells": cells,
    }


def cell_totals(problem: SpringProblem, displacement: Displacement) -> tuple[float, float, float]:
    """Number of cells of eight tissue nodes, their volume in lattice units, and those inverted."""
    layers = np.zeros((problem.modulus.shape[0], 3))
    cell_volumes(problem.modulus, *displacement, layers)
    cells, volume, inverted = (float(total) for total in layers.sum(axis=0))
    return cells, volume, inverted


def _contact(
    problem: SpringProblem, state: SpringState
) -> tuple[NDArray[np.int8], NDArray[np.float32]]:
    """Which plate holds each node, and the other forces on it along z, kPa x lattice units."""
    uz = state.displacement[2]
    force = np.zeros(uz.shape, np.float32)
    if problem.stiffening is not None:
        problem = strained(problem, state.displacement)
    level_of(problem).residual(uz, problem.force[2], force)
    z = np.arange(uz.shape[2]) + uz
    between = np.arange(uz.shape[0])[:, None, None] > problem.edge
    contact = np.zeros(uz.shape, np.int8)
    contact[between & (z >= problem.upper - TOUCH_VOXEL) & (force > 0.0)] = 1
    contact[between & (z <= problem.lower + TOUCH_VOXEL) & (force < 0.0)] = -1
    return contact, force
