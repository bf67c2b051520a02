"""The same spring problem at half the resolution, and its solution brought back."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.connectivity import held_together
from mammosim.compression.continuation import continued
from mammosim.compression.multigrid import (
    add_interpolated,
    coarse_shape,
    restrict,
    whole_rows,
)
from mammosim.compression.springs.problem import SpringProblem

Displacement = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def coarsened(problem: SpringProblem) -> SpringProblem:
    """The problem on every second node, with the mean modulus (and Enl) of the tissue around each.

    Nodes that would hang on nothing are left out. Springs whose stiffness is given become those of
    the nodes' moduli: what is found here only is a start.
    """
    shape = coarse_shape(problem.modulus.shape)
    total, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    restrict(problem.modulus, total)
    restrict(problem.tissue.astype(np.float32), weight)
    here = tuple(slice(1, 2 * (n - 2), 2) for n in shape)
    tissue, fixed = np.zeros(shape, bool), np.zeros(shape, bool)
    for target, source in ((tissue, problem.tissue), (fixed, problem.fixed)):
        part = source[here]
        target[tuple(slice(1, 1 + n) for n in part.shape)] = part
    tissue &= held_together(tissue, fixed)
    modulus = np.divide(total, weight, out=np.zeros(shape, np.float32), where=tissue)
    stiffening = None
    if problem.stiffening is not None:
        stiffening = np.zeros(shape, np.float32)
        restrict(problem.stiffening, stiffening)
        np.divide(stiffening, weight, out=stiffening, where=tissue)
        stiffening[~tissue] = 0.0
    force_x, force_y, force_z = problem.force
    return SpringProblem(
        modulus,
        fixed & tissue,
        (problem.lower + 1.0) / 2.0,
        (problem.upper + 1.0) / 2.0,
        (problem.edge + 1.0) / 2.0,
        (_gathered(force_x, tissue), _gathered(force_y, tissue), _gathered(force_z, tissue)),
        edge_radius=problem.edge_radius / 2.0,
        stiffening=stiffening,
        chest=(problem.chest + 1.0) / 2.0,
    )


def _gathered(
    force: NDArray[np.float32] | None, tissue: NDArray[np.bool_]
) -> NDArray[np.float32] | None:
    """Force on coarse nodes: the sum around each, over 4 since forces scale with h^2 u."""
    if force is None:
        return None
    total = np.zeros(tissue.shape, np.float32)
    restrict(force, total)
    return np.where(tissue, np.float32(0.25) * total, np.float32(0.0))


def interpolated(
    coarse: Displacement, coarse_tissue: NDArray[np.bool_], fine: SpringProblem
) -> Displacement:
    """Displacement of a coarse lattice brought to the lattice of `fine`, in its units."""
    field = continued(np.stack(coarse), coarse_tissue, 2)
    free = (fine.tissue & ~fine.fixed).astype(np.float32)
    span = fine.span()
    result = []
    for component in field:
        u = np.zeros(fine.modulus.shape)
        add_interpolated(2.0 * component, span, free, u)
        result.append(u)
    return (result[0], result[1], result[2])


def with_whole_rows(problem: SpringProblem) -> SpringProblem:
    """The same problem on arrays with room for whole vectors along z, which kernels like."""
    shape = problem.modulus.shape
    missing = whole_rows(shape)[2] - shape[2]
    if missing == 0:
        return problem
    force_x, force_y, force_z = (_lengthened(force, missing) for force in problem.force)
    return replace(
        problem,
        modulus=lengthened(problem.modulus, missing),
        fixed=lengthened(problem.fixed, missing),
        force=(force_x, force_y, force_z),
        stiffness=_lengthened(problem.stiffness, missing),
    )


def lengthened(a: NDArray[Any], missing: int) -> NDArray[Any]:
    """An array with more zeros along z."""
    return np.pad(a, [(0, 0)] * (a.ndim - 1) + [(0, missing)])


def _lengthened(a: NDArray[Any] | None, missing: int) -> NDArray[Any] | None:
    return None if a is None else lengthened(a, missing)
