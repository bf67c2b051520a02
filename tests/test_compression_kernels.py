"""Kernels that both mechanical models share: lattice, continuation into air, inverse."""

from __future__ import annotations

import numpy as np
import pytest
from naive import compression as naive
from scipy.ndimage import map_coordinates

from mammosim.compression._continuation_kernels import continue_one_layer, extrapolate_one_layer
from mammosim.compression._inverse_kernels import (
    KUHN_TETRAHEDRA,
    places_before,
    rasterise_inverse,
    refine_inverse,
    shifts_back,
)
from mammosim.compression._lattice_kernels import gather_blocks, tissue_outline


@pytest.mark.parametrize("samples", [2, 3])
def test_blocks_of_a_turned_lattice(samples):
    rng = np.random.default_rng(1)
    labels = rng.integers(0, 4, (6, 7, 5)).astype(np.uint8)
    modulus_of = np.zeros(256, np.float32)
    modulus_of[1:4] = 1.0, 5.0, 15.0
    muscle_of = np.zeros(256, bool)
    muscle_of[3] = True
    turn = 1.7 * np.eye(3)
    turn[1:, 1:] = 1.7 * np.linalg.qr(rng.standard_normal((2, 2)))[0]
    to_voxel = np.column_stack([turn, [2.0, 3.0, 2.5]])
    shape = (4, 3, 5)
    found = np.zeros((3, *shape), np.float32)
    gather_blocks(labels, modulus_of, muscle_of, to_voxel, samples, *found)
    expected = naive.blocks(labels, modulus_of, muscle_of, to_voxel, samples, shape)
    assert 0 < (expected[0] == 0).sum() < expected[0].size
    np.testing.assert_allclose(found, expected, rtol=1e-6)  # float32


def test_outline_is_where_any_voxel_along_x_is_tissue():
    rng = np.random.default_rng(2)
    labels = (rng.integers(0, 5, (5, 6, 7)) * (rng.random((5, 6, 7)) < 0.2)).astype(np.uint8)
    outline = np.zeros((6, 7), bool)
    tissue_outline(labels, outline)
    np.testing.assert_array_equal(outline, (labels != 0).any(axis=0))


@pytest.mark.parametrize(
    ("kernel", "twin"),
    [(continue_one_layer, naive.one_layer), (extrapolate_one_layer, naive.one_straight_layer)],
)
def test_one_layer_of_air_around_tissue(kernel, twin):
    rng = np.random.default_rng(3)
    known = rng.random((5, 6, 4)) < 0.3
    field = np.where(known, rng.standard_normal((2, 5, 6, 4)), 0.0)
    expected, then = twin(field, known)
    layer = known.astype(np.int32)
    kernel(field, layer, 2)
    np.testing.assert_array_equal(layer > 0, then)
    np.testing.assert_allclose(field, expected, atol=1e-14)  # sums of 26 terms in another order


@pytest.mark.parametrize(("largest", "per_cell"), [(0.0, 1), (0.3, 1), (0.3, 2), (1.5, 1)])
def test_inverse_of_a_small_lattice(largest, per_cell):
    """At rest, bent, also on a finer grid, and so far displaced that cells fold over each other."""
    rng = np.random.default_rng(4)
    nodes = 5 - per_cell  # few: the twin tries every cell at each of the grid's points
    depth = rng.integers(-1, 4, (nodes,) * 3).clip(0).astype(np.int8)
    displacement = rng.uniform(-largest, largest, (nodes, nodes, nodes, 3))
    shift, shape = np.full(3, -1.0 * per_cell), ((nodes + 2) * per_cell,) * 3
    places, rank = np.full((3, *shape), np.nan), np.zeros(shape, np.int8)
    original = np.moveaxis(places, 0, -1)
    rasterise_inverse(displacement, depth, float(per_cell), shift, KUHN_TETRAHEDRA, places, rank)
    covered = 0
    for index in np.ndindex(*shape):
        point = (np.array(index) + shift) / per_cell
        expected = naive.place_at_rest(displacement, depth, point)
        assert (rank[index] > 0) == (expected is not None)
        if expected is None:
            continue
        covered += 1
        if largest > 1.0:  # folded: tetrahedra of one cell may cover a point twice
            moved = expected_images(displacement, original[index])
            np.testing.assert_allclose(moved, point, atol=1e-6)
        else:
            np.testing.assert_allclose(original[index], expected, atol=1e-9)
    assert covered > 20


