"""The generated breast: what anatomy says of it, its repeatability, and its kernels' twins."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import ndimage

from mammosim.errors import InputError
from mammosim.geometry import compression_from_breast
from mammosim.phantom import generate_phantom, phantom_summary, read_phantom
from mammosim.phantom.anatomy import DENSITY_ALIASES, DENSITY_PERCENT, GenerateSettings, _kernels
from mammosim.phantom.anatomy.muscle import draw_muscle, fit_volume
from mammosim.phantom.anatomy.shape import coarse_frame, draw_shape, level, mesh, skin_depth
from mammosim.tissues import TISSUES
from tests.naive import phantom as naive

LABEL = {name: tissue.label for name, tissue in TISSUES.items()}


@pytest.fixture(scope="module")
def scattered():
    return generate_phantom("scattered", voxel_mm=0.75, seed=3)


@pytest.mark.parametrize("density", DENSITY_PERCENT)
@pytest.mark.parametrize("seed", [1, 2])
def test_density_and_volume_are_met(density, seed):
    breast = generate_phantom(density, voxel_mm=1.0, seed=seed, volume_ml=500.0)
    summary = phantom_summary(breast)
    # Sampled every 1.5 mm: tens of thousands of correlated voxels, well under a point off.
    assert summary.fibroglandular_percent == pytest.approx(DENSITY_PERCENT[density], abs=1.0)
    # The volume is set on a grid of 2 mm, and the nipple (0.6 mL) comes on top.
    assert summary.breast_ml == pytest.approx(500.0, rel=0.02)


def test_letters_and_a_percentage_of_ones_own():
    for letter, name in DENSITY_ALIASES.items():
        settings = GenerateSettings(density=letter)
        assert settings.density_class == name
        assert settings.target_percent == DENSITY_PERCENT[name]
    np.testing.assert_array_equal(
        generate_phantom("d", 3.0, 1).labels, generate_phantom("dense", 3.0, 1).labels
    )
    breast = generate_phantom("scattered", 1.0, 1, glandular_percent=30.0)
    assert phantom_summary(breast).fibroglandular_percent == pytest.approx(30.0, abs=1.0)


def test_every_tissue_is_there(scattered):
    present = {scattered.tissue_of_label[int(label)] for label in np.unique(scattered.labels)}
    assert present == set(TISSUES) - {"mass", "calcification", "clip"}


def test_one_body_with_air_all_around_but_at_the_chest_wall(scattered):
    tissue = scattered.labels != 0
    assert ndimage.label(tissue)[1] == 1
    assert tissue[0].any()
    for face in (tissue[-1], tissue[:, 0], tissue[:, -1], tissue[:, :, 0], tissue[:, :, -1]):
        assert not face.any()
    assert scattered.origin_mm[0] - 0.5 * scattered.voxel_mm[0] == 0.0


def test_skin_covers_the_breast_at_its_thickness():
    breast = generate_phantom("scattered", 0.5, seed=3, skin_mm=2.0, volume_ml=250.0)
    tissue = breast.labels != 0
    shown = np.concatenate([np.repeat(tissue[:1], 8, axis=0), tissue])  # no skin at the chest wall
    depth = ndimage.distance_transform_edt(shown, sampling=0.5)[8:]
    own = ~np.isin(breast.labels, [LABEL["nipple"], LABEL["duct"]])
    areola = np.zeros(tissue.shape, bool)
    areola[-60:, :, :] = True
    # Voxel centres lie between half a voxel and one and a half behind the nearest air voxel's.
    outer = tissue & own & ~areola & (depth < 1.5)
    inner = tissue & own & ~areola & (depth > 3.0)
    assert (breast.labels[outer] == LABEL["skin"]).mean() > 0.999
    assert not (breast.labels[inner] == LABEL["skin"]).any()


def test_gland_lies_under_fat_and_before_the_muscle(scattered):
    labels, voxel = scattered.labels, 0.75
    beneath = ndimage.distance_transform_edt(labels != 0, sampling=voxel)
    gland = labels == LABEL["gland"]
    retroareolar = np.zeros(labels.shape, bool)
    retroareolar[round((scattered.nipple_mm[0] - 25.0) / voxel) :] = True
    # Subcutaneous fat thins towards the nipple only.
    assert np.percentile(beneath[gland & ~retroareolar], 5) > 5.0
    assert gland[retroareolar].any()
    behind = ndimage.binary_dilation(labels == LABEL["muscle"], iterations=4)
    # Retromammary fat is 5 mm thick (SD 2.5) with a soft border: few strands come within 3 mm.
    assert (gland & behind).sum() < 0.01 * gland.sum()


def test_the_muscle_is_a_triangle_in_the_oblique_view(scattered):
    """Its depth falls from the top of the picture to the nipple's level."""
    rotation = compression_from_breast(45.0, scattered.laterality)
    index = np.argwhere(scattered.labels == LABEL["muscle"])
    points = scattered.frame.position_mm(index) @ rotation.T
    nipple_y = (rotation @ scattered.nipple_mm)[1]
    depths = [
        points[(points[:, 1] > low) & (points[:, 1] < low + 10.0), 0].max()
        for low in nipple_y + np.array([-40.0, 5.0, 25.0, 45.0, 60.0])
    ]
    assert depths[0] < 8.0
    assert (np.diff(depths) > 0).all()
    assert depths[-1] > 18.0


