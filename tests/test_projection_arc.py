"""Projections with the tube turned: the laws hold for an oblique focal spot, and the field."""

import numpy as np
import pytest
from naive.projection import (
    compressed,
    deformed_projection,
    inverse_map,
    phantom,
    turned_pixel,
    unsqueezed,
)

from mammosim.errors import InputError
from mammosim.phantom import Lesion
from mammosim.projection import (
    ProjectionSettings,
    TomosynthesisSettings,
    check_memory,
    project,
    project_arc,
)

ADIPOSE, GLAND, MUSCLE, LESION = 1, 29, 40, 160
WIDE = {"angle_range_deg": 50.0, "projections": 3}  # -25, 0 and 25 degrees
TURNING = {**WIDE, "detector_angle_range_deg": 16.0}  # the detector by -8, 0 and 8


def ball(radius_mm, voxel_mm):
    n = 2 * int(np.ceil(radius_mm / voxel_mm + 1))
    at = (np.arange(n) - 0.5 * (n - 1)) * voxel_mm
    inside = at[:, None, None] ** 2 + at[:, None] ** 2 + at**2 <= radius_mm**2
    return phantom(inside * np.uint8(ADIPOSE), voxel_mm, np.full(3, at[0]))


def rays(gantry):
    """Focal spot (3,) and pixel centres [row, column, 3], gantry frame."""
    return gantry.focal_spot_mm, turned_pixel(gantry, *np.indices((gantry.rows, gantry.columns)))


def test_the_spot_moves_on_a_circle_about_the_pivot():
    breast = unsqueezed(ball(10.0, 1.0), edge_mm=-20.0)
    arc = project_arc(
        breast, {"angle_range_deg": 40.0, "projections": 5, "pivot_to_detector_mm": 45.0},
        pixel_mm=4.0, focal_spot_y_mm=3.0,
    )  # fmt: skip
    pivot = np.array([0.0, 3.0, 45.0 - 15.0])
    arms = np.array([gantry.focal_spot_mm - pivot for gantry in arc.gantries])
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), 605.0, rtol=1e-12)
    np.testing.assert_allclose(
        np.degrees(np.arctan2(arms[:, 1], arms[:, 2])), [-20, -10, 0, 10, 20], atol=1e-10
    )
    heights = [gantry.focal_spot_height_mm for gantry in arc.gantries]
    np.testing.assert_allclose(heights, 15.0 + arms[:, 2] + pivot[2], rtol=1e-12)
    assert arc.gantries[arc.middle].tube_angle_deg == 0.0


@pytest.mark.parametrize("laterality", ["L", "R"])
def test_a_turned_detector_sees_along_the_rays_to_its_pixels(laterality):
    """Its pixels lie on a plane turned about the pivot, and `project` finds them again."""
    breast = unsqueezed(phantom(np.ones((8, 8, 8), np.uint8), 2.0, [1, -7, -7], laterality))
    arc = project_arc(breast, TURNING, pixel_mm=4.0, focal_spot_y_mm=3.0,
                      support_to_detector_mm=30.0, detector_mm=(120.0, 60.0))  # fmt: skip
    for gantry, angle in zip(arc.gantries, (-8.0, 0.0, 8.0), strict=True):
        assert gantry.detector_angle_deg == pytest.approx(angle, abs=1e-12)
        spot, pixel = rays(gantry)
        np.testing.assert_allclose(
            gantry.detector_mm(*np.indices((gantry.rows, gantry.columns))), pixel, atol=1e-9
        )
        normal = np.cross(pixel[1, 0] - pixel[0, 0], pixel[0, 1] - pixel[0, 0])
        normal /= np.linalg.norm(normal)
        height = abs((spot - pixel[0, 0]) @ normal)
        assert gantry.focal_spot_height_mm == pytest.approx(height, rel=1e-12)
        assert gantry.focal_spot_above_detector_mm[2] == pytest.approx(height - 30.0, rel=1e-12)
        for share in (0.0, 0.2):
            found = gantry.project(pixel + share * (spot - pixel))
            np.testing.assert_allclose(
                np.moveaxis(found, -1, 0), np.indices(pixel.shape[:2]), atol=1e-9
            )
    lower, upper = (arc.gantries[k].detector_mm([0, 29], [0, 0])[:, 2] for k in (0, 2))
    # The tube goes to +y, and that side of the detector goes down.
    assert (np.diff(upper)[0] > 0.0) == (laterality == "L") == (np.diff(lower)[0] < 0.0)


