"""Lesions and landmarks put into a breast, and the settings that ask for them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mammosim.config import to_settings
from mammosim.errors import InputError
from mammosim.phantom import (
    BreastPhantom,
    LesionSettings,
    PhantomSettings,
    insert_lesions,
    make_phantom,
    read_phantom,
)
from mammosim.phantom.lesion_kinds.balls import Ball
from mammosim.phantom.lesion_kinds.clip import clip_ball
from mammosim.phantom.lesion_kinds.clusters import SIZES, cluster_balls
from mammosim.phantom.lesion_kinds.mass import inside_mass
from mammosim.tissues import TISSUES


@pytest.fixture
def breast() -> BreastPhantom:
    """Half a ball of fat, 30 mm, with a ball of gland, skin, and muscle at the chest wall."""
    voxel = 0.5
    index = np.stack(np.indices((64, 128, 128)), axis=-1)
    origin = np.array([0.25, -31.75, -31.75])
    points = origin + index * voxel
    radius = np.linalg.norm(points, axis=-1)
    labels = np.where(radius <= 30.0, 1, 0).astype(np.uint8)
    labels[(radius <= 30.0) & (radius > 28.5)] = 2
    labels[(points[..., 0] < 3.0) & (radius <= 28.5)] = 40
    labels[np.linalg.norm(points - [13.0, 0, 0], axis=-1) < 8.0] = 29
    names = {tissue.label: tissue.name for tissue in TISSUES.values()}
    return BreastPhantom(
        labels, np.full(3, voxel), origin, "L", names, np.array([29.75, 0, 0]), source="ball"
    )


def lesion(name="m", kind="mass", **keys) -> LesionSettings:
    return LesionSettings(name=name, kind=kind, **keys)


def rng() -> np.random.Generator:
    return np.random.default_rng(8)


MASS_VOLUMES = {
    # Share of the ball. Spiculated: a body of 17 % and spicules; distortion: thin lines, which
    # take 1.2 voxels of 0.5 mm at least.
    "smooth": (0.45, 1.0), "lobulated": (0.45, 1.0), "spiculated": (0.17, 0.5),
    "distortion": (0.02, 0.2),
}  # fmt: skip


@pytest.mark.parametrize("margin", MASS_VOLUMES)
def test_a_mass_fills_a_ball_without_leaving_it(breast, margin):
    entry = lesion(diameter_mm=10.0, position_mm=(13.0, 2.0, -3.0), margin=margin)
    made = insert_lesions(breast, [entry], rng())
    mass = made.lesions[0]
    voxels = breast.frame.position_mm(np.argwhere(made.labels == mass.label))
    assert np.linalg.norm(voxels - entry.position_mm, axis=1).max() <= 5.0
    assert mass.volume_mm3 == pytest.approx(len(voxels) * 0.125)
    ball = np.pi / 6 * 1000.0
    low, high = MASS_VOLUMES[margin]
    assert low * ball < mass.volume_mm3 < high * ball
    np.testing.assert_allclose(mass.position_mm, voxels.mean(axis=0))
    assert np.linalg.norm(mass.position_mm - entry.position_mm) < 1.0
    assert made.tissue_of_label[mass.label] == "mass"


def test_a_breast_that_is_not_used_any_more_lends_its_labels(breast):
    entries = [lesion(position_mm=(15.0, 0, 0)), lesion("c", "calcification", diameter_mm=6.0)]
    copied = insert_lesions(breast, entries, rng())
    painted = insert_lesions(breast, entries, rng(), in_place=True)
    assert painted.labels is breast.labels
    np.testing.assert_array_equal(painted.labels, copied.labels)
    assert [mass.volume_mm3 for mass in painted.lesions] == [m.volume_mm3 for m in copied.lesions]


def test_nothing_else_changes_and_the_input_stays(breast):
    before = breast.labels.copy()
    made = insert_lesions(breast, [lesion(position_mm=(15.0, 0, 0))], rng())
    np.testing.assert_array_equal(breast.labels, before)
    other = made.labels != made.lesions[0].label
    np.testing.assert_array_equal(made.labels[other], before[other])
    assert insert_lesions(breast, [], rng()) is breast


def test_calcifications_keep_their_mass(breast):
    entry = lesion("c", "calcification", diameter_mm=8.0, count=12, calcification_mm=0.3)
    cluster = insert_lesions(breast, [entry], rng()).lesions[0]
    assert cluster.volume_mm3 == pytest.approx(12 * np.pi / 6 * 0.3**3)
    made = insert_lesions(breast, [entry], rng())
    painted = np.count_nonzero(made.labels == cluster.label) * 0.125
    assert cluster.fill * painted == pytest.approx(cluster.volume_mm3)
    assert cluster.fill < 0.2


@pytest.mark.parametrize("morphology", SIZES)
def test_drawn_clusters_have_published_numbers_and_sizes(morphology):
    sizes, aspects = [], []
    for seed in range(20):
        balls = cluster_balls(5.0, None, None, np.random.default_rng(seed), morphology)
        assert 5 <= len(balls) <= 30
        for ball in balls:
            sizes.append((ball.volume_mm3 * 6.0 / np.pi) ** (1.0 / 3.0))
            aspects.append(1.0 + ball.half_length_mm / ball.radius_mm)
            reach = np.linalg.norm(ball.offset_mm) + ball.radius_mm + ball.half_length_mm
            assert reach <= 5.0 + 1e-9
    assert 0.1 - 1e-9 <= min(sizes) < max(sizes) <= SIZES[morphology].largest_mm + 1e-9
    # Some 350 drawn from a log-normal law: its median is known to 4 %.
    assert np.median(sizes) == pytest.approx(SIZES[morphology].median_mm, rel=0.12)
    assert SIZES[morphology].aspect[0] <= min(aspects) < max(aspects) <= SIZES[morphology].aspect[1]


def test_linear_calcifications_lie_in_a_row_towards_the_nipple():
    towards = np.array([0.6, 0.8, 0.0])
    for seed in range(5):
        rows = cluster_balls(5.0, 30, None, np.random.default_rng(seed), "linear", towards)
        loose = cluster_balls(5.0, 30, None, np.random.default_rng(seed), "punctate", towards)
        spread = [
            np.linalg.svd(np.array([b.offset_mm for b in balls]))[1] for balls in (rows, loose)
        ]
        # Second axis of the row against the first; the flattened ball has 3 to 4 in theory.
        assert spread[0][1] / spread[0][0] < 0.6
        assert spread[0][2] / spread[0][0] < spread[1][2] / spread[1][0]
        assert np.median([abs(ball.direction @ towards) for ball in rows]) > 0.8


@pytest.fixture
def with_artery(breast) -> BreastPhantom:
    """An artery of 3 voxels' radius along z in the gland."""
    i, j, _ = np.indices(breast.labels.shape)
    labels = breast.labels.copy()
    inside = (np.hypot(i - 26, j - 64) <= 3.0) & (labels == 29)
    labels[inside] = 150
    return dataclasses.replace(breast, labels=labels)