def test_tissue_covers_the_muscle(scattered):
    muscle = scattered.labels == LABEL["muscle"]
    near_air = ndimage.distance_transform_edt(scattered.labels != 0, sampling=0.75)
    # Seven millimetres of cover, less the diagonal of a voxel.
    assert near_air[muscle].min() > 7.0 - 1.3


def test_the_nipple_stands_out(scattered):
    nipple = scattered.frame.position_mm(np.argwhere(scattered.labels == LABEL["nipple"]))
    assert np.ptp(nipple[:, 1]) == pytest.approx(10.0, abs=1.5)
    np.testing.assert_allclose(nipple[:, 1:].mean(axis=0), 0.0, atol=0.75)
    np.testing.assert_allclose(scattered.nipple_mm[1:], 0.0, atol=0.75)
    higher = generate_phantom("scattered", 0.75, 3, nipple_height_mm=10.0)
    assert higher.nipple_mm[0] - scattered.nipple_mm[0] == pytest.approx(3.0, abs=0.8)


def test_ducts_lead_from_the_nipple_to_lobular_units(scattered):
    ducts = np.isin(scattered.labels, [LABEL["duct"], LABEL["tdlu"]])
    pieces, _ = ndimage.label(ducts, np.ones((3, 3, 3)))
    in_nipple = np.unique(pieces[-12:][ducts[-12:]])
    assert in_nipple.size > 0
    connected = np.isin(pieces, in_nipple[in_nipple > 0])
    # All hang together, but for bits of lobular units that a muscle or the skin cuts off.
    assert connected.sum() > 0.95 * ducts.sum()


def test_a_right_breast_is_the_mirror_image_and_is_recognised_when_read(tmp_path):
    left, right = (generate_phantom("b", 1.5, 4, side) for side in "LR")
    np.testing.assert_array_equal(left.labels, right.labels[:, ::-1])
    mirrored = left.frame.position_mm(np.array(left.labels.shape) - 1) * [1, -1, 1]
    np.testing.assert_allclose(right.origin_mm[1], mirrored[1])
    for breast in (left, right):
        path = tmp_path / f"{breast.laterality}.npz"
        np.savez(path, labels=breast.labels, voxel_mm=breast.voxel_mm, origin_mm=breast.origin_mm)
        read = read_phantom(path)
        assert read.laterality == breast.laterality
        assert read.notes == ()
        np.testing.assert_allclose(read.nipple_mm, breast.nipple_mm)


@pytest.mark.parametrize("seed", range(20, 32))
def test_the_side_is_told_for_many_seeds(seed, tmp_path):
    breast = generate_phantom("abcd"[seed % 4], 2.0, seed, "LR"[seed % 2])
    path = tmp_path / "b.npz"
    np.savez(path, labels=breast.labels, voxel_mm=breast.voxel_mm, origin_mm=breast.origin_mm)
    assert read_phantom(path).laterality == breast.laterality