def test_a_detector_that_would_turn_into_the_support_is_refused():
    breast = unsqueezed(ball(12.0, 1.0), edge_mm=-15.0)
    with pytest.raises(
        InputError,
        match=r"detector_angle_range_deg: found one that turns the detector by -8 degrees, whose "
        r"edge then reaches the breast support; expected less, or "
        r"projection.support_to_detector_mm above 1\d\.\d \(found 15\)",
    ):
        project_arc(breast, TURNING, pixel_mm=2.0)
    with pytest.raises(InputError, match=r"found 60, expected at most angle_range_deg, 50"):
        project_arc(breast, {**WIDE, "detector_angle_range_deg": 60.0})


@pytest.mark.parametrize("movement", [WIDE, TURNING], ids=["fixed", "turning"])
@pytest.mark.parametrize("index", [0, 2])
def test_chord_of_a_sphere_at_25_degrees(index, movement):
    radius, voxel = 15.0, 0.25
    arc = project_arc(
        unsqueezed(ball(radius, voxel), edge_mm=-20.0), movement, pixel_mm=1.0,
        support_to_detector_mm=20.0,
    )  # fmt: skip
    paths = arc.paths(index)
    spot, pixel = rays(paths.gantry)
    centre = paths.gantry.gantry_from_breast([0.0, 0.0, 0.0])
    along = (pixel - spot) / np.linalg.norm(pixel - spot, axis=-1, keepdims=True)
    distance = np.linalg.norm(np.cross(along, centre - spot), axis=-1)
    chord = 2.0 * np.sqrt(np.maximum(radius**2 - distance**2, 0.0))
    error = paths.length_mm.sum(axis=0) - chord
    steep = distance < 0.9 * radius
    assert steep.sum() > 500
    # As with the upright tube: a staircase within half a voxel's diagonal of the sphere, met at a
    # cosine of at least sqrt(1 - 0.9^2) at either end.
    assert np.abs(error[steep]).max() < 2.0 * 0.5 * np.sqrt(3.0) * voxel / np.sqrt(1.0 - 0.81)
    assert abs(error[steep].mean()) < 0.05 * voxel


@pytest.mark.parametrize("index", [0, 2])
def test_slab_thickness_over_cosine_at_25_degrees(index):
    labels = np.full((40, 60, 20), GLAND, dtype=np.uint8)
    breast = unsqueezed(phantom(labels, [2.0, 2.0, 1.5], [1.0, -59.0, 0.75]))
    paths = project_arc(breast, WIDE, pixel_mm=2.0).paths(index)
    spot, pixel = rays(paths.gantry)
    ray = pixel - spot
    top, bottom = (spot + (spot[2] - z) / -ray[..., 2:] * ray for z in (30.0, 0.0))
    inside = np.all([(p[..., 0] < 79.0) & (np.abs(p[..., 1]) < 59.0) for p in (top, bottom)], 0)
    cosine = -ray[..., 2] / np.linalg.norm(ray, axis=-1)
    assert inside.sum() > 1000
    assert cosine[inside].min() < np.cos(np.radians(27.0))
    np.testing.assert_allclose(
        paths.length_mm[0][inside], (30.0 / cosine)[inside], rtol=2e-6
    )  # float32 output, voxel places in float32


@pytest.mark.parametrize(
    ("laterality", "movement"), [("L", WIDE), ("R", WIDE), ("L", TURNING), ("R", TURNING)]
)
def test_oblique_rays_through_a_deformed_breast_equal_the_twin(laterality, movement):
    labels = np.random.default_rng(5).choice(
        np.array([0, ADIPOSE, GLAND], dtype=np.uint8), (12, 14, 10), p=[0.2, 0.5, 0.3]
    )
    breast = phantom(labels, [1.0, 0.9, 1.1], [0.5, -6.0, -5.0], laterality)
    inverse = inverse_map(
        lambda p: p * [1.1, 0.9, 1.3] + 0.3 * np.sin(p[:, ::-1] / 4.0),
        [-2.0, -9.0, -6.0], [14.0, 9.0, 6.0], [1.7, 1.3, 1.1],
    )  # fmt: skip
    bent = compressed(breast, inverse, plates_mm=(-5.0, 5.0))
    paths = project_arc(bent, movement, pixel_mm=1.3, detector_mm=[52.0, 26.0]).paths(2)
    expected = deformed_projection(bent, paths.gantry)[[ADIPOSE, GLAND]]
    assert expected.max() > 2.0
    np.testing.assert_allclose(paths.length_mm, expected, atol=2e-4)  # as in the upright twin test