def test_a_fold_of_the_surface_leaves_what_lies_deeper_alone():
    """A corner of the surface is pushed through its cell and on, and so turns tetrahedra over; its
    neighbours are drawn into the depth without turning any."""
    depth = np.full((4, 4, 6), 3, np.int8)
    depth[:, :, 0], depth[:, :, 1] = 1, 2
    displacement = np.zeros((4, 4, 6, 3))
    displacement[1, 1, 0, 2] = 3.4
    displacement[2, 2, 0, 2], displacement[2, 2, 1, 2] = 2.9, 3.3
    shift, shape = np.full(3, -1.0), (14, 14, 22)
    places, rank = np.full((3, *shape), np.nan), np.zeros(shape, np.int8)
    original = np.moveaxis(places, 0, -1)
    rasterise_inverse(displacement, depth, 4.0, shift, KUHN_TETRAHEDRA, places, rank)
    points = np.stack(np.indices(shape) - 1.0, axis=-1) / 4.0
    unmoved = (rank > 0) & (points[..., 2] > 2.0)
    assert unmoved.sum() > 1500
    np.testing.assert_allclose(original[unmoved], points[unmoved], atol=1e-9)


def test_a_finer_inverse_is_the_trilinear_fields():
    """Each point of it comes from a place that the field brings there; Kuhn's tetrahedra miss by
    more."""
    rng = np.random.default_rng(6)
    depth = np.ones((3, 3, 3), np.int8)
    displacement = rng.uniform(-0.2, 0.2, (3, 3, 3, 3))
    shift, shape = np.full(3, -4.0), (14, 14, 14)
    places, rank = np.full((3, *shape), np.nan), np.zeros(shape, np.int8)
    original = np.moveaxis(places, 0, -1)
    rasterise_inverse(displacement, depth, 3.0, shift, KUHN_TETRAHEDRA, places, rank)
    covered = np.argwhere(rank > 0)
    points = (covered + shift) / 3.0

    def misses() -> np.ndarray:
        found = original[rank > 0]
        moved = [map_coordinates(displacement[..., d], found.T, order=1, mode="nearest")
                 for d in range(3)]  # fmt: skip
        return np.linalg.norm(found + np.transpose(moved) - points, axis=1)

    before = misses()
    refine_inverse(displacement, 3.0, shift, rank, places)
    assert len(points) > 100
    assert before.max() > 0.02
    assert np.quantile(misses(), 0.95) < 1e-3
    assert (misses() <= before + 1e-12).all()


def expected_images(displacement, place):
    """Where a place of the lattice at rest goes, linear in the tetrahedron that it lies in."""
    low = np.minimum(np.floor(place + 1e-12).astype(int), np.array(displacement.shape[:3]) - 2)
    part = place - low
    order = np.argsort(-part, kind="stable")
    corner, weights = low.copy(), [1.0, *part[order], 0.0]
    moved = np.zeros(3)
    for n in range(4):
        moved += (weights[n] - weights[n + 1]) * (corner + displacement[tuple(corner)])
        if n < 3:
            corner = corner + np.eye(3, dtype=int)[order[n]]
    return moved


def test_places_before_are_the_points_and_their_shifts_back():
    rng = np.random.default_rng(7)
    shape, per_cell, shift = (4, 3, 5), 2.0, np.array([-2.0, 1.0, -3.0])
    origin, spacing = np.array([5.0, -7.0, 1.0]), np.array([3.0, 2.0, 1.5])
    points = (np.stack(np.indices(shape), axis=-1) + shift) / per_cell
    original, rank = rng.random((*shape, 3)), rng.integers(0, 3, shape).astype(np.int8)
    back = np.moveaxis(original, -1, 0).copy()
    shifts_back(back, rank, per_cell, shift)
    expected = np.where((rank > 0)[..., None], original - points, 0.0)
    np.testing.assert_allclose(np.moveaxis(back, 0, -1), expected, atol=1e-14)
    found = np.empty((*shape, 3), np.float32)
    places_before(back, rank.astype(np.int32), per_cell, shift, origin, spacing, found)
    places = np.where((rank > 0)[..., None], origin + original * spacing, np.nan)
    np.testing.assert_allclose(found, places, rtol=1e-6)  # float32