def test_threads_do_not_change_a_voxel_and_seeds_do():
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = generate_phantom("c", 1.5, 9).labels
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(one, generate_phantom("c", 1.5, 9).labels)
    other = generate_phantom("c", 1.5, 10).labels
    assert one.shape != other.shape or (one != other).any()


def test_the_anatomy_does_not_depend_on_the_voxel():
    coarse, fine = (generate_phantom("c", voxel, 6) for voxel in (3.0, 1.0))
    index = np.argwhere(np.ones(coarse.labels.shape))
    at = fine.frame.index(coarse.frame.position_mm(index))
    inside = ((at > -0.5) & (at < np.array(fine.labels.shape) - 0.5)).all(axis=1)
    np.testing.assert_allclose(at, np.rint(at), atol=1e-9)  # centres coincide at 3 to 1
    here = coarse.labels[tuple(index[inside].T)]
    there = fine.labels[tuple(np.rint(at[inside]).astype(int).T)]
    for name in ("air", "skin", "muscle"):
        np.testing.assert_array_equal(here == LABEL[name], there == LABEL[name])
    # Thin tubes take more room in coarse voxels, which leaves less to be gland: the threshold is
    # higher, and what is gland above it is gland above the lower one.
    np.testing.assert_array_equal(there[here == LABEL["gland"]], LABEL["gland"])


def test_projected_texture_has_the_power_law_of_mammograms():
    """P(f) ~ f^-b with b 2.8 on average, 1.5 to 3.5 over breasts (Burgess), over 25 mm squares."""
    exponents = []
    for seed in (1, 2, 3):
        breast = generate_phantom("bcd"[seed - 1], 0.5, seed, volume_ml=400.0)
        dense = np.isin(breast.labels, [LABEL[n] for n in ("gland", "ligament", "duct", "tdlu")])
        picture = dense.sum(axis=2) * 0.5
        middle = round(-breast.origin_mm[1] / 0.5)
        square = picture[50:100, middle - 25 : middle + 25]
        window = np.hanning(50)[:, None] * np.hanning(50)
        power = np.abs(np.fft.fft2((square - square.mean()) * window)) ** 2
        f = np.hypot(*np.meshgrid(*[np.fft.fftfreq(50, 0.5)] * 2, indexing="ij"))
        rings = [(f >= low) & (f < low + 0.055) for low in np.arange(0.15, 0.69, 0.055)]
        mean = [(f[ring].mean(), power[ring].mean()) for ring in rings]
        exponents.append(-np.polyfit(*np.log(np.array(mean)).T, 1)[0])
    assert 2.3 < np.mean(exponents) < 3.7
    # One square a breast: the exponent of a single one scatters by some tenths.
    assert all(1.5 < exponent < 3.8 for exponent in exponents)


def test_volumes_drawn_by_the_seed_vary():
    volumes = [phantom_summary(generate_phantom("b", 4.0, seed)).breast_ml for seed in range(5)]
    assert 330 < min(volumes) < max(volumes) < 950
    assert np.ptp(volumes) > 60


@pytest.mark.parametrize(
    ("keys", "message"),
    [({"laterality": "left"}, "laterality: found 'left', expected L or R"),
     ({"seed": -1}, "seed: found -1, expected a whole number of 0 or more"),
     ({"seed": True}, "seed: found True"),
     ({"density": "e"}, "generate_phantom: density: found 'e'"),
     ({"voxel_mm": 9.0}, "less than or equal to 4"),
     ({"colour": 1}, "colour: unknown key")],
)  # fmt: skip
def test_mistakes_are_named(keys, message):
    with pytest.raises(InputError, match=message):
        generate_phantom(**keys)


@pytest.mark.parametrize("volume", [150.0, 1800.0])
def test_extremes_stay_within_the_coarse_grid(volume):
    breast = generate_phantom("d", 4.0, 5, volume_ml=volume, nipple_height_mm=12.0)
    assert phantom_summary(breast).breast_ml == pytest.approx(volume, rel=0.1)