@pytest.mark.parametrize("laterality", ["L", "R"])
@pytest.mark.parametrize("view", ["CC", "MLO"])
def test_a_lesion_is_where_the_turned_gantry_projects_it(view, laterality):
    labels = np.full((20, 40, 40), ADIPOSE, dtype=np.uint8)
    labels[8:11, 24:27, 28:31] = LESION
    lesion = Lesion("marker", "mass", LESION, "mass", np.array([19.0, 11.0, 19.0]), 216.0)
    breast = phantom(labels, 2.0, [1.0, -39.0, -39.0], laterality, lesions=(lesion,))
    arc = project_arc(unsqueezed(breast, view, spacing_mm=2.0), WIDE, pixel_mm=0.2)
    rows = []
    for index in range(len(arc)):
        paths = arc.paths(index)
        marker = paths.length_mm[paths.lesion_labels.index(LESION)].astype(float)
        place = [np.average(np.indices(marker.shape)[k], weights=marker) for k in (0, 1)]
        centre = paths.gantry.gantry_from_breast(lesion.position_mm)
        np.testing.assert_allclose(place, paths.gantry.project(centre), atol=0.5)  # whole pixels
        rows.append(place[0])
    # The tube goes towards +y, the shadow the other way: downward in a left breast's picture.
    assert (rows[0] < rows[1] < rows[2]) if laterality == "L" else (rows[0] > rows[1] > rows[2])


def test_a_sweep_of_one_is_the_upright_projection():
    breast = unsqueezed(ball(12.0, 1.0), edge_mm=-15.0)
    arc = project_arc(breast, {"projections": 1}, pixel_mm=1.0)
    assert len(arc) == 1
    np.testing.assert_array_equal(arc.paths(0).length_mm, project(breast, pixel_mm=1.0).length_mm)


def test_the_field_holds_all_shadows_where_a_format_can():
    labels = np.full((30, 78, 40), ADIPOSE, dtype=np.uint8)  # 60 x 156 x 80 mm
    breast = unsqueezed(phantom(labels, 2.0, [1.0, -77.0, 1.0]))
    upright = project(breast, pixel_mm=1.0).gantry
    swept = project_arc(breast, WIDE, pixel_mm=1.0)
    assert upright.rows == 240
    assert swept.gantries[0].rows == 300
    assert all(not swept.paths(k).length_mm[:, [0, -1]].any() for k in (0, 2))
    # None holds the sweep of a larger one: the upright shadow decides, the others are cut off.
    larger = np.full((30, 115, 40), ADIPOSE, dtype=np.uint8)
    cut = project_arc(unsqueezed(phantom(larger, 2.0, [1.0, -114.0, 1.0])), WIDE, pixel_mm=1.0)
    assert cut.gantries[0].rows == 300
    assert cut.paths(0).length_mm[:, [0, -1]].any()
    assert not cut.paths(1).length_mm[:, [0, -1]].any()


def test_angles_are_even_and_symmetric():
    sweep = TomosynthesisSettings(view="CC", angle_range_deg=30.0, projections=4)
    assert sweep.angles_deg == (-15.0, -5.0, 5.0, 15.0)
    assert len(TomosynthesisSettings(view="CC").angles_deg) == 25


def test_a_pivot_at_the_focal_spot_leaves_the_tube_in_place():
    arc = project_arc(
        unsqueezed(ball(12.0, 1.0), edge_mm=-15.0), {**WIDE, "pivot_to_detector_mm": 300.0},
        pixel_mm=2.0, source_to_detector_mm=300.0,
    )  # fmt: skip
    spots = {tuple(gantry.focal_spot_mm.round(9)) for gantry in arc.gantries}
    assert spots == {(0.0, 0.0, 285.0)}


def test_faulty_sweeps_are_refused():
    breast = unsqueezed(ball(12.0, 1.0), edge_mm=-15.0)
    with pytest.raises(InputError, match="angle_range_deg: found 200"):
        project_arc(breast, {"angle_range_deg": 200.0})
    with pytest.raises(InputError, match="projections: found 0"):
        project_arc(breast, {"projections": 0})
    with pytest.raises(InputError, match=r"focal spot must be above the breast"):
        project_arc(breast, {"angle_range_deg": 100.0, "projections": 3, "pivot_to_detector_mm": 0},
                    source_to_detector_mm=45.0)  # fmt: skip


def test_a_picture_larger_than_memory_is_refused_before_anything_is_read():
    with pytest.raises(InputError, match=r"pixel_mm: found 1e-05, which needs \d+\.\d GB for 6"):
        check_memory(ProjectionSettings(pixel_mm=1e-5))
    with pytest.raises(InputError, match=r"3 images of 40000000 x 20000000 pixels; this machine"):
        check_memory(
            ProjectionSettings(pixel_mm=1e-6, detector_mm=(40.0, 20.0), conserve_mass=False)
        )
    with pytest.raises(InputError, match=r"for 6 images and 200 projections of 24\d\d\d\d x"):
        check_memory(ProjectionSettings(pixel_mm=0.001), projections=200)
    check_memory(ProjectionSettings(pixel_mm=0.1), projections=200)
