"""The search for the nearest air against its twin."""

from __future__ import annotations

import numpy as np
import pytest
from naive import targets as naive

from mammosim.targets._nearest_air_kernels import _outwards, nearest_air_mm


@pytest.mark.parametrize("seed", range(12))
def test_nearest_air_is_that_of_a_search_of_all_voxels(seed):
    """Few and many air voxels, points in tissue, in air, on faces and in the array's corners."""
    rng = np.random.default_rng(seed)
    labels = (rng.random((8, 9, 7)) < (0.995 if seed % 2 else 0.8)).astype(np.uint8)
    first_x = int(rng.integers(0, 3))
    labels[:first_x] = 0  # behind the chest wall
    spacing = np.array([0.7, 1.0, 1.3])
    places = rng.uniform([first_x, 0.0, 0.0], [7.4, 8.4, 6.4], (20, 3))
    places[:5] = np.rint(places[:5]) + 0.5  # on the faces between voxels
    places[5:8] = np.rint(places[5:8])
    for place in places:
        found = nearest_air_mm(labels, first_x, place, spacing)
        # A sum of three squares in another order.
        assert found == pytest.approx(
            naive.nearest_air_mm(labels, first_x, place, spacing), abs=1e-9
        )


def test_without_air_inside_the_nearest_is_beyond_the_array():
    labels = np.ones((5, 6, 7), np.uint8)
    # 2.5 voxels to the far face of x, 3.5 behind; the chest wall's face does not count.
    found = nearest_air_mm(labels, 0, np.array([1.0, 2.5, 3.0]), np.array([1.0, 9.0, 9.0]))
    assert found == pytest.approx(3.5)


@pytest.mark.parametrize("at", [0.0, 2.0, 1.3, -0.4, 2.5, -1.5, 4.4999])
def test_voxels_are_visited_from_the_point_outwards(at):
    found = [_outwards(at, turn, 0.8) for turn in range(9)]
    expected = naive.outwards(at, 9, 0.8)
    np.testing.assert_allclose([gap for _, gap in found], [gap for _, gap in expected], atol=1e-12)
    assert found[0][0] == expected[0][0]
    # At half a voxel two are equally near, and either may be the last one.
    assert {voxel for voxel, _ in found[:-1]} <= {voxel for voxel, _ in naive.outwards(at, 10, 0.8)}
    assert len({voxel for voxel, _ in found}) == 9