def test_skin_depth_is_a_distance():
    shape = draw_shape(np.random.default_rng(1))
    frame = coarse_frame(shape)
    depth = skin_depth(shape, frame)
    gradient = np.gradient(depth, 2.0)
    slope = np.sqrt(sum(part**2 for part in gradient))
    near = (depth > -2.0) & (depth < 2.0) & (mesh(frame)[0] > 2.0)
    # First order: within 3 % of unit slope near the skin on average, where skin is drawn.
    assert slope[near].mean() == pytest.approx(1.0, abs=0.03)
    assert ((depth > 0) == (level(shape, mesh(frame)) > 0)).all()


def test_fit_volume_scales_shape_not_its_proportions():
    rng = np.random.default_rng(2)
    shape, muscle = draw_shape(rng), draw_muscle(rng)
    fitted = fit_volume(shape, muscle, 400.0)
    assert fitted.depth_mm / fitted.radius_mm == pytest.approx(shape.depth_mm / shape.radius_mm)
    assert fitted.tail == shape.tail


def test_noise_agrees_with_its_twin():
    points = np.random.default_rng(1).uniform(-40.0, 40.0, (50, 3))
    for point in points:
        assert _kernels.gradient_noise(*point, 77) == pytest.approx(
            naive.gradient_noise(point, 77), abs=1e-10
        )


def test_noise_is_zero_at_lattice_points_and_of_unit_variance():
    for point in np.random.default_rng(2).integers(-30, 30, (20, 3)).astype(float):
        assert _kernels.gradient_noise(*point, 3) == 0.0
    points = np.random.default_rng(3).uniform(-200.0, 200.0, (4000, 3))
    values = np.array([_kernels.gradient_noise(*point, 3) for point in points])
    # 4000 nearly independent values: the mean is known to 0.016, the variance to 3 % or so.
    assert abs(values.mean()) < 0.06
    assert values.var() == pytest.approx(1.0, abs=0.12)


def test_lobules_agree_with_their_twin():
    rng = np.random.default_rng(4)
    seeds = np.empty((5, 5, 5, 4), np.float32)
    seeds[..., :3], seeds[..., 3] = rng.uniform(0.12, 0.88, (5, 5, 5, 3)), rng.random((5, 5, 5))
    texture = _kernels.Texture(
        np.zeros((2, 2, 2, 7), np.float32), seeds, np.array([1.0, 2.0, 3.0]), 10.0, np.zeros(3),
        np.zeros(1), np.ones(1), np.zeros(1), np.ones(1), 1.0, 0,
    )  # fmt: skip
    points = (np.stack(np.indices((5, 5, 5)), axis=-1) + seeds[..., :3]).reshape(-1, 3)
    for place in rng.uniform(1.5, 3.5, (60, 3)):
        found = _kernels._lobules(texture, *(place * 10.0 + [1.0, 2.0, 3.0]))
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
    _kernels.paint_tubes(labels, lattice, ends, radius, label)
    for index in np.ndindex(labels.shape):
        point, wanted = np.array(index) * 0.5, 0
        for piece in range(2):
            if naive.in_cone(point, *ends[piece], radius[piece]) or naive.on_axis(
                point, *ends[piece], 0.5
            ):
                wanted = label[piece]
        assert labels[index] == wanted


def test_the_nipple_is_a_cylinder_with_a_dome():
    nipple = np.array([50.0, 7.0, 5.0])
    assert _kernels._nipple_distance(52.0, 0.0, 0.0, nipple) < 0.0
    assert _kernels._nipple_distance(57.0, 0.0, 0.0, nipple) == pytest.approx(0.0, abs=1e-12)
    assert _kernels._nipple_distance(50.0, 5.0, 0.0, nipple) == pytest.approx(0.0, abs=1e-12)
    assert _kernels._nipple_distance(50.0, 8.0, 0.0, nipple) == pytest.approx(3.0)
    assert _kernels._nipple_distance(56.9, 4.0, 0.0, nipple) > 0.0