def test_vascular_calcifications_keep_to_the_wall_of_an_artery(with_artery):
    entry = lesion("v", "calcification", morphology="vascular", diameter_mm=10.0)
    made = insert_lesions(with_artery, [entry], rng())
    wall = made.labels == made.lesions[0].label
    assert wall.any()
    assert (with_artery.labels[wall] == 150).all()
    i, j, _ = np.nonzero(wall)
    assert np.hypot(i - 26, j - 64).min() > 1.5
    # The wall is 0.08 mm thick in voxels of half a millimetre.
    assert made.lesions[0].fill == pytest.approx(0.16)
    assert made.lesions[0].volume_mm3 == pytest.approx(wall.sum() * 0.125 * 0.16)


def test_vascular_calcifications_need_an_artery(breast):
    entry = lesion("v", "calcification", morphology="vascular", position_mm=(13.0, 0.0, 0.0))
    with pytest.raises(
        InputError, match=r"'v': no artery within 12\.5 mm of \[13\.0, 0\.0, 0\.0\]"
    ):
        insert_lesions(breast, [entry], rng())


def test_clusters_are_placed_in_lobular_units_where_there_are_any(breast):
    labels = breast.labels.copy()
    i, j, k = np.indices(labels.shape)
    units = (np.hypot(np.hypot(i - 26, j - 74), k - 64) <= 5.0) & (labels == 29)
    labels[units] = 95
    other = dataclasses.replace(breast, labels=labels)
    entry = lesion("c", "calcification", diameter_mm=2.0)
    for seed in range(4):
        made = insert_lesions(other, [entry], np.random.default_rng(seed)).lesions[0]
        place = np.array(other.frame.index(made.position_mm))
        assert np.linalg.norm(place - [26, 74, 64]) < 5.0 + 2.0


