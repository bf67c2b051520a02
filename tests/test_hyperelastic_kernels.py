"""Kernels of elements, laws, contact and block stencils against their slow twins."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from naive import hyperelastic as naive

from mammosim.compression.hyperelastic import _contact_kernels as contact
from mammosim.compression.hyperelastic._element_kernels import (
    ElementRule,
    element_volumes,
    energy_and_forces,
)
from mammosim.compression.hyperelastic._tangent_kernels import tangent_stencil
from mammosim.compression.hyperelastic.laws import LAWS
from mammosim.compression.multigrid import (
    Workspace,
    add_interpolated,
    coarse_shape,
    restrict,
    row_spans,
)
from mammosim.compression.multigrid import _block_kernels as blocks
from mammosim.compression.multigrid._bundle_kernels import WINDOW, block_residual, block_smooth
from mammosim.compression.multigrid.block_level import bundles_of
from mammosim.compression.plates._straight_kernels import StraightPlate

SHAPE = (4, 5, 5)
RULE = ElementRule(1 / 24, 5.0, 0.1)


def elements():
    """Random moduli of the elements of an uneven body with one layer around; 0 where none is."""
    rng = np.random.default_rng(0)
    some = np.zeros(SHAPE, bool)
    some[1:-2, 1:-2, 1:-2] = True
    some[1, 1, 1] = False
    shear = np.where(some, rng.uniform(1.0, 3.0, SHAPE), 0.0).astype(np.float32)
    return shear, (30.0 * shear).astype(np.float32), row_spans(some)


def displacement(size):
    return size * np.random.default_rng(1).standard_normal((3, *SHAPE))


@pytest.mark.parametrize("size", [0.1, 0.6])
@pytest.mark.parametrize("name", LAWS)
def test_energy_and_forces_are_those_of_the_definition(name, size):
    shear, bulk, span = elements()
    u, force, layers = displacement(size), np.zeros((3, *SHAPE)), np.zeros((SHAPE[0] - 1, 2))
    law = LAWS[name](RULE.least_volume)
    energy_and_forces(u, shear, bulk, span, RULE, law, force, layers)
    energy, least, expected = naive.body_energy_and_forces(u, shear, bulk, RULE, naive.LAWS[name])
    assert (least < 0.0) == (size > 0.5)  # the second is folded
    # The cube root is good to 1e-9.
    assert layers[:, 0].sum() == pytest.approx(energy, rel=1e-8)
    np.testing.assert_allclose(force, expected, atol=1e-7 * np.abs(expected).max())
    assert layers[:, 1].min() == pytest.approx(least)


@pytest.mark.parametrize("name", LAWS)
def test_tangent_is_that_of_the_definition(name):
    shear, bulk, span = elements()
    u, stencil = displacement(0.1), np.zeros((*SHAPE[:2], 126, SHAPE[2]), np.float32)
    tangent_stencil(u, shear, bulk, span, RULE, LAWS[name](RULE.least_volume), 1.0, stencil)
    expected = naive.body_tangent(u, shear, bulk, RULE, naive.LAWS[name])
    # Single precision, sums over eight elements of nine points.
    np.testing.assert_allclose(
        naive.dense(stencil), expected, atol=72 * 1e-7 * np.abs(expected).max()
    )


def test_volumes_are_those_of_the_definition():
    shear, _, span = elements()
    u, volume, smallest = displacement(0.2), np.ones(SHAPE), np.ones(SHAPE)
    element_volumes(u, span, volume, smallest)
    for cell in map(tuple, np.argwhere(shear > 0)):
        _, mean, least = naive.element_energy(
            naive.element_nodes(u, cell), 1.0, 1.0, RULE, naive.neo_hookean
        )
        assert volume[cell] == pytest.approx(mean, rel=1e-12)  # rounding
        assert smallest[cell] == pytest.approx(least, rel=1e-12)


# --- block stencils ---------------------------------------------------------------------------


def random_stencil(shape=SHAPE):
    """A positive definite stencil of random blocks, nothing outside the layers around."""
    rng = np.random.default_rng(2)
    nx, ny, nz = shape
    stencil = np.zeros((nx, ny, 126, nz), np.float32)
    inside = np.zeros(shape, bool)
    inside[1:-1, 1:-1, 1:-1] = True
    for n in map(tuple, np.argwhere(inside)):
        for o, offset in enumerate(naive.OFFSETS):
            if inside[tuple(np.add(n, offset))]:
                block = rng.uniform(-1.0, 1.0, (3, 3))
                block = block + block.T + 90.0 * np.eye(3) if o == 0 else block
                stencil[n[0], n[1], 9 * o : 9 * o + 9, n[2]] = block.ravel()
    return stencil, row_spans(inside)


def random_vector(shape=SHAPE, seed=3):
    vector = np.zeros((3, *shape), np.float32)
    inside = vector[:, 1:-1, 1:-1, 1:-1]
    inside[...] = np.random.default_rng(seed).standard_normal(inside.shape)
    return vector


def packed(inverses):
    """Six entries of symmetric 3 x 3 matrices [x, y, z, 3, 3] as kernels store them."""
    rows, columns = np.triu_indices(3)
    return np.moveaxis(inverses[..., rows, columns], -1, 2).astype(np.float32)


def test_residual_smoothing_and_scaling_are_those_of_the_matrix():
    stencil, span = random_stencil()
    u, load, out = random_vector(), random_vector(seed=4), np.zeros((3, *SHAPE), np.float32)
    matrix = naive.dense(stencil)
    residual = (load.ravel() - matrix @ u.ravel()).reshape(u.shape)
    bundles = bundles_of(stencil, span, Workspace())
    block_residual(bundles, u, load, out)
    np.testing.assert_allclose(out, residual, atol=1e-4)  # single precision, sums of 81 of size 90
    inverse = np.zeros((*SHAPE[:2], 6, SHAPE[2]), np.float32)
    blocks.invert_blocks(stencil, span, inverse)
    own = np.moveaxis(stencil[:, :, :9], 2, -1).reshape(*SHAPE, 3, 3).astype(float)
    inverses = np.zeros(own.shape)
    for n in np.ndindex(*SHAPE):
        inverses[n] = naive.inverse_block(own[n])
    np.testing.assert_allclose(inverse, packed(inverses), atol=1e-7)  # single precision of 0.01
    keep, gain = np.float32(0.3), np.float32(0.7)
    step = random_vector(seed=5)
    expected = keep * step + gain * np.einsum("xyzrc,cxyz->rxyz", inverses, residual)
    block_smooth(bundles, inverse, u, load, keep, gain, step, out)
    np.testing.assert_allclose(step, expected, atol=1e-5)  # single precision
    np.testing.assert_allclose(out, u + expected, atol=1e-5)
    blocks.block_scaled(inverse, span, load, gain, out)
    expected = gain * np.einsum("xyzrc,cxyz->rxyz", inverses, load)
    np.testing.assert_allclose(out, expected, atol=1e-7)


def test_rows_longer_than_the_buffer_of_the_product():
    length, rng = WINDOW + 40, np.random.default_rng(6)
    shape = (3, 4, length)
    span = np.zeros((*shape[:2], 2), np.int32)
    span[1, 1], span[1, 2] = (1, length - 1), (9, length - 5)  # their bundles begin elsewhere
    stencil = np.zeros((*shape[:2], 126, length), np.float32)
    blocks_of_a_node = rng.standard_normal((*shape[:2], 126))
    for i, j in ((1, 1), (1, 2)):
        inside = slice(*span[i, j])
        stencil[i, j, :, inside] = blocks_of_a_node[i, j, :, None]
    u = np.repeat(rng.standard_normal((3, *shape[:2], 1)), length, axis=3).astype(np.float32)
    out = np.zeros_like(u)
    block_residual(bundles_of(stencil, span, Workspace()), u, np.zeros_like(u), out)
    short = 30  # away from the ends nothing depends on the place along the row
    matrix = naive.dense(stencil[..., :short])
    expected = -(matrix @ u[..., :short].ravel()).reshape(3, *shape[:2], short)[:, 1, 1:3, 20]
    inner = out[:, 1, 1:3, 11 : length - 7]
    np.testing.assert_allclose(
        inner, np.repeat(expected[..., None], inner.shape[-1], axis=-1), atol=1e-4
    )  # single precision, sums of 81


def test_blocks_that_are_not_definite_or_partly_empty_are_inverted_as_defined():
    stencil, span = random_stencil()
    stencil[1, 1, :9, 1] = np.array([[1.0, 3.0, 0.5], [3.0, 1.0, 0.2], [0.5, 0.2, 2.0]]).ravel()
    stencil[1, 2, :9, 1] = np.diag([2.0, 0.0, 4.0]).ravel()
    inverse = np.zeros((*SHAPE[:2], 6, SHAPE[2]), np.float32)
    blocks.invert_blocks(stencil, span, inverse)
    for node in ((1, 1, 1), (1, 2, 1)):
        block = stencil[node[0], node[1], :9, node[2]].reshape(3, 3).astype(float)
        expected = naive.inverse_block(block)[np.triu_indices(3)]
        np.testing.assert_allclose(inverse[node[0], node[1], :, node[2]], expected, atol=1e-7)


def test_held_displacements_leave_neither_row_nor_column():
    stencil, span = random_stencil()
    free = (np.random.default_rng(6).uniform(size=(3, *SHAPE)) > 0.3).astype(np.float32)
    free[:, 1] = 1.0
    expected = naive.dense(stencil) * np.outer(free.ravel(), free.ravel())
    blocks.hold(stencil, span, free, (free == 0.0).any(axis=(0, 3)))
    np.testing.assert_array_equal(naive.dense(stencil), expected)


def test_dense_matrix_is_that_among_the_numbered_displacements():
    stencil, _ = random_stencil()
    moving = np.flatnonzero(random_vector())[::3]
    number = np.full(3 * np.prod(SHAPE), -1)
    number[moving] = np.arange(moving.size)
    out = np.zeros((moving.size, moving.size))
    blocks.dense_matrix(stencil, number.reshape(3, *SHAPE), out)
    np.testing.assert_array_equal(out, naive.dense(stencil)[np.ix_(moving, moving)])


def test_transfers_and_coarse_operator_are_those_of_the_interpolation():
    shape = (5, 6, 7)
    stencil, span = random_stencil(shape)
    coarse = coarse_shape(shape)
    weight = naive.interpolation(shape, coarse)
    fine, low = random_vector(shape), random_vector(coarse, seed=7)
    out, down = np.zeros((3, *shape), np.float32), np.zeros((3, *coarse), np.float32)
    restrict(fine, down)
    add_interpolated(low, span, np.ones_like(fine), out)
    for d in range(3):
        # Single precision, sums of 27.
        np.testing.assert_allclose(down[d].ravel(), weight.T @ fine[d].ravel(), atol=1e-5)
        np.testing.assert_allclose(out[d].ravel(), weight @ low[d].ravel(), atol=1e-6)
    whole = np.kron(np.eye(3), weight)
    expected = whole.T @ naive.dense(stencil) @ whole
    product = np.zeros((*coarse[:2], 126, coarse[2]), np.float32)
    blocks.galerkin_of_blocks(stencil, span, product)
    np.testing.assert_allclose(
        naive.dense(product), expected, atol=27 * 1e-7 * np.abs(expected).max()
    )


# --- contact ----------------------------------------------------------------------------------


def test_surface_points_are_those_of_the_definition():
    grid = np.indices((7, 8, 9))
    away = np.sqrt(
        (((grid - np.array([2.6, 3.7, 4.2]).reshape(3, 1, 1, 1)) / 2.4) ** 2).sum(axis=0)
    )
    fraction = np.clip(1.6 - away, 0.0, 1.0).astype(np.float32)
    layers = np.zeros(7, np.int64)
    contact.count_crossings(fraction, layers)
    samples = np.where(np.arange(7) > 2, contact.SAMPLES, 1)
    expected = naive.surface_points(fraction, samples, contact.SAMPLES)
    count = int(layers @ samples)
    assert count == len(expected[0])
    cells, local = np.zeros((count, 3), np.int32), np.zeros((count, 3))
    area, normal = np.zeros(count), np.zeros((count, 3))
    contact.surface_points(fraction, samples, cells, local, area, normal)
    np.testing.assert_array_equal(cells, expected[0])
    for found, wanted in zip((local, area, normal), expected[1:], strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-5)  # fractions in single precision


def points():
    """Some points in elements, and displacements of the nodes."""
    rng = np.random.default_rng(8)
    cells = rng.integers(0, np.array(SHAPE) - 1, (12, 3)).astype(np.int32)
    return cells, rng.uniform(-0.3, 1.3, (12, 3)), rng.uniform(0.2, 1.0, 12), displacement(0.2)


def nodes_of_points(cells):
    """Index of the eight nodes of each point's element, [n, 8, 3]."""
    return cells[:, None, :] + np.array(naive.CORNERS)[None]


