"""Targets of a breast compressed by formula: every column against its definition."""

import numpy as np
import pytest
from naive.projection import compressed, inverse_map, phantom

from mammosim.geometry import View
from mammosim.phantom import Landmark, Lesion
from mammosim.projection import project
from mammosim.targets import Target, find_targets, origins, touching_lesions

LESION = 160
VOXEL_MM = 1.0
RADIUS_MM = 42.0
# Compression frame: shorter along z, longer in x and y, more the farther from the chest wall.
SQUEEZE = np.array([1.08, 1.12, 0.6])


def squeeze(points):
    """Compression-frame places after compression; x also leans with y."""
    moved = points * SQUEEZE
    moved[:, 0] += 0.05 * points[:, 1]
    return moved


def release(points):
    original = np.array(points) / SQUEEZE
    original[:, 0] = (points[:, 0] - 0.05 * original[:, 1]) / SQUEEZE[0]
    return original


GRADIENT = np.array([[SQUEEZE[0], 0.05, 0.0], [0.0, SQUEEZE[1], 0.0], [0.0, 0.0, SQUEEZE[2]]])


def half_ball(centre_mm, laterality, radius_mm=4.0):
    """A half ball of fat with a mass in it, a landmark, and the nipple at its front."""
    n = int(RADIUS_MM / VOXEL_MM)
    x = np.arange(n) * VOXEL_MM + 0.5 * VOXEL_MM
    y = (np.arange(2 * n) - n + 0.5) * VOXEL_MM
    at = np.stack(np.meshgrid(x, y, y, indexing="ij"), axis=-1)
    labels = (np.linalg.norm(at, axis=-1) <= RADIUS_MM).astype(np.uint8)
    inside = np.linalg.norm(at - centre_mm, axis=-1) <= radius_mm
    labels[inside] = LESION
    lesion = Lesion(
        "mass 1", "mass", LESION, "mass", at[inside].mean(axis=0),
        float(inside.sum() * VOXEL_MM**3),
    )  # fmt: skip
    return phantom(
        labels, VOXEL_MM, [x[0], y[0], y[0]], laterality, lesions=(lesion,),
        landmarks=(Landmark("seed", np.array([20.0, 6.0, -8.0])),),
        nipple_mm=np.array([RADIUS_MM, 0.0, 0.0]),
    )  # fmt: skip


def compress(breast, view, edge_mm=0.0):
    """The breast compressed by `squeeze`, with the exact field beside the inverse map."""
    rotation = View(view, breast.laterality).rotation
    reach = RADIUS_MM * SQUEEZE + 5.0
    inverse = inverse_map(release, [-4.0, -reach[1], -reach[2]], reach, 2.0)

    def displacement_at(points_mm):
        rotated = np.asarray(points_mm) @ rotation.T
        return (squeeze(rotated) - rotated) @ rotation

    def deformation_gradient_at(points_mm):
        return np.repeat((rotation.T @ GRADIENT @ rotation)[None], len(points_mm), axis=0)

    height = RADIUS_MM * SQUEEZE[2]
    return compressed(
        breast, inverse, view, plates_mm=(-height, height), edge_mm=edge_mm,
        displacement_at=displacement_at, deformation_gradient_at=deformation_gradient_at,
    )  # fmt: skip


def targets_of(breast, view, **keys):
    compressed = compress(breast, view, **keys)
    paths = project(compressed, pixel_mm=0.2)
    return find_targets(compressed, paths), paths


def upper_outer(laterality):
    lateral = 1.0 if laterality == "L" else -1.0
    return half_ball(np.array([20.0, lateral * 15.0, 15.0]), laterality)


@pytest.mark.parametrize(("laterality", "hour"), [("L", "1:30"), ("R", "10:30")])
def test_upper_outer_quadrant_is_where_a_radiologist_looks(laterality, hour):
    breast = upper_outer(laterality)
    for view in ("CC", "MLO"):
        targets, paths = targets_of(breast, view)
        mass = targets[0]
        assert mass.clock_position == hour
        assert mass.view == view
        # CC: lateral up; MLO: superolateral up. 15 mm and more on 0.2 mm pixels.
        assert mass.image_row_px < 0.5 * paths.gantry.rows - 70.0
        nipple = targets[-1]
        assert nipple.clock_position == ""
        chest_to_nipple = nipple.image_col_px - mass.image_col_px
        assert (chest_to_nipple > 0) == (laterality == "L")