def test_a_clip_is_one_piece_of_its_length_and_volume(breast):
    from scipy import ndimage

    made = insert_lesions(breast, [lesion("k", "clip", position_mm=(15.0, 0, 0))], rng())
    clip = made.lesions[0]
    assert ndimage.label(made.labels == clip.label, np.ones((3, 3, 3)))[1] == 1
    assert clip.volume_mm3 == pytest.approx(np.pi * 0.25**2 * (2.5 + 4 / 3 * 0.25))
    assert clip.fill < 1.0


def test_rods_and_balls_against_counting():
    offsets = np.stack(np.meshgrid(*[np.arange(-3, 3.01, 0.05)] * 3, indexing="ij"), axis=-1)
    for shape in (Ball(np.zeros(3), 1.3), clip_ball(4.0, rng())):
        counted = shape.contains(offsets).sum() * 0.05**3
        # A grid of 0.05 mm counts a ball of 1.3 mm within 1 %, a rod of 0.25 mm within 5 %.
        assert counted == pytest.approx(shape.volume_mm3, rel=0.05)


def test_a_smooth_mass_is_rounder_than_a_spiculated_one():
    offsets = np.stack(np.meshgrid(*[np.arange(-5, 5.01, 0.25)] * 3, indexing="ij"), axis=-1)

    def roughness(margin):
        mask = inside_mass(offsets, 5.0, margin, rng())
        faces = sum(np.count_nonzero(np.diff(mask, axis=axis)) for axis in range(3))
        return faces / mask.sum() ** (2 / 3)

    margins = ("smooth", "lobulated", "spiculated", "distortion")
    found = [roughness(margin) for margin in margins]
    assert found == sorted(found)


def test_drawn_places_lie_in_gland_clear_of_skin_muscle_and_each_other(breast):
    entries = [lesion("a", diameter_mm=5.0), lesion("b", diameter_mm=5.0), lesion("k", "clip")]
    for seed in range(5):
        made = insert_lesions(breast, entries, np.random.default_rng(seed))
        centres = np.array([entry.position_mm for entry in made.lesions])
        # The gland is a ball of 8 mm about (13, 0, 0); half a coarse voxel may be added.
        assert (np.linalg.norm(centres - [13.0, 0, 0], axis=1) < 8.0 + 1.5).all()
        assert (centres[:2, 0] - 2.5 > 2.5).all()
        gap = np.linalg.norm(centres[0] - centres[1])
        assert gap > 4.0