def test_points_move_with_their_elements():
    cells, local, _, u = points()
    out = np.zeros((12, 3))
    contact.place_points(u, cells, local, out)
    moved = u[:, *np.moveaxis(nodes_of_points(cells), -1, 0)]
    expected = cells + local + np.einsum("nk,dnk->nd", naive.weights(local), moved)
    np.testing.assert_allclose(out, expected, atol=1e-12)  # rounding


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_depth_and_normal_are_those_of_the_signed_distance(side):
    plate = StraightPlate(1.5, side, -0.5, 0.8)
    places = np.random.default_rng(9).uniform(-3.0, 5.0, (400, 3))
    depth, normal = np.zeros(400), np.zeros((400, 3))
    contact.plate_depth(places, plate, depth, normal)
    distance = np.array([naive.straight_distance(plate, *place) for place in places])
    assert (distance < 0).any()
    assert (distance > 0).any()
    np.testing.assert_allclose(depth, -distance, atol=1e-12)
    expected = [naive.normal(naive.straight_distance, plate, place) for place in places]
    np.testing.assert_allclose(normal, expected, atol=1e-6)  # central differences


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_contact_blocks_are_the_second_derivative_of_the_contact_energy(side):
    plate, stiffness = StraightPlate(1.5, side, -0.5, 0.8), 7.0
    places = np.random.default_rng(9).uniform(-3.0, 3.0, (60, 3))
    places[:20] = (-0.5, 0.0, 1.5) + 0.8 * np.abs(places[:20] / 3.0) * (1.0, 1.0, side)

    def energy(place):
        return 0.5 * stiffness * min(naive.straight_distance(plate, *place), 0.0) ** 2

    blocks, flat = np.zeros((60, 6)), np.zeros((60, 6))
    contact.add_contact_blocks(places, plate, stiffness, 1.0, blocks)
    contact.add_contact_blocks(places, plate, stiffness, 0.0, flat)
    step, unit = 1e-4, np.eye(3)
    pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    for place, block in zip(places, blocks, strict=True):
        expected = [
            sum(
                a * b * energy(place + step * (a * unit[i] + b * unit[j]))
                for a, b in product((1, -1), repeat=2)
            )
            / (4.0 * step**2)
            for i, j in pairs
        ]
        np.testing.assert_allclose(block, expected, rtol=1e-4, atol=1e-5)  # of differences
    assert (blocks != flat).any()  # the rounded edge is there
    whole = flat[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    assert np.linalg.eigvalsh(whole).min() > -1e-12  # without its curvature nothing is negative


def test_forces_and_stiffness_of_the_contact_are_those_of_the_definition():
    cells, local, area, _ = points()
    rng = np.random.default_rng(10)
    pressure = np.where(rng.uniform(size=(2, 12)) > 0.4, rng.uniform(size=(2, 12)), 0.0)
    push = rng.standard_normal((2, 12, 3))
    push /= np.linalg.norm(push, axis=2, keepdims=True)
    force, matrix = np.zeros((3, *SHAPE)), np.zeros((3 * np.prod(SHAPE),) * 2)
    number, weights = np.arange(3 * np.prod(SHAPE)).reshape(3, *SHAPE), naive.weights(local)
    for n in range(12):
        at = number[:, *nodes_of_points(cells)[n].T]  # [3, 8]
        for plate in range(2):
            along = np.outer(push[plate, n], weights[n]).ravel()
            np.subtract.at(force.reshape(-1), at.ravel(), area[n] * pressure[plate, n] * along)
            if pressure[plate, n] > 0.0:
                matrix[np.ix_(at.ravel(), at.ravel())] += 7.0 * area[n] * np.outer(along, along)
    out = np.zeros_like(force)
    contact.add_contact_forces(pressure, push, area, cells, local, out)
    np.testing.assert_allclose(out, force, atol=1e-12)  # rounding
    stencil = np.zeros((*SHAPE[:2], 126, SHAPE[2]), np.float32)
    both = np.where(pressure > 0.0, 7.0, 0.0)
    x, y, z = np.moveaxis(push, 2, 0)
    pairs = (x * x, x * y, x * z, y * y, y * z, z * z)
    blocks = np.stack([(both * pair).sum(axis=0) for pair in pairs], axis=1)
    contact.add_contact_stiffness(blocks, area, cells, local, stencil)
    # Single precision.
    np.testing.assert_allclose(naive.dense(stencil), matrix, atol=1e-6 * np.abs(matrix).max())
