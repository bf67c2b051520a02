"""Finite elements of the hyperelastic model: laws of their energy, force and tangent."""

import numpy as np
import pytest

from mammosim.compression.hyperelastic._element_kernels import element_volumes
from mammosim.compression.hyperelastic.body import Body
from mammosim.compression.multigrid import (
    BlockLevel,
    Multigrid,
    ResidualBelow,
    Workspace,
    conjugate_gradients,
    hold,
)
from mammosim.compression.multigrid._bundle_kernels import block_residual
from mammosim.compression.multigrid.block_level import bundles_of

SHAPE = (8, 9, 11)


def some_body(shape=SHAPE, seed=0):
    """A block of elements of random moduli, nothing held."""
    rng = np.random.default_rng(seed)
    fraction = np.zeros(shape, np.float32)
    fraction[1:-2, 1:-2, 1:-2] = 1.0
    shear = (fraction * rng.uniform(1.0, 3.0, shape)).astype(np.float32)
    held = np.zeros((3, *shape), bool)
    return Body(fraction, shear, (50.0 * shear).astype(np.float32), held)


def some_displacement(body, size, seed=1):
    rng = np.random.default_rng(seed)
    return size * rng.standard_normal((3, *body.shear.shape)) * body.nodes


def affine(body, gradient):
    """Displacement of all nodes by a deformation gradient."""
    places = np.stack(np.meshgrid(*map(np.arange, body.shear.shape), indexing="ij"))
    return np.einsum("ij,jxyz->ixyz", np.asarray(gradient) - np.eye(3), places.astype(float))


def test_force_is_the_derivative_of_the_energy():
    body, step = some_body(), 1e-6
    u, direction = some_displacement(body, 0.1), some_displacement(body, 1.0, seed=2)
    ahead, behind = (body.energy_and_forces(u + s * direction)[0] for s in (step, -step))
    slope = (body.energy_and_forces(u)[2] * direction).sum()
    assert (ahead - behind) / (2 * step) == pytest.approx(slope, rel=1e-6)  # central difference


def test_force_is_the_derivative_where_elements_are_folded():
    body, step = some_body(), 1e-7
    u, direction = some_displacement(body, 0.5), some_displacement(body, 1.0, seed=2)
    energy, smallest, force = body.energy_and_forces(u)
    assert smallest < 0.0
    assert np.isfinite(energy)
    ahead, behind = (body.energy_and_forces(u + s * direction)[0] for s in (step, -step))
    assert (ahead - behind) / (2 * step) == pytest.approx((force * direction).sum(), rel=1e-5)


def tangent(body, u, geometric=1.0):
    nx, ny, nz = body.shear.shape
    stencil = np.zeros((nx, ny, 126, nz), np.float32)
    body.add_tangent(u, geometric, stencil)
    return stencil


def test_tangent_is_the_derivative_of_the_force():
    body, step = some_body(), 1e-6
    u, direction = some_displacement(body, 0.1), some_displacement(body, 1.0, seed=2)
    ahead, behind = (body.energy_and_forces(u + s * direction)[2] for s in (step, -step))
    expected = (ahead - behind) / (2 * step)
    out = np.zeros(u.shape, np.float32)
    moved = direction.astype(np.float32)
    stencil = bundles_of(tangent(body, u), body.node_span, Workspace())
    block_residual(stencil, moved, np.zeros_like(moved), out)
    # Single precision: 27 x 3 products of up to 1e3.
    np.testing.assert_allclose(-out, expected, atol=1e-6 * np.abs(expected).max() * 81)


@pytest.mark.parametrize("size", [0.1, 0.5])
def test_convex_part_of_the_tangent_is_positive_even_where_elements_are_folded(size):
    body = some_body()
    u, rng = some_displacement(body, size), np.random.default_rng(3)
    out = np.zeros(u.shape, np.float32)
    stencil = bundles_of(tangent(body, u, geometric=0.0), body.node_span, Workspace())
    for _ in range(20):
        direction = (rng.standard_normal(u.shape) * body.nodes).astype(np.float32)
        block_residual(stencil, direction, np.zeros_like(direction), out)
        assert -(direction * out).sum() > 0.0