def test_upper_inner_quadrant_is_below_in_cc_and_level_in_mlo():
    breast = half_ball(np.array([20.0, -15.0, 15.0]), "L")
    cc, paths = targets_of(breast, "CC")
    assert cc[0].clock_position == "10:30"
    assert cc[0].image_row_px > 0.5 * paths.gantry.rows + 70.0
    mlo, paths = targets_of(breast, "MLO")
    assert mlo[0].image_row_px == pytest.approx(0.5 * paths.gantry.rows, abs=15.0)


@pytest.mark.parametrize("view", ["CC", "MLO"])
@pytest.mark.parametrize("laterality", ["L", "R"])
def test_columns_follow_their_definitions(view, laterality):
    breast = upper_outer(laterality)
    targets, paths = targets_of(breast, view)
    mass = targets[0]
    gantry = paths.gantry
    rotation = gantry.view.rotation
    before = np.array([mass.x_mm, mass.y_mm, mass.z_mm])
    np.testing.assert_allclose(before, breast.lesions[0].position_mm, atol=1e-9)
    after = squeeze((before @ rotation.T)[None])[0] @ rotation
    shift = np.array([mass.shift_x_mm, mass.shift_y_mm, mass.shift_z_mm])
    np.testing.assert_allclose(shift, after - before, atol=1e-9)
    assert mass.shift_mm == pytest.approx(np.linalg.norm(shift))
    place = np.array([mass.compressed_x_mm, mass.compressed_y_mm, mass.compressed_z_mm])
    np.testing.assert_allclose(gantry.breast_from_gantry(place), after, atol=1e-9)
    np.testing.assert_allclose([mass.moved_x_mm, mass.moved_y_mm, mass.moved_z_mm], after)
    at_rest = np.array([mass.gantry_x_mm, mass.gantry_y_mm, mass.gantry_z_mm])
    np.testing.assert_allclose(gantry.breast_from_gantry(at_rest), before, atol=1e-9)
    assert 0.0 < mass.compressed_z_mm < 2.0 * RADIUS_MM * SQUEEZE[2]
    assert mass.volume_mm3 == breast.lesions[0].volume_mm3
    assert mass.volume_ratio == pytest.approx(np.prod(SQUEEZE))
    stretches = np.sqrt(np.linalg.eigvalsh(GRADIENT.T @ GRADIENT))
    assert mass.stretch_max == pytest.approx(stretches[-1])
    assert mass.stretch_min == pytest.approx(stretches[0])
    assert mass.stretch_middle == pytest.approx(stretches[1])
    normal = rotation[2]
    assert mass.shift_along_mm == pytest.approx(shift @ normal)
    assert mass.shift_across_mm == pytest.approx(np.linalg.norm(shift - (shift @ normal) * normal))
    to_nipple = np.linalg.norm(before - breast.nipple_mm)
    assert mass.nipple_distance_mm == pytest.approx(to_nipple)
    # Half ball: depth from the sphere, less a voxel's diagonal of staircase.
    depth = RADIUS_MM - np.linalg.norm(before)
    assert mass.skin_depth_mm == pytest.approx(depth, abs=1.0)
    # An 8 mm ball seen by 0.2 mm pixels, a cone of 1 in 13 and voxels of 1 mm: half a pixel.
    expected = gantry.project(place)
    np.testing.assert_allclose([mass.image_row_px, mass.image_col_px], expected, atol=0.5)
    nipple = targets[-1]
    apart = np.hypot(
        mass.image_row_px - nipple.image_row_px, mass.image_col_px - nipple.image_col_px
    )
    assert mass.image_nipple_distance_mm == pytest.approx(0.2 * apart)
    assert mass.in_field


def test_order_numbers_and_points():
    breast = upper_outer("L")
    targets, paths = targets_of(breast, "CC")
    assert [target.kind for target in targets] == ["mass", "landmark", "nipple"]
    assert [target.name for target in targets] == ["mass 1", "seed", "nipple"]
    assert [target.target_id for target in targets] == [1, 2, 3]
    seed, nipple = targets[1:]
    assert seed.volume_mm3 == nipple.volume_mm3 == 0.0
    assert seed.clock_position == "5:00"  # 143 degrees from twelve
    assert nipple.nipple_distance_mm == nipple.image_nipple_distance_mm == 0.0
    place = [seed.compressed_x_mm, seed.compressed_y_mm, seed.compressed_z_mm]
    np.testing.assert_allclose(
        [seed.image_row_px, seed.image_col_px], paths.gantry.project(place), atol=1e-9
    )
    assert nipple.in_field


