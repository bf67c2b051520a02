"""Detector field, channels, orientation, density, and every error of the projection room."""

import re

import numpy as np
import pytest
from naive.projection import compressed, inverse_map, phantom, unsqueezed

from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import Lesion
from mammosim.projection import ProjectionSettings, compressed_labels, project, warp

ADIPOSE, GLAND, MUSCLE, LESION = 1, 29, 40, 160


def block(size_mm=(40, 60, 30), centre_y_mm=0.0, laterality="L", **fields):
    labels = np.full(np.array(size_mm) // 2, ADIPOSE, dtype=np.uint8)
    origin = [1.0, centre_y_mm - 0.5 * size_mm[1] + 1.0, 1.0]
    return phantom(labels, 2.0, origin, laterality, **fields)


def marked(place_mm, laterality):
    """A half ball of fat, radius 40 mm, with a lesion of 4 mm around a place in it."""
    voxel = 2.0
    at = [np.arange(20) * voxel + 1.0, np.arange(40) * voxel - 39.0, np.arange(40) * voxel - 39.0]
    x, y, z = np.meshgrid(*at, indexing="ij")
    labels = ((x**2 + y**2 + z**2) <= 40.0**2).astype(np.uint8)
    near = (np.abs(np.stack([x, y, z], -1) - place_mm) < 2.0).all(axis=-1)
    labels[near] = LESION
    centre = np.stack([x, y, z], -1)[near].mean(axis=0)
    lesion = Lesion("marker", "mass", LESION, "mass", centre, near.sum() * voxel**3)
    return phantom(labels, voxel, [1.0, -39.0, -39.0], laterality, lesions=(lesion,))


def seen_at(breast, view):
    """Centroid (row, column) of the marker, and the picture of the fat."""
    paths = project(
        unsqueezed(breast, view, spacing_mm=2.0), pixel_mm=0.1, detector_mm=[120.0, 60.0]
    )
    marker = paths.length_mm[paths.lesion_labels.index(LESION)]
    row = np.average(np.arange(marker.shape[0]), weights=marker.sum(axis=1, dtype=float))
    column = np.average(np.arange(marker.shape[1]), weights=marker.sum(axis=0, dtype=float))
    return np.array([row, column]), paths


@pytest.mark.parametrize("view", ["CC", "MLO", "ML"])
@pytest.mark.parametrize("laterality", ["L", "R"])
def test_a_lesion_appears_where_the_gantry_projects_its_centroid(view, laterality):
    breast = marked(np.array([20.0, 12.0, 10.0]), laterality)
    pixel, paths = seen_at(breast, view)
    gantry = paths.gantry
    expected = gantry.project(gantry.gantry_from_breast(breast.lesions[0].position_mm))
    # Either edge of the shadow is caught by whole pixels.
    np.testing.assert_allclose(pixel, expected, atol=0.5)


@pytest.mark.parametrize(("laterality", "lateral"), [("L", 1.0), ("R", -1.0)])
def test_lateral_is_up_in_cc_and_superolateral_up_in_mlo(laterality, lateral):
    for view, y, z in [("CC", 20.0, 0.0), ("MLO", 20.0, 20.0), ("ML", 0.0, 20.0)]:
        breast = marked(np.array([10.0, lateral * y, z]), laterality)
        (row, _), paths = seen_at(breast, view)
        upper_half = row < 0.5 * paths.gantry.rows - 150
        assert upper_half, (view, row)


@pytest.mark.parametrize("laterality", ["L", "R"])
def test_chest_wall_is_left_in_left_breasts_and_right_in_right_ones(laterality):
    breast = marked(np.array([30.0, 0.0, 0.0]), laterality)
    (_, column), paths = seen_at(breast, "CC")
    fat = paths.length_mm[0].sum(axis=0)
    at_edge = fat[0] if laterality == "L" else fat[-1]
    at_far_edge = fat[-1] if laterality == "L" else fat[0]
    assert at_edge > 0.0
    assert at_far_edge == 0.0
    expected = 30.0 * 650.0 / (650.0 - 15.0 - 40.0) / 0.1  # the ball's middle is 40 mm up
    from_chest = column if laterality == "L" else paths.gantry.columns - 1 - column
    assert from_chest == pytest.approx(expected, abs=15.0)  # voxels of 2 mm


def test_a_right_breast_is_the_left_one_turned_and_not_mirrored():
    """The same voxels called right: every pixel of the picture turned by 180 degrees."""
    left = unsqueezed(marked(np.array([20.0, 12.0, 10.0]), "L"))
    right = unsqueezed(marked(np.array([20.0, 12.0, 10.0]), "R"))
    images = [project(breast, pixel_mm=1.0).length_mm for breast in (left, right)]
    np.testing.assert_allclose(images[1], images[0][:, ::-1, ::-1], atol=1e-5)


def test_small_and_large_format():
    small = project(unsqueezed(block()), pixel_mm=1.0).gantry
    assert (small.rows, small.columns) == (240, 180)
    large = project(unsqueezed(block((40, 260, 30))), pixel_mm=1.0).gantry
    assert (large.rows, large.columns) == (300, 240)


def test_the_field_is_centred_on_the_focal_spot_and_shifted_only_as_needed():
    centred = project(unsqueezed(block(centre_y_mm=20.0)), pixel_mm=1.0).gantry
    assert centred.focal_spot_y_mm == 0.0
    assert centred.y_min_mm == -120.0
    beside = project(unsqueezed(block(centre_y_mm=70.0)), pixel_mm=1.0).gantry
    assert beside.focal_spot_y_mm == pytest.approx(70.0, abs=2.0)
    shifted = project(unsqueezed(block((40, 160, 30), centre_y_mm=70.0)), pixel_mm=1.0).gantry
    assert shifted.focal_spot_y_mm == 0.0
    # 150 mm, magnified by 650/605, less than 5 mm beyond.
    assert 161.0 < shifted.y_max_mm < 166.0
    assert (shifted.y_min_mm + 120.0) % 1.0 == pytest.approx(0.0, abs=1e-9)
    given = project(unsqueezed(block()), pixel_mm=1.0, focal_spot_y_mm=7.0).gantry
    assert given.focal_spot_y_mm == 7.0


def test_detector_edge_and_distances_are_those_given():
    breast = unsqueezed(block(), edge_mm=3.0)
    assert project(breast, pixel_mm=2.0).gantry.detector_edge_mm == 3.0
    gantry = project(
        breast, pixel_mm=2.0, detector_edge_mm=5.0, source_to_detector_mm=700.0,
        support_to_detector_mm=20.0,
    ).gantry  # fmt: skip
    assert gantry.detector_edge_mm == 5.0
    assert gantry.focal_spot_mm.tolist() == [0.0, 0.0, 680.0]


def test_lesions_are_channels_of_their_own_behind_the_materials():
    labels = np.full((20, 20, 10), ADIPOSE, dtype=np.uint8)
    labels[:, :4] = MUSCLE
    labels[5, 10, 5], labels[8, 10, 5] = 151, 200
    labels[2, 10, 5] = 33  # nipple attenuates as skin
    lesion = Lesion("spot", "calcification", 151, "calcification", np.zeros(3), 1.0)
    breast = unsqueezed(phantom(labels, 2.0, [1.0, -19.0, 1.0], lesions=(lesion,)))
    paths = project(breast, pixel_mm=1.0)
    assert paths.tissues == ("adipose", "skin", "muscle", "mass", "spot")
    assert paths.materials == ("adipose", "skin", "muscle", "mass", "calcification")
    assert paths.lesion_labels == (0, 0, 0, 0, 151)
    assert all(image.any() for image in paths.length_mm)


def test_a_lesion_that_fills_its_voxels_in_part_leaves_the_rest_to_its_surroundings():
    labels = np.full((20, 20, 10), ADIPOSE, dtype=np.uint8)
    labels[:, :8] = GLAND
    labels[10:12, 4:6, 5] = 151
    lesion = Lesion("dust", "calcification", 151, "calcification", np.zeros(3), 1.0, fill=0.25)
    breast = unsqueezed(phantom(labels, 2.0, [1.0, -19.0, 1.0], lesions=(lesion,)), spacing_mm=2.0)
    for conserve_mass in (True, False):
        keys = {"conserve_mass": conserve_mass, "smooth_voxels": False}
        paths = project(breast, pixel_mm=1.0, **keys)
        _, gland, dust = paths.length_mm
        adipose_mu, gland_mu, dust_mu = paths.attenuating_mm
        np.testing.assert_allclose(dust_mu, 0.25 * dust, atol=1e-5)
        np.testing.assert_allclose(gland_mu, gland + 0.75 * dust, atol=1e-5)
        np.testing.assert_allclose(adipose_mu, paths.length_mm[0], atol=1e-5)
        assert dust.any()


def test_density_is_clipped_and_the_share_reported():
    """Half of a block compressed to a third along z, which no tissue bears; the rest unchanged."""
    breast = block((40, 60, 30))
    inverse = inverse_map(
        lambda p: p * np.where(p[:, 1:2] > 0.0, [1.0, 1.0, 3.0], 1.0),
        [-2.0, -31.0, -15.0], [42.0, 31.0, 33.0], [2.0, 1.0, 1.0],
    )  # fmt: skip
    paths = project(compressed(breast, inverse, plates_mm=(0.0, 30.0)), pixel_mm=1.0)
    # 40 x 30 x 10 of 40 x 30 x 40 mm3; cells of 1 mm at the surface count by eight points each.
    assert paths.clipped_fraction == pytest.approx(0.25, abs=0.02)
    row = round(float(paths.gantry.project([20.0, 15.0, 5.0])[0]))
    length, attenuating = paths.length_mm[0, row, 20], paths.attenuating_mm[0, row, 20]
    assert length == pytest.approx(10.0, rel=2e-3)  # over the cosine of the ray
    assert attenuating == pytest.approx(2.0 * length, rel=1e-5)
    plain = project(
        compressed(breast, inverse, plates_mm=(0.0, 30.0)), pixel_mm=1.0, conserve_mass=False
    )
    assert plain.clipped_fraction == 0.0


def test_compressed_labels_keep_volume_place_and_affordable_size(monkeypatch):
    breast = block((40, 60, 30))
    stretch = np.array([1.0, 1.25, 0.6])
    inverse = inverse_map(lambda p: p / stretch, [-2.0, -40.0, -2.0], [42.0, 40.0, 20.0], 1.0)
    labels, frame = compressed_labels(compressed(breast, inverse), 0.5)
    volume = np.count_nonzero(labels) * np.prod(frame.spacing_mm)
    # Faces at multiples of 0.5 mm or half-way: a layer of voxels more or less on each.
    assert volume == pytest.approx(40.0 * 60.0 * 30.0 * np.prod(stretch), rel=0.03)
    top = frame.position_mm(np.argwhere(labels).max(axis=0))
    np.testing.assert_allclose(top, [40.0, 37.5, 18.0], atol=0.5)
    _, own = compressed_labels(compressed(breast, inverse))
    assert own.spacing_mm.tolist() == [2.0, 2.0, 2.0]
    monkeypatch.setattr(warp, "MAX_VOXELS", 5000)
    fewer, _ = compressed_labels(compressed(breast, inverse))
    assert 2500 < fewer.size <= 5000


def test_a_breast_larger_than_the_detector_is_cut_off_there_and_says_by_how_much():
    """What remains is the part, centred on the breast, of the picture on a larger detector."""
    breast = unsqueezed(block((40, 90, 30), centre_y_mm=10.0))
    whole = project(breast, pixel_mm=1.0, detector_mm=[120.0, 60.0])
    cut = project(breast, pixel_mm=1.0, detector_mm=[60.0, 20.0])
    assert whole.notes == ()
    (note,) = cut.notes
    # 90 and 40 mm and up to a cell of 2 mm at each end, magnified 650/605 at the top.
    height, width = (float(size) for size in re.findall(r"shadow is (.*) x (.*) mm \(", note)[0])
    assert 96.6 < height < 101.1
    assert 42.9 < width < 47.3
    assert f"{height - 60.0:.1f} mm of its height and {width - 20.0:.1f} mm of its width" in note
    gantry = cut.gantry
    assert (gantry.rows, gantry.columns) == (60, 20)
    assert 0.5 * (gantry.y_min_mm + gantry.y_max_mm) == pytest.approx(10.0, abs=1.5)
    first = round(whole.gantry.y_max_mm - gantry.y_max_mm)
    part = whole.length_mm[:, first : first + 60, :20]
    np.testing.assert_allclose(cut.length_mm, part, atol=1e-4)


def test_a_field_that_the_focal_spot_is_not_above_is_refused():
    with pytest.raises(InputError, match=r"focal_spot_y_mm: found 5000, expected .* above the det"):
        project(unsqueezed(block()), pixel_mm=1.0, focal_spot_y_mm=5000.0)


def test_edge_in_front_of_the_breast_is_refused():
    with pytest.raises(InputError, match=r"detector_edge_mm: found 90, which has no tissue"):
        project(unsqueezed(block()), detector_edge_mm=90.0)


def test_focal_spot_inside_the_breast_is_refused():
    with pytest.raises(InputError, match=r"source_to_detector_mm: found 30, expected more than"):
        project(unsqueezed(block()), source_to_detector_mm=30.0)


def test_picture_larger_than_memory_is_refused():
    with pytest.raises(InputError, match=r"pixel_mm: found 1e-05, which needs .* GB"):
        project(unsqueezed(block()), pixel_mm=1e-5)


def test_unknown_key_and_bad_values_are_refused():
    with pytest.raises(InputError, match="pixel_size: unknown key"):
        project(unsqueezed(block()), pixel_size=0.1)
    with pytest.raises(InputError, match="pixel_mm: found -1"):
        project(unsqueezed(block()), pixel_mm=-1)
    with pytest.raises(InputError, match="detector_mm"):
        project(unsqueezed(block()), detector_mm=[100.0, 0.0])


def test_map_without_tissue_or_too_small_is_refused():
    breast = block()
    away = inverse_map(lambda p: p + 1000.0, [0.0] * 3, [10.0] * 3, 1.0)
    with pytest.raises(InputError, match="no tissue in it"):
        project(compressed(breast, away))
    flat = inverse_map(lambda p: p, [0.0] * 3, [10.0, 10.0, 0.0], 1.0)
    with pytest.raises(InputError, match=r"found \(11, 11, 1\) nodes, expected at least 2"):
        project(compressed(breast, flat))


def test_label_without_tissue_is_refused():
    breast = block()
    breast.labels[3, 3, 3] = 77
    with pytest.raises(InputError, match=r"label \[77\], which belongs to no tissue"):
        project(unsqueezed(breast))


def test_voxel_size_must_be_positive():
    with pytest.raises(InputError, match="voxel_mm: found 0"):
        compressed_labels(unsqueezed(block()), 0.0)


def test_every_setting_is_explained():
    for name, field in ProjectionSettings.model_fields.items():
        assert field.description, name
    assert View("CC", "L").angle_deg == 0.0
