"""Clock position and depth below the skin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.projection import phantom
from naive.targets import nearest_air_mm

from mammosim.targets.anatomy import clock_position, skin_depth_mm


@pytest.mark.parametrize(
    ("y", "z", "hour"),
    [
        (0, 10, "12:00"), (10, 0, "3:00"), (0, -10, "6:00"), (-10, 0, "9:00"),
        (10, 10, "1:30"), (-10, 10, "10:30"), (10, -10, "4:30"), (-10, -10, "7:30"),
        (2.7, 10, "12:30"), (-2.7, 10, "11:30"), (1, 10, "12:00"), (-1, 10, "12:00"),
    ],
)  # fmt: skip
def test_hours_as_seen_facing_the_patient(y, z, hour):
    assert clock_position([30.0, 5.0 + y, -7.0 + z], [80.0, 5.0, -7.0]) == hour


def test_straight_behind_the_nipple_is_twelve():
    assert clock_position([30.0, 0.0, 0.0], [80.0, 0.0, 0.0]) == "12:00"


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_skin_depth_equals_a_search_of_all_voxels(seed):
    rng = np.random.default_rng(seed)
    labels = (rng.random((14, 16, 12)) < 0.995).astype(np.uint8)
    labels[: rng.integers(0, 3)] = 0  # air behind the chest wall
    breast = phantom(labels, [0.7, 1.0, 1.3], rng.normal(size=3))
    point = breast.frame.position_mm(rng.uniform([3.0, 0.0, 0.0], [13.0, 15.0, 11.0]))
    wall = np.flatnonzero(breast.labels.any(axis=(1, 2)))[0]
    expected = nearest_air_mm(labels, wall, breast.frame.index(point), breast.voxel_mm)
    assert skin_depth_mm(breast, point) == pytest.approx(expected, abs=1e-9)


def test_depth_is_not_taken_through_the_chest_wall():
    labels = np.zeros((40, 41, 41), dtype=np.uint8)
    labels[5:35] = 1
    labels[:, :3] = labels[:, -3:] = 0
    breast = phantom(labels, 1.0, [0.5, -20.0, -20.0])
    # 3 mm before the chest wall, 17.5 mm from the sides, 20.5 from the array's other faces.
    assert skin_depth_mm(breast, [8.0, 0.0, 0.0]) == pytest.approx(17.5)
    assert skin_depth_mm(breast, [33.0, 0.0, 0.0]) == pytest.approx(2.0)
    assert skin_depth_mm(breast, [39.0, 0.0, 0.0]) == 0.0
    assert skin_depth_mm(breast, [60.0, 0.0, 0.0]) == 0.0