def test_neither_translation_nor_rotation_costs_energy():
    body, angle = some_body(), 0.7
    turn = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    energy, smallest, force = body.energy_and_forces(affine(body, turn) + 3.0)
    scale = body.energy_and_forces(affine(body, np.diag([1.1, 1.0, 1.0])))[0]
    assert abs(energy) < 1e-9 * scale  # the seed of the cube root is refined to 1e-9
    assert smallest == pytest.approx(1.0)
    assert np.abs(force).max() < 1e-7 * scale


def test_internal_forces_sum_to_zero():
    body = some_body()
    force = body.energy_and_forces(some_displacement(body, 0.2))[2]
    assert np.abs(force.sum(axis=(1, 2, 3))).max() < 1e-12 * np.abs(force).sum()


def test_energy_of_an_affine_deformation_is_that_of_the_formula():
    body = some_body()
    gradient = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.2], [-0.1, 0.0, 0.85]])
    volume, invariant = np.linalg.det(gradient), (gradient**2).sum()
    shear, bulk = body.shear.astype(float).sum(), body.bulk.astype(float).sum()
    local = 5.0 * shear
    expected = 0.5 * shear * (volume ** (-2 / 3) * invariant - 3.0)
    expected += 0.5 * (bulk - local) * (volume - 1.0) ** 2
    expected += 0.5 * local * (volume - 1.0) ** 2 / volume
    energy = body.energy_and_forces(affine(body, gradient))[0]
    assert energy == pytest.approx(expected, rel=1e-7)


def test_patch_any_affine_deformation_is_in_equilibrium_inside():
    shape = SHAPE
    body = some_body(shape)
    even = Body(body.fraction, body.fraction * 2, body.fraction * 100, body.held)
    gradient = np.array([[1.3, 0.2, 0.0], [0.0, 0.8, 0.3], [-0.2, 0.0, 0.9]])
    force = even.energy_and_forces(affine(even, gradient))[2]
    inside = force[:, 2:-3, 2:-3, 2:-3]
    assert np.abs(inside).max() < 1e-7 * np.abs(force).max()


def test_volume_of_an_element_is_exact():
    """Against the Jacobian integrated with three points an axis, exact to degree five."""
    body = some_body((5, 5, 5))
    u = some_displacement(body, 0.15)
    volume, smallest = (np.ones(body.shear.shape) for _ in range(2))
    element_volumes(u, body.element_span, volume, smallest)
    corners = [u[:, 1 + a, 1 + b, 1 + c] + (a, b, c) for a, b, c in np.ndindex(2, 2, 2)]
    cell = np.stack(corners).reshape(2, 2, 2, 3)
    points, weights = np.polynomial.legendre.leggauss(3)
    total = 0.0
    for place in np.ndindex(3, 3, 3):
        x, y, z = 0.5 + 0.5 * points[list(place)]
        along_x = np.einsum("b,c,bcd->d", [1 - y, y], [1 - z, z], cell[1] - cell[0])
        along_y = np.einsum("a,c,acd->d", [1 - x, x], [1 - z, z], cell[:, 1] - cell[:, 0])
        along_z = np.einsum("a,b,abd->d", [1 - x, x], [1 - y, y], cell[:, :, 1] - cell[:, :, 0])
        jacobian = np.linalg.det(np.stack([along_x, along_y, along_z], axis=1))
        total += weights[list(place)].prod() / 8.0 * jacobian
    assert volume[1, 1, 1] == pytest.approx(total, rel=1e-12)  # both rules are exact


def test_multigrid_solves_the_tangent_of_a_near_incompressible_block():
    body = some_body((20, 22, 24))
    body.held[:, 1] = True
    u, rng = np.zeros((3, *body.shear.shape)), np.random.default_rng(4)
    stencil = tangent(body, u)
    hold(stencil, body.node_span, body.free, body.held_rows)
    level = BlockLevel.of(stencil, body.node_span, Workspace())
    load = (rng.standard_normal(u.shape) * body.free).astype(np.float32)
    solution, _, positive, cycles = conjugate_gradients(
        Multigrid(level, Workspace()), load.copy(), ResidualBelow(1e-4), 60
    )
    left = np.zeros_like(load)
    level.residual(solution, load, left)
    assert positive
    assert cycles < 40
    assert np.linalg.norm(left) < 1e-2 * np.linalg.norm(load)