def test_same_seed_same_lesions(breast):
    entries = [lesion("c", "calcification", diameter_mm=5.0), lesion("k", "clip")]
    first, second, other = (
        insert_lesions(breast, entries, np.random.default_rng(seed)).labels for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()


def test_every_lesion_outside_is_named_at_once(breast):
    entries = [
        lesion("far", position_mm=(500.0, 0, 0)),
        lesion("air", position_mm=(28.0, 20.0, 20.0)),
        lesion("edge", position_mm=(27.0, 0.0, 0.0), diameter_mm=8.0),
        lesion("wall", position_mm=(2.0, 0.0, 0.0), diameter_mm=8.0),
    ]
    with pytest.raises(InputError) as caught:
        insert_lesions(breast, entries, rng())
    far, air, edge, wall = caught.value.problems
    assert (
        "'far' at [500.0, 0.0, 0.0] mm lies outside the breast; the breast spans x 0 to 30" in far
    )
    assert "'air' at [28.0, 20.0, 20.0] mm lies outside the breast" in air
    assert "phantom.lesions.2: 'edge'" in edge
    assert "extends beyond the breast with its 8 mm" in edge
    assert "extends beyond the breast with its 8 mm" in wall


def test_overlaps_names_and_room(breast):
    first = lesion("a", position_mm=(13.0, 0, 0), diameter_mm=6)
    near = lesion("b", position_mm=(16.0, 0, 0), diameter_mm=6)
    with pytest.raises(InputError, match=r"'b' \(6 mm at \[16.0, 0.0, 0.0\] mm\) overlaps 'a'"):
        insert_lesions(breast, [first, near], rng())
    with pytest.raises(InputError, match="overlaps 'a'"):
        insert_lesions(insert_lesions(breast, [first], rng()), [near], rng())
    with pytest.raises(InputError, match="the name 'a' is used more than once"):
        insert_lesions(insert_lesions(breast, [first], rng()), [first], rng())
    with pytest.raises(InputError, match=r"'big': no place has room for its 60\.0 mm"):
        insert_lesions(breast, [lesion("big", diameter_mm=60.0)], rng())
    many = [lesion(f"m{n}", diameter_mm=1.0) for n in range(102)]
    with pytest.raises(InputError, match="found 102, at most 101 can be distinguished"):
        insert_lesions(breast, many, rng())


@pytest.mark.parametrize(
    ("values", "message"),
    [({}, "exactly one of 'file' and 'generate' must be given, found neither"),
     ({"file": "a.mhd", "generate": {}}, "found both"),
     ({"generate": {}, "labels": "victre"}, "'labels' belongs to 'file'"),
     ({"generate": {"density": "thick"}}, "phantom.generate.density: found 'thick'"),
     ({"generate": {"voxel": 1}}, "did you mean 'voxel_mm'"),
     ({"generate": {"voxel_mm": 0}}, "greater than or equal to 0.1"),
     ({"generate": {}, "lesions": [{"name": "a", "kind": "cyst"}]}, "lesions.0.kind: found 'cyst'"),
     ({"generate": {}, "lesions": [{"name": "a", "kind": "clip", "count": 3}]},
      "count does not belong to kind 'clip'"),
     ({"generate": {}, "lesions": [{"name": "a", "kind": "mass", "morphology": "linear"}]},
      "morphology does not belong to kind 'mass'"),
     ({"generate": {}, "lesions": [
         {"name": "a", "kind": "calcification", "morphology": "vascular", "count": 3}]},
      "count does not belong to morphology 'vascular'"),
     ({"generate": {}, "lesions": [{"name": "a", "kind": "mass", "diameter_mm": -1}]},
      "greater than or equal to 0.05"),
     ({"generate": {}, "lesions": [{"name": "a", "kind": "mass"}],
       "landmarks": [{"name": "a", "position_mm": [1, 2, 3]}]}, "'a' is used more than once"),
     ({"generate": {}, "landmarks": [{"name": "a"}]}, "landmarks.0.position_mm: missing")],
)  # fmt: skip
def test_settings_that_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        to_settings(PhantomSettings, values, "run.yaml", ("phantom",))


def test_make_phantom_reads_relative_to_the_folder_and_adds_everything(breast, tmp_path):
    np.savez(
        tmp_path / "b.npz", labels=breast.labels, voxel_mm=breast.voxel_mm,
        origin_mm=breast.origin_mm,
    )  # fmt: skip
    (tmp_path / "own.yaml").write_text("0: air\n1: adipose\n2: skin\n29: gland\n40: muscle\n")
    settings = PhantomSettings.model_validate(
        {"file": "b.npz", "labels": "own.yaml",
         "lesions": [{"name": "m", "kind": "mass", "diameter_mm": 4}],
         "landmarks": [{"name": "p", "position_mm": (10, 1, 1)}]}
    )  # fmt: skip
    made = make_phantom(settings, "R", 5, tmp_path)
    assert made.laterality == "R"
    assert [lesion.name for lesion in made.lesions] == ["m"]
    assert made.landmarks[0].name == "p"
    np.testing.assert_array_equal(made.landmarks[0].position_mm, [10, 1, 1])
    again = make_phantom(settings, "R", 5, tmp_path)
    np.testing.assert_array_equal(made.labels, again.labels)
    plain = read_phantom(tmp_path / "b.npz")
    assert np.count_nonzero(made.labels != plain.labels) > 0


def test_landmarks_outside_are_all_named(breast, tmp_path):
    np.savez(
        tmp_path / "b.npz", labels=breast.labels, voxel_mm=breast.voxel_mm,
        origin_mm=breast.origin_mm,
    )  # fmt: skip
    settings = PhantomSettings.model_validate(
        {"file": "b.npz", "landmarks": [
            {"name": "p", "position_mm": (99, 1, 1)}, {"name": "q", "position_mm": (29, 29, 29)}]}
    )  # fmt: skip
    with pytest.raises(InputError) as caught:
        make_phantom(settings, "L", 1, tmp_path)
    far, air = caught.value.problems
    assert "'p' at [99.0, 1.0, 1.0] mm lies outside the voxels; the breast spans" in far
    assert "'q' at [29.0, 29.0, 29.0] mm lies in air" in air
