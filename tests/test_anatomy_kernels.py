"""Kernels of the generated breast against their twins."""

from __future__ import annotations

import numpy as np
import pytest
from naive import phantom as naive
from scipy import ndimage

from mammosim.phantom import GenerateSettings
from mammosim.phantom.anatomy import _kernels, _noise_kernels, _tube_kernels, generate
from mammosim.tissues import TISSUES

LABEL = {name: tissue.label for name, tissue in TISSUES.items()}


def test_noise_agrees_with_its_twin():
    points = np.random.default_rng(1).uniform(-40.0, 40.0, (50, 3))
    for point in points:
        assert _noise_kernels.gradient_noise(*point, 77) == pytest.approx(
            naive.gradient_noise(point, 77), abs=1e-10
        )


def test_noise_is_zero_at_lattice_points_and_of_unit_variance():
    for point in np.random.default_rng(2).integers(-30, 30, (20, 3)).astype(float):
        assert _noise_kernels.gradient_noise(*point, 3) == 0.0
    points = np.random.default_rng(3).uniform(-200.0, 200.0, (4000, 3))
    values = np.array([_noise_kernels.gradient_noise(*point, 3) for point in points])
    # 4000 nearly independent values: the mean is known to 0.016, the variance to 3 % or so.
    assert abs(values.mean()) < 0.06
    assert values.var() == pytest.approx(1.0, abs=0.12)


def test_lobules_agree_with_their_twin():
    rng = np.random.default_rng(4)
    seeds = np.empty((5, 5, 5, 4), np.float32)
    seeds[..., :3], seeds[..., 3] = rng.uniform(0.12, 0.88, (5, 5, 5, 3)), rng.random((5, 5, 5))
    origin = np.array([1.0, 2.0, 3.0])
    points = (np.stack(np.indices((5, 5, 5)), axis=-1) + seeds[..., :3]).reshape(-1, 3)
    for place in rng.uniform(1.5, 3.5, (60, 3)):
        found = _noise_kernels.lobules(seeds, origin, 10.0, *(place * 10.0 + origin))
        pull, wall = naive.lobules(points.astype(float), seeds[..., 3].ravel(), place)
        assert found[0] == pytest.approx(pull, abs=1e-6)
        # The second nearest is sought in the 27 cells around, which holds nearly always.
        assert found[1] == pytest.approx(10.0 * wall, abs=1e-4)


def test_tubes_agree_with_their_twin():
    axis = np.arange(12) * 0.5
    lattice = _kernels.Lattice(axis, axis, axis, np.zeros(3), 2.0)
    ends = np.array([[[0.7, 1.0, 1.2], [4.0, 4.4, 3.1]], [[2.0, 4.5, 1.0], [2.0, 4.5, 1.0]]])
    radius, label = np.array([[0.1, 0.9], [0.8, 0.8]]), np.array([125, 95], np.uint8)
    labels = np.zeros((12, 12, 12), np.uint8)
    _tube_kernels.paint_tubes(labels, lattice, ends, radius, label)
    for index in np.ndindex(labels.shape):
        point, wanted = np.array(index) * 0.5, 0
        for piece in range(2):
            if naive.in_cone(point, *ends[piece], radius[piece]) or naive.on_axis(
                point, *ends[piece], 0.5
            ):
                wanted = label[piece]
        assert labels[index] == wanted


def test_gland_is_where_the_full_potential_exceeds_the_threshold():
    """The kernel stops adding noise where it no longer matters; the sampler never does."""
    settings = GenerateSettings(voxel_mm=2.5, volume_ml=300.0, density="c")
    shape, field, lobule, duct, vessel = np.random.default_rng(5).spawn(5)
    anatomy = generate._anatomy(settings, shape, field, duct, vessel)
    lattice = generate._lattice(anatomy, settings.voxel_mm)
    texture = generate._texture(anatomy, 5, lobule)
    size = (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size)
    labels, potential, state = (np.zeros(size, kind) for kind in (np.uint8, np.float32, np.uint8))
    paint = generate._paint(anatomy)._replace(threshold=0.7)
    _kernels.sample_potential(labels, lattice, texture, paint, 1, potential, state)
    _kernels.paint_tissue(labels, lattice, texture, paint)
    # Where the skin's dither does not reach.
    inside = np.isin(state, [_kernels.FAT_OR_GLAND, _kernels.WALL_OR_GLAND])
    inside &= ndimage.binary_erosion(inside, iterations=2)
    near = np.abs(potential - 0.7) < 1e-6  # single precision
    assert inside.sum() > 3000
    assert 0.1 < (labels[inside] == LABEL["gland"]).mean() < 0.9
    np.testing.assert_array_equal(
        (labels == LABEL["gland"])[inside & ~near], (potential > 0.7)[inside & ~near]
    )


def test_the_nipple_is_a_cylinder_with_a_dome():
    nipple = np.array([50.0, 7.0, 5.0])
    assert _kernels.nipple_distance(52.0, 0.0, 0.0, nipple) < 0.0
    assert _kernels.nipple_distance(57.0, 0.0, 0.0, nipple) == pytest.approx(0.0, abs=1e-12)
    assert _kernels.nipple_distance(50.0, 5.0, 0.0, nipple) == pytest.approx(0.0, abs=1e-12)
    assert _kernels.nipple_distance(50.0, 8.0, 0.0, nipple) == pytest.approx(3.0)
    assert _kernels.nipple_distance(56.9, 4.0, 0.0, nipple) > 0.0
