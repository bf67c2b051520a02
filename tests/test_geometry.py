"""Frames, views and the gantry."""

from __future__ import annotations

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.geometry import Gantry, View, VoxelFrame, compression_from_breast


@pytest.mark.parametrize("laterality", ["L", "R"])
@pytest.mark.parametrize("angle", [0.0, 45.0, 60.0, 90.0])
def test_rotations_are_proper_and_keep_x(laterality, angle):
    rotation = compression_from_breast(angle, laterality)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_array_equal(rotation[0], [1, 0, 0])


def test_mlo_turns_superomedial_to_the_paddle_and_superolateral_to_the_top():
    for laterality, medial in (("L", -1.0), ("R", 1.0)):
        rotation = View("MLO", laterality).rotation
        np.testing.assert_allclose(rotation @ [0, medial, 1], [0, 0, np.sqrt(2)], atol=1e-15)
        lateral = rotation @ [0, -medial, 1]
        np.testing.assert_allclose(lateral, [0, -medial * np.sqrt(2), 0], atol=1e-15)


@pytest.mark.parametrize("laterality", ["L", "R"])
def test_turns_are_those_of_the_rotation_and_undo_each_other(laterality):
    view = View("MLO", laterality, 52.0)
    points = np.random.default_rng(0).normal(0, 30, (4, 5, 3))
    turned = view.compression_from_breast(points)
    np.testing.assert_array_equal(turned, points @ view.rotation.T)
    np.testing.assert_allclose(turned[1, 2], view.rotation @ points[1, 2], atol=1e-12)
    np.testing.assert_allclose(view.breast_from_compression(turned), points, atol=1e-12)


@pytest.mark.parametrize(
    ("view", "message"),
    [(("XCC", "L"), "view: found 'XCC'"), (("CC", "left"), "laterality: found 'left'")],
)
def test_unknown_views_are_refused(view, message):
    with pytest.raises(InputError, match=message):
        View(*view)


def gantry(laterality: str, view: str = "CC") -> Gantry:
    return Gantry(View(view, laterality), 7.0, -20.0, 650.0, 15.0, 0.0, 0.1, 2400, 1800, -120.0)


@pytest.mark.parametrize("laterality", ["L", "R"])
@pytest.mark.parametrize("view", ["CC", "MLO"])
def test_gantry_and_breast_frames_are_inverse(laterality, view):
    points = np.random.default_rng(0).normal(0, 30, (20, 3))
    frame = gantry(laterality, view)
    back = frame.breast_from_gantry(frame.gantry_from_breast(points))
    np.testing.assert_allclose(back, points, atol=1e-12)


def test_pixels_of_the_two_breasts_are_turned_by_half_a_turn():
    left, right = gantry("L"), gantry("R")
    point = np.array([30.0, 50.0, 0.0])
    row, column = left.project(point)
    turned = right.project(point)
    np.testing.assert_allclose([row + turned[0], column + turned[1]], [2399, 1799])
    # Left: lateral (+y) up, chest wall left. Right: lateral (-y) up, chest wall right.
    assert left.project([1.0, 40.0, 0.0])[0] < left.project([1.0, -40.0, 0.0])[0]
    assert right.project([1.0, -40.0, 0.0])[0] < right.project([1.0, 40.0, 0.0])[0]
    assert left.project([1.0, 0.0, 0.0])[1] < 20
    assert right.project([1.0, 0.0, 0.0])[1] > 1779


@pytest.mark.parametrize("laterality", ["L", "R"])
def test_detector_positions_and_pixels_are_inverse(laterality):
    frame = gantry(laterality)
    rows, columns = np.array([0.0, 12.5, 2399.0]), np.array([0.0, 700.25, 1799.0])
    xy = frame.detector_xy_mm(rows, columns)
    back = frame.pixel_of(xy[:, 0], xy[:, 1])
    np.testing.assert_allclose(back, np.stack([rows, columns], 1), atol=1e-9)
    assert frame.detector_xy_mm(3, columns).shape == (3, 2)


def test_magnification_is_source_distance_over_object_distance():
    frame = gantry("L")
    near, far = frame.project([[10.0, 0.0, 40.0], [20.0, 0.0, 40.0]])
    expected = 10.0 / 0.1 * 650.0 / (650.0 - 15.0 - 40.0)
    assert far[1] - near[1] == pytest.approx(expected)


def test_voxel_frame_positions_and_indices_are_inverse():
    frame = VoxelFrame(np.array([1.0, 2.0, 3.0]), np.array([0.5, 1.0, 2.0]), (4, 5, 6))
    index = np.array([[0.0, 0.0, 0.0], [1.5, 2.0, 3.0]])
    np.testing.assert_allclose(frame.index(frame.position_mm(index)), index)
