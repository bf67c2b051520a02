"""Plates as solids: every shape's depth and normal agree with each other."""

from __future__ import annotations

import numpy as np
import pytest
from naive import hyperelastic as naive

from mammosim.compression.plates import SHAPES, Panel, PlatePlace, Plates
from mammosim.compression.plates._plate_kernels import depth_in_plate


@pytest.fixture(params=[(shape, side) for shape in SHAPES for side in (1.0, -1.0)])
def plate(request):
    shape, side = request.param
    return SHAPES[shape](PlatePlace(face=4.0, side=side, edge=1.0, middle=6.0, spacing_mm=2.0))


def places(count=200):
    return np.random.default_rng(0).uniform((-3.0, 0.0, -2.0), (30.0, 12.0, 10.0), (count, 3))


def test_the_way_out_is_as_long_as_the_depth(plate):
    for place in places():
        depth, *normal = depth_in_plate(plate, *place)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        left = depth_in_plate(plate, *(place + depth * np.array(normal)))[0]
        if depth > 0.0:
            assert left == pytest.approx(0.0, abs=1e-9)


def test_the_normal_is_the_slope_of_the_depth(plate):
    step = 1e-6
    for place in places(50):
        _, *normal = depth_in_plate(plate, *place)
        slope = [
            (depth_in_plate(plate, *(place + step * e))[0]
             - depth_in_plate(plate, *(place - step * e))[0]) / (2 * step)
            for e in np.eye(3)
        ]  # fmt: skip
        np.testing.assert_allclose(slope, -np.array(normal), atol=1e-5)  # central difference


def test_plates_close_at_one_speed_and_keep_their_shape():
    start, end = Plates(0.0, 80.0, 5.0), Plates(10.0, 60.0, 7.0)
    half = start.closing_to(end, 0.5)
    assert (half.support_z_mm, half.paddle_z_mm, half.edge_mm) == (5.0, 70.0, 7.0)
    assert half.paddle == end.paddle
    assert half.thickness_mm == 65.0


def test_solids_are_in_the_units_of_the_lattice():
    paddle, support = Plates(-10.0, 30.0, 6.0).solids(np.array([2.0, -8.0, -20.0]), 2.0)
    assert paddle.face == 25.0
    assert support.face == 5.0
    assert (paddle.edge, paddle.side, support.side) == (2.0, 1.0, -1.0)
    assert paddle.radius == 1.5  # 3 mm


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 7.0])
def test_a_panel_is_a_rounded_box_that_is_turned(side, tilt_deg):
    covered = Panel(1.0, 13.0, -6.0, 8.0, 5.0, tilt_deg)
    plate = SHAPES["panel"](PlatePlace(4.0, side, 1.0, 6.0, 2.0, covered))
    for place in places():
        depth, *normal = depth_in_plate(plate, *place)
        assert depth == pytest.approx(-naive.panel_distance(plate, *place), abs=1e-9)
        np.testing.assert_allclose(
            normal, naive.normal(naive.panel_distance, plate, place), atol=1e-5
        )  # central difference


def test_a_tilted_panel_comes_down_in_front_of_its_hinge():
    level, tilted = (
        SHAPES["panel"](PlatePlace(0.0, 1.0, 0.0, 0.0, 1.0, Panel(0, 60, -30, 30, 20, angle)))
        for angle in (0.0, 5.0)
    )
    down = np.tan(np.deg2rad(5.0))
    for x in (10.0, 20.0, 40.0):
        assert depth_in_plate(level, x, 0.0, 0.0)[0] == pytest.approx(0.0)
        assert depth_in_plate(tilted, x, 0.0, -down * (x - 20.0))[0] == pytest.approx(0.0, abs=1e-9)