def test_behind_the_detectors_edge_is_out_of_the_field():
    breast = half_ball(np.array([8.0, 0.0, 0.0]), "L")
    targets, _ = targets_of(breast, "CC", edge_mm=20.0)
    assert not targets[0].in_field
    assert targets[0].image_col_px < -0.5
    assert targets[-1].in_field


def test_large_lesions_are_followed_by_an_even_share_of_their_voxels(monkeypatch):
    breast = upper_outer("R")
    every, _ = targets_of(breast, "MLO")
    monkeypatch.setattr(origins, "MAX_VOXELS", 60)
    some, _ = targets_of(breast, "MLO")
    assert (some[0].x_mm, some[0].y_mm, some[0].z_mm) == (
        every[0].x_mm,
        every[0].y_mm,
        every[0].z_mm,
    )
    # Shift is linear here with a gradient below 0.5: an even share's centre is 0.2 mm off.
    assert some[0].shift_mm == pytest.approx(every[0].shift_mm, abs=0.2)


def test_a_lesion_without_voxels_is_followed_as_a_point():
    breast = upper_outer("L")
    breast.labels[breast.labels == LESION] = 1
    targets, paths = targets_of(breast, "CC")
    mass = targets[0]
    np.testing.assert_allclose([mass.x_mm, mass.y_mm, mass.z_mm], breast.lesions[0].position_mm)
    place = [mass.compressed_x_mm, mass.compressed_y_mm, mass.compressed_z_mm]
    np.testing.assert_allclose(
        [mass.image_row_px, mass.image_col_px], paths.gantry.project(place), atol=1e-9
    )


def test_a_breast_without_lesions_has_its_nipple():
    breast = phantom(np.ones((20, 20, 20), dtype=np.uint8), 2.0, [1.0, -19.0, -19.0])
    targets, _ = targets_of(breast, "CC")
    assert [target.kind for target in targets] == ["nipple"]
    assert isinstance(targets[0], Target)
    assert targets[0].target_id == 1


def two_lesions(gap):
    """Two cubes of 3 voxels side by side along y, `gap` voxels of fat between them."""
    labels = np.ones((12, 12, 12), np.uint8)
    labels[4:7, 1:4, 4:7] = LESION
    labels[4:7, 4 + gap : 7 + gap, 4:7] = LESION + 1
    lesions = tuple(
        Lesion(name, "mass", LESION + n, "mass", np.zeros(3), 27.0)
        for n, name in enumerate(("a", "b"))
    )
    return phantom(labels, 1.0, lesions=lesions)


def test_lesions_that_touch_are_named():
    assert touching_lesions(two_lesions(1)) == ()
    (note,) = touching_lesions(two_lesions(0))
    assert note.startswith("lesions 'a' and 'b' touch")
    breast = two_lesions(0)
    breast.labels[breast.labels == LESION] = 1  # what has no voxels touches nothing
    assert touching_lesions(breast) == ()
    assert touching_lesions(phantom(np.ones((3, 3, 3), np.uint8))) == ()


def test_the_extent_is_the_largest_distance_across_a_lesion():
    """Against all pairs, on shapes with and without a volume; and of a group, from end to end."""
    rng = np.random.default_rng(4)
    solid, flat = rng.normal(size=(300, 3)) * [5.0, 2.0, 1.0], rng.normal(size=(40, 3)) * [1, 1, 0]
    shapes = [
        solid,
        flat,
        np.array([[1.0, 2.0, 3.0]]),
        np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]),
    ]
    for points in shapes:
        apart = np.linalg.norm(points[:, None] - points[None], axis=2).max()
        assert origins.largest_distance(points) == pytest.approx(apart)
    assert np.isnan(origins.largest_distance(np.empty((0, 3))))
    voxels = np.argwhere(rng.random((7, 8, 9)) > 0.8)
    ends = voxels[origins.row_ends(voxels)]
    assert len(ends) < len(voxels)
    assert origins.largest_distance(ends) == origins.largest_distance(voxels)
    assert not origins.row_ends(voxels[:0]).any()
    breast = half_ball(np.array([20.0, 0.0, 0.0]), "L")
    ball, seed, _ = origins.target_origins(breast)
    assert ball.extent_mm == pytest.approx(8.0, abs=VOXEL_MM)
    assert np.isnan(seed.extent_mm)
    assert targets_of(breast, "CC")[0][0].extent_mm == ball.extent_mm
