"""Kernels of the spring model against their definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from make_springs import half_ellipsoid, random_lattice
from naive import springs as naive

from mammosim.compression.multigrid import (
    ErrorBelow,
    Multigrid,
    ScalarLevel,
    Workspace,
    add_interpolated,
    conjugate_gradients,
    restrict,
)
from mammosim.compression.plates._straight_kernels import foremost
from mammosim.compression.springs import SpringProblem
from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs._relaxation_kernels import Springs, mark_nodes, sweep
from mammosim.compression.springs.levels import level_of


def lattice_level(modulus: np.ndarray, fixed: np.ndarray) -> ScalarLevel:
    return level_of(SpringProblem(modulus, fixed, -np.inf, np.inf, np.inf))


def stored(modulus: np.ndarray) -> np.ndarray:
    """Stiffness of each spring of a lattice, [13, x, y, z]."""
    stiffness = np.zeros((13, *modulus.shape), np.float32)
    lattice.spring_stiffness(modulus, stiffness)
    return stiffness


def forces(modulus: np.ndarray, displacement: np.ndarray, springs=None) -> np.ndarray:
    """Net force on every tissue node by the compiled kernels, [component, x, y, z]."""
    springs = modulus if springs is None else springs
    span = SpringProblem(modulus, modulus > 1e9, 0, 0, 0).span()
    everyone = (modulus > 0).astype(np.float32)
    stretch = np.zeros(modulus.shape)
    lattice.cell_stretch(modulus, displacement[2], stretch)
    loads = np.zeros_like(displacement)
    lattice.stretch_loads(springs, span, stretch, loads[0], loads[1])
    out = np.zeros_like(displacement)
    for axis in range(3):
        lattice.lattice_residual(
            springs, span, everyone, displacement[axis], loads[axis], out[axis]
        )
    return out


@pytest.mark.parametrize("seed", [0, 1])
def test_net_forces_are_those_of_the_definition(seed):
    modulus = random_lattice(seed)
    displacement = np.random.default_rng(seed).normal(0.0, 0.3, (3, *modulus.shape))
    places = np.indices(modulus.shape) + displacement
    ours = forces(modulus, displacement)
    for n in map(tuple, np.argwhere(modulus > 0)):
        expected = naive.net_force(modulus, places, n)
        # Double precision, sums of 26 terms of size 10.
        np.testing.assert_allclose(ours[(slice(None), *n)], expected, atol=1e-10)


def test_stored_springs_pull_as_those_of_the_moduli():
    modulus = random_lattice(2)
    displacement = np.random.default_rng(2).normal(0.0, 0.3, (3, *modulus.shape))
    # Double precision, the sums of 26 terms of size 10 taken in another order.
    np.testing.assert_allclose(
        forces(modulus, displacement, stored(modulus)), forces(modulus, displacement), atol=1e-10
    )


def test_levels_of_stored_springs_are_those_of_the_moduli():
    problem = half_ellipsoid((9, 12, 11))
    levels = [level_of(problem)]
    levels.append(level_of(replace(problem, stiffness=stored(problem.modulus))))
    np.testing.assert_array_equal(levels[0].diagonal, levels[1].diagonal)
    np.testing.assert_array_equal(*(level.coarsened().operator.stencil for level in levels))
    load = np.random.default_rng(2).normal(size=problem.modulus.shape).astype(np.float32)
    steps = []
    for level in levels:
        u, step, out = load.copy(), np.zeros_like(load), np.zeros_like(load)
        level.smooth(u, load, np.float32(0.0), np.float32(0.5), step, out)
        steps.append(out)
    # Single precision, sums of 26 terms in another order, over the diagonal.
    np.testing.assert_allclose(steps[0], steps[1], atol=1e-5)


def test_both_ends_of_a_spring_see_the_same_length():
    modulus = random_lattice(3, (4, 4, 4))
    z = np.indices(modulus.shape)[2] + np.random.default_rng(3).normal(0, 0.3, modulus.shape)
    for n in map(tuple, np.argwhere(modulus > 0)):
        for offset in naive.NEIGHBOURS:
            m = tuple(np.add(n, offset))
            if modulus[m] > 0:
                there = naive.equilibrium_length(modulus, z, n, offset)
                back = naive.equilibrium_length(modulus, z, m, tuple(-np.array(offset)))
                np.testing.assert_allclose(there, -back, atol=1e-14)


def test_internal_forces_sum_to_zero():
    modulus = random_lattice(4, (8, 9, 10))
    displacement = np.random.default_rng(4).normal(0.0, 0.5, (3, *modulus.shape))
    total = forces(modulus, displacement).sum(axis=(1, 2, 3))
    # 500 nodes x 26 springs x 45 kPa x double rounding.
    np.testing.assert_allclose(total, 0.0, atol=1e-8)


def test_a_lattice_at_rest_bears_no_force():
    modulus = random_lattice(5)
    assert not forces(modulus, np.zeros((3, *modulus.shape))).any()


def test_a_node_from_behind_the_edge_is_stopped_by_the_rounded_end():
    plates = half_ellipsoid().plates._replace(lower=-4.0, upper=5.0, edge=10.0, radius=3.0)
    beyond = np.linspace(1e-6, 2.999, 7)
    for face, side in ((plates.upper, 1), (plates.lower, -1)):
        x = np.array([foremost(face + side * step, plates) for step in beyond])
        # On the quarter circle about (edge + 3, face + 3).
        np.testing.assert_allclose(np.hypot(13.0 - x, 3.0 - beyond), 3.0)
        assert (x <= 13.0).all()
        assert foremost(face + 8.0 * side, plates) == 10.0
        assert foremost(face, plates) == np.inf


@pytest.mark.parametrize("stiffening", [False, True])
def test_sweep_is_that_of_the_definition(stiffening):
    problem = replace(half_ellipsoid((5, 8, 7), gap=0.6), edge=2.5, edge_radius=1.5)
    rng = np.random.default_rng(6)
    enl = np.where(problem.modulus > 5.0, 10.0, 7.5).astype(np.float32) if stiffening else None
    force = (None, rng.normal(size=problem.modulus.shape), np.full(problem.modulus.shape, -0.3))
    orders = tuple(rng.permutation(np.arange(1, n - 1)) for n in problem.modulus.shape)
    places = np.indices(problem.modulus.shape, dtype=np.float64)
    places += np.where(problem.tissue, rng.normal(0.0, 0.1, places.shape), 0.0)
    x, y, z = (place.copy() for place in places)
    plates, sums = problem.plates, np.zeros(4)
    visited = np.zeros(problem.modulus.shape, np.uint8)
    mark_nodes(problem.modulus, problem.fixed, visited)
    assert set(np.unique(visited)) == {0, 1, 2}
    sweep(Springs(problem.modulus, enl, force, visited), x, y, z, orders, plates, 1.0, sums)
    expected = naive.sweep(problem, places, orders, enl, force)
    np.testing.assert_allclose(sums, expected, rtol=1e-12)
    np.testing.assert_allclose([x, y, z], places, atol=1e-12)


@pytest.mark.parametrize("fine", [0, 1])
def test_coarse_operator_is_the_galerkin_product(fine):
    problem = half_ellipsoid((19, 22, 25))
    levels = Multigrid(lattice_level(problem.modulus, problem.fixed), Workspace()).levels
    level, coarse = levels[fine], levels[fine + 1]
    rng = np.random.default_rng(7)
    v = rng.normal(size=coarse.diagonal.shape).astype(np.float32) * coarse.free
    up = np.zeros_like(level.diagonal)
    add_interpolated(v, level.span, level.free, up)
    residual, down, direct = np.zeros_like(up), np.zeros_like(v), np.zeros_like(v)
    level.residual(up, np.zeros_like(up), residual)
    restrict(residual, down)
    coarse.residual(v, np.zeros_like(v), direct)
    # Single precision.
    np.testing.assert_allclose(down, direct, atol=2e-5 * np.abs(direct).max())


def test_restriction_is_the_transpose_of_interpolation():
    problem = half_ellipsoid((9, 12, 11))
    levels = Multigrid(lattice_level(problem.modulus, problem.fixed), Workspace()).levels
    fine = levels[0]
    rng = np.random.default_rng(8)
    residual = rng.normal(size=fine.free.shape).astype(np.float32) * fine.free
    shape = tuple((n - 2) // 2 + 3 for n in fine.free.shape)
    v = rng.normal(size=shape).astype(np.float32)
    v[[0, -1]] = v[:, [0, -1]] = v[:, :, [0, -1]] = 0.0
    up, down = np.zeros_like(residual), np.zeros_like(v)
    add_interpolated(v, fine.span, fine.free, up)
    restrict(residual, down)
    assert np.vdot(up, residual) == pytest.approx(np.vdot(v, down), rel=1e-4)


def test_conjugate_gradients_solve_what_a_dense_solver_solves():
    modulus = random_lattice(9, (7, 8, 9))
    modulus[1, 1:-1, 1:-1] = 15.0
    fixed = np.zeros(modulus.shape, bool)
    fixed[1] = modulus[1] > 0
    from mammosim.compression.connectivity import held_together

    modulus[~held_together(modulus > 0, fixed)] = 0.0
    level = lattice_level(modulus, fixed)
    nodes = np.flatnonzero(level.free)
    matrix = np.zeros((nodes.size, nodes.size))
    unit, out = np.zeros_like(modulus), np.zeros_like(modulus)
    for column, node in enumerate(nodes):
        unit.reshape(-1)[node] = -1.0
        level.residual(unit, np.zeros_like(modulus), out)
        matrix[:, column] = out.reshape(-1)[nodes]
        unit.reshape(-1)[node] = 0.0
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-5)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    load = np.zeros_like(modulus)
    load.reshape(-1)[nodes] = np.random.default_rng(9).normal(size=nodes.size)
    expected = np.linalg.solve(matrix, load.reshape(-1)[nodes])
    stop = ErrorBelow(1e-6, 0.0)
    solved = conjugate_gradients(Multigrid(level, Workspace()), load.copy(), stop, 60)
    assert solved.positive
    assert solved.measure <= 1e-6
    # Single precision and a condition number of about 100.
    np.testing.assert_allclose(solved.correction.reshape(-1)[nodes], expected, atol=2e-5)
