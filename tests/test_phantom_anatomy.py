"""The generated breast: what anatomy says of it, its repeatability, and its kernels' twins."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from scipy import ndimage

import mammosim
from mammosim.errors import InputError
from mammosim.geometry import compression_from_breast
from mammosim.phantom import (
    LesionSettings,
    PhantomSettings,
    generate_outline,
    generate_phantom,
    insert_lesions,
    phantom_summary,
    read_phantom,
    without_open_end,
)
from mammosim.phantom.anatomy import (
    DENSITY_ALIASES,
    DENSITY_PERCENT,
    GenerateSettings,
    _surface_kernels,
    expected_volume_ml,
)
from mammosim.phantom.anatomy.axilla import along_mm, draw_axilla
from mammosim.phantom.anatomy.body import draw_body, paint_of
from mammosim.phantom.anatomy.fold import draw_fold
from mammosim.phantom.anatomy.muscle import SHEET_MM, draw_muscle, fit_volume
from mammosim.phantom.anatomy.outline import Outline, coarse_frame, mesh, skin_depth, surfaces_of
from mammosim.phantom.anatomy.parenchyma import draw_parenchyma
from mammosim.phantom.anatomy.shape import draw_shape, like
from mammosim.phantom.open_end import abdominal_counts
from mammosim.phantom.size import expected_voxels
from mammosim.tissues import TISSUES

LABEL = {name: tissue.label for name, tissue in TISSUES.items()}


@pytest.fixture(scope="module")
def scattered():
    return generate_phantom(
        "scattered", voxel_mm=0.75, seed=3, volume_ml=500, skin_mm=1.45, lymph_nodes=1,
        benign_calcifications="popcorn",
    )  # fmt: skip


def from_open_end(breast):
    """Distance of every column of voxels along x from the open end, into the breast, mm."""
    axes = [
        breast.origin_mm[n] + breast.voxel_mm[n] * np.arange(breast.labels.shape[n]) for n in (1, 2)
    ]
    y, z = np.ix_(*axes)
    end = breast.open_end
    return end.point_mm @ end.normal - y * end.normal[1] - z * end.normal[2]


def part_ml(breast, side):
    """Volume without muscle on the axilla's side of the nipple (1) or the other (-1), mL."""
    own = (breast.labels != 0) & (breast.labels != LABEL["muscle"])
    points = breast.frame.position_mm(np.argwhere(own))
    there = side * along_mm(points[:, 1], points[:, 2]) > 0.0
    return there.sum() * np.prod(breast.voxel_mm) / 1000.0


def test_outline_alone_is_that_of_the_breast():
    settings = GenerateSettings(
        density="dense", voxel_mm=4.0, volume_ml=300.0, nipple_height_mm=8.0
    )
    breast, outline = (
        make(settings, seed=2, laterality="R") for make in (generate_phantom, generate_outline)
    )
    np.testing.assert_array_equal(outline.origin_mm, breast.origin_mm)
    tissue, same = breast.labels > 0, (breast.labels > 0) == (outline.labels > 0)
    surface = tissue & ~ndimage.binary_erosion(tissue, np.ones((3, 3, 3)))
    near = ndimage.binary_dilation(surface, np.ones((3, 3, 3)))
    assert same[~near].all()
    assert (~same).sum() < 0.05 * tissue.sum()
    np.testing.assert_allclose(outline.nipple_mm, breast.nipple_mm, atol=4.0)
    here, there = phantom_summary(outline), phantom_summary(breast)
    assert here.breast_ml == pytest.approx(there.breast_ml, rel=0.03)
    assert here.fibroglandular_percent == pytest.approx(there.fibroglandular_percent, abs=4.0)
    np.testing.assert_array_equal(outline.open_end.held_depth_mm, breast.open_end.held_depth_mm)


@pytest.mark.parametrize("density", DENSITY_PERCENT)
@pytest.mark.parametrize("seed", [1, 2])
def test_density_and_volume_are_met(density, seed):
    # Voxels of 1.5 mm meet the noise's lattice of 2 mm at the same few places again and again.
    breast = generate_phantom(density, voxel_mm=1.5, seed=seed, volume_ml=220.0)
    summary = phantom_summary(breast)
    # Sampled every 1.5 mm: tens of thousands of correlated voxels, well under a point off.
    assert summary.fibroglandular_percent == pytest.approx(DENSITY_PERCENT[density], abs=1.0)
    # The volume is set on a grid of 2 mm, and the nipple (0.6 mL) comes on top.
    assert summary.breast_ml == pytest.approx(220.0, rel=0.02)
    # There is no gland in the abdominal wall.
    below_fold = abdominal_counts(breast)
    assert below_fold[LABEL["gland"]] == 0
    assert below_fold[LABEL["adipose"]] > 0


def test_letters_and_a_percentage_of_ones_own():
    for letter, name in DENSITY_ALIASES.items():
        settings = GenerateSettings(density=letter)
        assert settings.density_class == name
        assert settings.target_percent == DENSITY_PERCENT[name]
    letter, name = (generate_phantom(key, 3.0, 1, volume_ml=120.0) for key in ("d", "dense"))
    np.testing.assert_array_equal(letter.labels, name.labels)
    breast = generate_phantom("scattered", 1.0, 1, glandular_percent=30.0, volume_ml=200.0)
    assert phantom_summary(breast).fibroglandular_percent == pytest.approx(30.0, abs=1.0)


def test_every_tissue_is_there(scattered):
    present = {scattered.tissue_of_label[int(label)] for label in np.unique(scattered.labels)}
    assert present == {
        "air", "adipose", "skin", "gland", "nipple", "muscle", "lymph_node", "ligament",
        "ligament_eighth", "ligament_quarter", "ligament_half", "tdlu", "duct", "artery", "vein",
        "benign_calcification", "benign_calcification_eighth", "benign_calcification_quarter",
        "benign_calcification_half",
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["none", "rods"])
def test_what_is_found_in_healthy_breasts_is_labelled_but_no_lesion(kind):
    asked = {"volume_ml": 200.0, "skin_mm": 1.5, "benign_calcifications": kind}
    bare = generate_phantom("a", 1.0, 4, lymph_nodes=0, **asked)
    breast = generate_phantom("a", 1.0, 4, lymph_nodes=3, moles=4, skin_folds=1, **asked)
    assert breast.lesions == ()
    volume_ml = phantom_summary(breast).volume_ml
    volume = {name: 1000.0 * volume_ml.get(name, 0.0)  # mm3
              for name in ("lymph_node", "benign_calcification")}  # fmt: skip
    # A node of 2.5 by 3 by 2 mm less its hilum has some tens of cubic millimetres.
    assert volume["lymph_node"] > 60
    assert not (bare.labels == LABEL["lymph_node"]).any()
    # By lot: of small ones, a twentieth of a cubic millimetre, there may be none at this voxel.
    assert volume["benign_calcification"] < 60
    assert volume["benign_calcification"] > 0 or kind in ("none", "round", "vascular", "skin")
    # Moles stand out of the skin, into what was air.
    stands_out = (breast.labels != 0) & (bare.labels == 0)
    assert stands_out.sum() > 20
    np.testing.assert_array_equal(breast.labels[stands_out], LABEL["skin"])
    # The fold's two layers of skin lie within what was breast.
    folded = (breast.labels == LABEL["skin"]) & (bare.labels != LABEL["skin"]) & (bare.labels != 0)
    assert folded.sum() > 50


def test_one_body_with_air_all_around_but_at_the_chest_wall(scattered):
    tissue = scattered.labels != 0
    assert ndimage.label(tissue)[1] == 1
    assert tissue[0].any()
    for face in (tissue[-1], tissue[:, 0], tissue[:, -1], tissue[:, :, 0], tissue[:, :, -1]):
        assert not face.any()
    # No more air than needed: 2 mm at the open end and the nipple, elsewhere the skin's dither.
    voxels = np.argwhere(tissue)
    below, above = voxels.min(axis=0), np.array(tissue.shape) - 1 - voxels.max(axis=0)
    assert below.max() <= 3
    assert above.max() * 0.75 <= 2.0 + 3 * 0.75
    assert scattered.origin_mm[0] - 0.5 * scattered.voxel_mm[0] == 0.0


def test_skin_covers_the_breast_at_its_thickness():
    breast = generate_phantom("scattered", 0.5, seed=3, skin_mm=2.0, volume_ml=250.0)
    tissue = breast.labels != 0
    shown = np.concatenate([np.repeat(tissue[:1], 8, axis=0), tissue])  # no skin at the chest wall
    depth = ndimage.distance_transform_edt(shown, sampling=0.5)[8:]
    # The areola's skin is thicker, within 30 mm of the nipple's axis, and there is none where the
    # body goes on.
    own = ~np.isin(breast.labels, [LABEL["nipple"], LABEL["duct"]]) & (from_open_end(breast) > 5.0)
    across = [breast.origin_mm[n] + 0.5 * np.arange(tissue.shape[n]) for n in (1, 2)]
    own &= np.hypot(*np.ix_(*across)) > 30.0
    # Voxel centres lie between half a voxel and one and a half behind the nearest air voxel's.
    # Nowhere it is more than 1.7 times as thick as on average, nor less than half.
    outer, inner = tissue & own & (depth < 1.0), tissue & own & (depth > 1.7 * 2.0 + 0.75)
    assert (breast.labels[outer] == LABEL["skin"]).mean() > 0.999
    assert not (breast.labels[inner] == LABEL["skin"]).any()


def test_the_areola_has_thicker_skin(scattered):
    """Along x, beside the nipple, against the same place without the extra 0.6 to 1.9 mm."""
    labels = scattered.labels
    nipple = np.rint(scattered.frame.index(scattered.nipple_mm)).astype(int)
    y, z = nipple[1:]
    ring = [labels[:, y + a, z + b] for a in range(-12, 13) for b in range(-12, 13)
            if 8.5 <= 0.75 * np.hypot(a, b) <= 9.0]  # fmt: skip
    thickness = np.mean([(line == LABEL["skin"]).sum() * 0.75 for line in ring])
    # The surface is inclined to x by up to 30 degrees there, which makes lines in it longer.
    assert 1.45 + 0.3 < thickness < (1.45 + 1.9) / np.cos(np.deg2rad(35.0))


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
    # Retromammary fat is 9 mm thick (SD 3) with a soft border: few strands come within 3 mm.
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


def test_the_muscle_is_as_thick_towards_the_axilla_as_oblique_images_show_it():
    """There it is 30 to 58 mm wide once pressed, and 15 mm of it lie behind the image."""
    at_end, at_nipple, below = [], [], []
    for seed in range(12):
        settings = GenerateSettings(volume_ml=250.0 + 80.0 * seed)
        body = draw_body(settings, seed, "LR"[seed % 2])
        x, lateral, superior = mesh(body.frame)
        way = along_mm(lateral, superior)
        front = (x + body.behind_mm)[0]  # the depth falls by a millimetre a millimetre along x
        at_end.append(front[np.abs(way[0] - body.outline.axilla.cut_mm) < 2.0].max())
        at_nipple.append(front[np.abs(way[0]) < 2.0].max())
        below.append(front[np.broadcast_to(superior[0] < 0.0, front.shape)].max())
    assert 30.0 < min(at_end) < max(at_end) < 65.0
    assert np.std(at_end) > 3.0
    # The triangle ends at about the nipple's level; the slab below is that of the chest wall.
    assert 12.0 < np.median(at_nipple) < 22.0
    assert max(below) < 6.0


def test_tissue_covers_the_muscle(scattered):
    muscle = (scattered.labels == LABEL["muscle"]) & (from_open_end(scattered) > 10.0)
    near_air = ndimage.distance_transform_edt(scattered.labels != 0, sampling=0.75)
    # Seven millimetres of cover, less the diagonal of a voxel and half of one for the dither.
    assert near_air[muscle].min() > 7.0 - 1.3 - 0.4


def test_the_muscle_holds_some_fat(scattered):
    muscle = ndimage.binary_closing(scattered.labels == LABEL["muscle"], iterations=4)
    fat = (scattered.labels == LABEL["adipose"]) & ndimage.binary_erosion(muscle, iterations=3)
    assert 0.02 < fat.sum() / muscle.sum() < 0.2


def test_the_nipple_stands_out():
    settings = {"volume_ml": 150.0, "nipple_diameter_mm": 10.0}
    low, high = (
        generate_phantom("b", 0.5, 3, nipple_height_mm=height, **settings) for height in (5, 9)
    )
    nipple = low.frame.position_mm(np.argwhere(low.labels == LABEL["nipple"]))
    # Its very foot is 3 mm wider all around, and it is uneven by 1.1 mm.
    assert 10.0 < np.ptp(nipple[:, 1]) < 10.0 + 2 * (3.0 + 1.1) + 0.5
    # It stands on the axis, and leans from there, most where the skin faces.
    body = draw_body(GenerateSettings(volume_ml=150.0), 3, "L")
    foot_mm, tilt = body.outline.shape.depth_mm, paint_of(body).nipple[4:6]
    foot = nipple[np.abs(nipple[:, 0] - foot_mm) < 1.0, 1:].mean(axis=0)
    np.testing.assert_allclose(foot, 0.0, atol=1.5)
    top = high.frame.position_mm(np.argwhere(high.labels == LABEL["nipple"]))
    leaning = top[np.abs(top[:, 0] - foot_mm - 7.0) < 1.0, 1:].mean(axis=0)
    np.testing.assert_allclose(leaning, 7.0 * tilt, atol=1.5)
    np.testing.assert_allclose(low.nipple_mm[1:], 0.0, atol=3.0)
    assert high.nipple_mm[0] - low.nipple_mm[0] == pytest.approx(4.0, abs=0.8)


def test_ducts_lead_from_the_nipple_to_lobular_units(scattered):
    ducts = np.isin(scattered.labels, [LABEL["duct"], LABEL["tdlu"]])
    pieces, _ = ndimage.label(ducts, np.ones((3, 3, 3)))
    in_nipple = np.unique(pieces[-12:][ducts[-12:]])
    assert in_nipple.size > 0
    connected = np.isin(pieces, in_nipple[in_nipple > 0])
    # All hang together, but for bits of lobular units that a muscle or the skin cuts off.
    assert connected.sum() > 0.95 * ducts.sum()


def test_the_other_breast_is_alike_but_no_mirror_image():
    """Over women: sizes within a tenth or so, shapes closer than those of other women."""
    left, right = (generate_phantom("b", 4.0, 1, side, volume_ml=150.0).labels for side in "LR")
    assert left.shape != right.shape or (left != right[:, ::-1]).mean() > 0.02
    settings = GenerateSettings()
    volumes = [[expected_volume_ml(settings, seed, side) for side in "LR"] for seed in range(6)]
    # Sizes differ by a factor with a spread of 4 % a breast, cut off at two of them.
    apart = np.abs(np.diff(np.log(volumes), axis=1))
    assert 0.0 < apart.min() <= apart.max() < 0.19


def test_shapes_of_a_pair_are_closer_than_those_of_two_women():
    rng = np.random.default_rng(6)
    women = [draw_shape(600.0, rng) for _ in range(30)]
    pairs = [[like(woman, rng) for _ in range(2)] for woman in women]
    names = ("depth_mm", "lateral", "medial", "upper", "lower")
    axes = np.log([[[getattr(one, name) for name in names] for one in pair] for pair in pairs])
    within = axes.std(axis=1).mean(axis=0)
    assert (within < 0.6 * axes.mean(axis=1).std(axis=0)).all()


def test_a_set_volume_is_that_of_both_breasts():
    for side in "LR":
        breast = generate_phantom("b", 2.0, 7, side, volume_ml=150.0)
        assert phantom_summary(breast).breast_ml == pytest.approx(150.0, rel=0.03)


def test_a_breast_is_recognised_when_read(tmp_path):
    # In voxels of 1.5 mm thin skin has gaps, which hide where the breast is cut off.
    for breast in (generate_phantom("b", 1.0, 4, side, volume_ml=250.0) for side in "LR"):
        path = tmp_path / f"{breast.laterality}.npz"
        np.savez(path, labels=breast.labels, voxel_mm=breast.voxel_mm, origin_mm=breast.origin_mm)
        read = read_phantom(path)
        assert read.laterality == breast.laterality
        assert len(read.notes) == 2
        assert "guessed from the muscle wedge" in read.notes[0]
        assert "taken for the way to the axilla" in read.notes[1]
        assert read.open_end.normal @ breast.open_end.normal > 0.99
        np.testing.assert_allclose(read.nipple_mm, breast.nipple_mm)


def test_dense_breasts_hold_more_fibres_than_fatty_ones():
    """In the middle of the differences between women."""
    rng = np.random.default_rng(4)
    fibres = {
        density: np.median([draw_parenchyma(density, rng).threads for _ in range(200)])
        for density in DENSITY_PERCENT
    }
    assert fibres["fatty"] == pytest.approx(1.0, abs=0.1)
    assert fibres["heterogeneous"] > 1.15 * fibres["scattered"]
    assert fibres["dense"] > 1.4 * fibres["fatty"]


def test_septa_are_reported_and_do_not_depend_on_the_voxel():
    """Walls of some tenths of a millimetre fill the same volume in voxels of any size."""
    ligament = [
        phantom_summary(generate_phantom("a", voxel, 6, volume_ml=200.0)).volume_ml["ligament"]
        for voxel in (0.5, 1.0)
    ]
    # Of 200 mL, some hundred thousand voxels by lot; skin and tubes are coarser in the larger.
    assert ligament[0] == pytest.approx(ligament[1], rel=0.05)
    # Walls, their edges and threads together: a tenth to a sixth of a fatty breast.
    assert 10.0 < ligament[0] < 40.0


@pytest.mark.parametrize("seed", range(20, 32))
def test_the_side_is_told_for_many_seeds(seed, tmp_path):
    settings = GenerateSettings(
        density="abcd"[seed % 4], voxel_mm=2.0, volume_ml=120.0 + 50.0 * (seed - 20)
    )
    make = generate_phantom if seed < 23 else generate_outline  # whose muscle is the same
    breast = make(settings, seed=seed, laterality="LR"[seed % 2])
    path = tmp_path / "b.npz"
    np.savez(path, labels=breast.labels, voxel_mm=breast.voxel_mm, origin_mm=breast.origin_mm)
    assert read_phantom(path).laterality == breast.laterality


def test_threads_do_not_change_a_voxel_and_seeds_do():
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = generate_phantom("c", 1.5, 9, volume_ml=100.0).labels
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(one, generate_phantom("c", 1.5, 9, volume_ml=100.0).labels)
    other = generate_phantom("c", 1.5, 10, volume_ml=100.0).labels
    assert one.shape != other.shape or (one != other).any()


def test_the_anatomy_does_not_depend_on_the_voxel():
    coarse, fine = (generate_phantom("c", voxel, 6, volume_ml=500) for voxel in (3.0, 1.0))
    index = np.argwhere(np.ones(coarse.labels.shape))
    at = fine.frame.index(coarse.frame.position_mm(index))
    inside = ((at > -0.5) & (at < np.array(fine.labels.shape) - 0.5)).all(axis=1)
    np.testing.assert_allclose(at, np.rint(at), atol=1e-9)  # centres coincide at 3 to 1
    here = coarse.labels[tuple(index[inside].T)]
    place = tuple(np.rint(at[inside]).astype(int).T)
    there = fine.labels[place]
    # Surfaces are dithered by up to half a voxel, here 1.5 mm, about skin of up to 2.5 mm.
    air = fine.labels == 0
    depth = ndimage.distance_transform_edt(~air) - ndimage.distance_transform_edt(air)
    clear = (depth[place] < -3.0) | (depth[place] > 6.0)
    for name in ("air", "skin"):
        np.testing.assert_array_equal(here[clear] == LABEL[name], there[clear] == LABEL[name])
    # The muscle's front is uneven on the scale of the coarse voxels.
    muscle = here[clear] == LABEL["muscle"], there[clear] == LABEL["muscle"]
    assert np.mean(muscle[0] != muscle[1]) < 0.015
    # Thin tubes take more room in coarse voxels, which leaves less to be gland: the threshold is
    # higher, and what is gland above it is gland above the lower one.
    np.testing.assert_array_equal(there[clear & (here == LABEL["gland"])], LABEL["gland"])
    # The dither keeps volumes: 300 mL and more of tissue are some 12 000 coarse voxels.
    voxels = [np.count_nonzero(breast.labels) * breast.voxel_mm.prod() for breast in (coarse, fine)]
    assert voxels[0] == pytest.approx(voxels[1], rel=0.01)


def test_a_dithered_surface_is_where_it_should_be_on_average():
    """Slabs whose face lies anywhere between two layers, and skin that keeps its thickness."""
    for face in np.linspace(10.0, 11.0, 9):
        layers = np.zeros((12, 12), int)
        skin = np.zeros((12, 12), int)
        for i, j, k in np.ndindex(12, 12, 20):
            depth = k - face  # in voxels, the slab goes on upwards
            corner = np.arange(8)[None] % 2 * 2.0  # its gradient points along the last axis
            shifted = depth + _surface_kernels.dither(i, j, k, corner)
            layers[i, j] += shifted > 0.0
            skin[i, j] += 0.0 < shifted < 3.0
        # 144 random shifts would have a standard error of 0.042; these have 0.02.
        assert layers.mean() == pytest.approx(19.5 - face, abs=0.03)
        assert np.ptp(layers) <= 1
        np.testing.assert_array_equal(skin, 3)


def test_the_dither_is_half_a_voxel_at_most_along_its_axis():
    rng = np.random.default_rng(3)
    for corner in rng.standard_normal((200, 8)):
        slope = [corner[4:].sum() - corner[:4].sum(),
                 corner[[2, 3, 6, 7]].sum() - corner[[0, 1, 4, 5]].sum(),
                 corner[1::2].sum() - corner[::2].sum()]  # fmt: skip
        bound = 0.5 * np.abs(slope).max() / np.linalg.norm(slope)
        shift = _surface_kernels.dither(*rng.integers(0, 1000, 3), corner[None])
        assert abs(shift) <= bound + 1e-12


def spectral_exponent(grey, inside, pitch_mm, low=0.15, high=0.7):
    """b of P(f) ~ f^-b: slope of the mean log spectrum of squares of 12.8 mm, tapered by Hann."""
    n = round(12.8 / pitch_mm)
    taper = np.hanning(n)[:, None] * np.hanning(n)
    radius = np.hypot(*np.meshgrid(np.fft.fftfreq(n, pitch_mm), np.fft.fftfreq(n, pitch_mm)))
    ring = np.rint(radius * n * pitch_mm).astype(int)
    spectra = []
    for i in range(0, grey.shape[0] - n + 1, n // 2):
        for j in range(0, grey.shape[1] - n + 1, n // 2):
            square = np.s_[i : i + n, j : j + n]
            if inside[square].all():
                part = grey[square] - grey[square].mean()
                spectra.append(np.log(np.abs(np.fft.fft2(part * taper)) ** 2))
    assert len(spectra) >= 4
    power = np.exp(np.mean(spectra, axis=0))
    frequency = np.arange(1, n // 2) / (n * pitch_mm)
    mean = np.array([power[ring == k].mean() for k in range(1, n // 2)])
    used = (frequency >= low) & (frequency <= high)
    return -np.polyfit(np.log(frequency[used]), np.log(mean[used]), 1)[0]


def test_structure_has_the_power_law_of_mammograms():
    """P(f) ~ f^-b with b 2.8 on average, 1.5 to 3.5 over breasts (Burgess).

    Of what attenuates beside fat, in straight rays through 30 mm of breasts with voxels of 0.3 mm,
    large enough for four squares without muscle: no compression and no blur. Septa and threads are
    thinner than any voxel of a quick test, and in coarse ones their fill would be drawn over more
    than the wavelengths measured.
    """
    part = np.zeros(256, np.float32)
    for name, tissue in TISSUES.items():
        if name in ("gland", "duct", "tdlu", "ligament", "artery", "vein"):
            part[tissue.label] = 1.0
        elif tissue.mixture:
            part[tissue.label] = tissue.mixture.get("ligament", 0.0)
    exponents = []
    # Breasts differ by 0.15, so that the mean of six is known to 0.06.
    for density, seed in (("b", 102), ("b", 103), ("c", 201), ("c", 202), ("d", 301), ("d", 302)):
        breast = generate_phantom(density, 0.3, seed, volume_ml=300.0)
        middle = round(-breast.origin_mm[2] / 0.3)
        slab = breast.labels[:, :, middle - 50 : middle + 50]
        inside = ~np.isin(slab, [LABEL["air"], LABEL["skin"], LABEL["muscle"]])
        whole = inside.mean(axis=2) > 0.8
        exponents.append(spectral_exponent(part[slab].sum(axis=2) * 0.3, whole, 0.3))
    assert 2.5 < np.mean(exponents) < 3.3
    assert all(1.5 < exponent < 3.6 for exponent in exponents)


def test_the_open_end_has_no_skin_and_other_views_leave_it_off(scattered):
    within = from_open_end(scattered)
    last = (within > 0.0) & (within < 0.75)
    column = scattered.labels[:, last]
    # Skin is the border of the cut only, not its face.
    assert 0.02 < (column == LABEL["skin"]).sum() / (column != 0).sum() < 0.25
    assert not scattered.labels[:, within < 0.0].any()
    held = without_open_end(scattered)
    assert held.open_end is None
    assert held.muscle_standing == scattered.open_end.standing < scattered.muscle_standing == 1.0
    index = np.argwhere(held.labels != 0)[::97]
    places = held.frame.position_mm(index)
    at = np.rint(scattered.frame.index(places)).astype(int)
    depth = scattered.open_end.held_depth_at(places)
    assert depth.min() > -0.75  # half a voxel of dither, and the skin's curvature
    # What remains is what it was, where it was, but for skin where the axilla began, the fat under
    # it that covers the muscle by 7 mm, and that before the muscle, which stands off less.
    there, here = scattered.labels[tuple(at.T)], held.labels[tuple(index.T)]
    inner = depth > scattered.open_end.skin_mm + 0.75
    muscle, off = there == LABEL["muscle"], depth - 7.0
    layers = np.arange(1, scattered.labels.shape[0] + 1)[:, None, None]
    fronts = ((scattered.labels == LABEL["muscle"]) * layers).max(axis=0)
    before = at[:, 0] + 0.5 - scattered.open_end.standing * fronts[at[:, 1], at[:, 2]]
    clear = muscle & inner & ((off < -0.4) | (before > 0.5))
    assert (clear & (off < -0.4)).sum() > 20
    assert (clear & (off > 0.4)).sum() > 20
    assert (here[clear] == LABEL["adipose"]).all()
    same = inner & (~muscle | ((off > 0.4) & (before < -0.5)))
    np.testing.assert_array_equal(there[same], here[same])
    within = (depth > 0.4) & (depth < scattered.open_end.skin_mm - 0.4)
    assert within.sum() > 100
    np.testing.assert_array_equal(here[within & (here != LABEL["nipple"])], LABEL["skin"])
    # Skin all around: of tissue beside air above the chest wall, nearly all.
    air = np.pad(held.labels == 0, 1, constant_values=True)[1:, 1:-1, 1:-1]
    edge = ndimage.binary_dilation(air, iterations=1)[:-1] & (held.labels != 0)
    edge[:3] = False
    own = np.isin(held.labels[edge], [LABEL[name] for name in ("skin", "nipple", "duct")])
    assert own.mean() > 0.99
    axilla, abdomen = (
        np.subtract(*(part_ml(breast, side) for breast in (scattered, held))) for side in (1, -1)
    )
    assert 5.0 < axilla < 160.0  # it is broad, up to the upper edge of an MLO image
    assert 10.0 < abdomen < 60.0
    summary = phantom_summary(scattered)
    rest = sum(summary.volume_ml.values()) - summary.volume_ml["muscle"] - summary.breast_ml
    # The abdominal wall is no part of the breast. Other views turn muscle near their skin into fat,
    # and that before what is left of the muscle.
    turned = held.frame.position_mm(np.argwhere(held.labels == LABEL["adipose"]))
    at = np.rint(scattered.frame.index(turned)).astype(int)
    turned = turned[scattered.labels[tuple(at.T)] == LABEL["muscle"]]
    lower = along_mm(turned[:, 1], turned[:, 2]) < 0.0
    abdomen += lower.sum() * np.prod(held.voxel_mm) / 1000.0
    assert rest == pytest.approx(abdomen, rel=0.1)
    assert without_open_end(held) is held


def test_a_lesion_in_the_axilla_is_refused_in_other_views(scattered):
    end = scattered.open_end
    place = end.point_mm - 12.0 * end.normal + [20.0, 0.0, 0.0]
    entry = LesionSettings(name="node", kind="mass", diameter_mm=4.0, position_mm=tuple(place))
    made = insert_lesions(scattered, [entry], np.random.default_rng(1))
    with pytest.raises(InputError, match=r"lesion 'node' at .* lies towards the axilla"):
        mammosim.compress(made, view="CC", model="springs", resolution_mm=4.0)


@pytest.mark.parametrize("seed", [3, 8])
def test_the_volume_is_known_before(seed):
    make = generate_phantom if seed == 8 else generate_outline  # with the same volume
    breast = make(GenerateSettings(density="b", voxel_mm=2.0), seed=seed)
    expected = expected_volume_ml(GenerateSettings(), seed)
    assert phantom_summary(breast).breast_ml == pytest.approx(expected, rel=0.02)
    voxels, voxel_mm3 = expected_voxels(
        PhantomSettings(generate=GenerateSettings(voxel_mm=2)), seed
    )
    # The box around a breast depends on its shape: an estimate for `check`.
    assert voxel_mm3 == 8.0
    assert voxels == pytest.approx(breast.labels.size, rel=0.25)


def test_volumes_drawn_by_the_seed_vary():
    volumes = [expected_volume_ml(GenerateSettings(), seed) for seed in range(6)]
    assert 100.0 < min(volumes) < max(volumes) < 1900.0
    # Drawn with a spread of a factor of 1.6 about 620.
    assert max(volumes) > 1.5 * min(volumes)


def test_no_two_breasts_have_the_same_shape():
    """Of one volume: the box around each pair differs somewhere, most by two coarse voxels."""
    outlines = []
    for seed in range(6):
        outline = generate_outline(GenerateSettings(voxel_mm=4.0, volume_ml=600.0), seed)
        index = np.argwhere(outline.labels != 0)
        low = outline.frame.position_mm(index.min(axis=0))
        high = outline.frame.position_mm(index.max(axis=0))
        outlines.append([*low[1:], *high])
    outlines = np.array(outlines)
    apart = np.abs(outlines[:, None] - outlines).max(axis=2)[np.triu_indices(6, 1)]
    assert apart.min() >= 4.0
    assert np.median(apart) >= 8.0


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


@pytest.mark.parametrize("volume", [100.0, 1900.0])
def test_extremes_stay_within_the_coarse_grid(volume):
    breast = generate_phantom("d", 4.0, 5, volume_ml=volume, nipple_height_mm=12.0)
    assert phantom_summary(breast).breast_ml == pytest.approx(volume, rel=0.1)


def test_the_skin_turns_into_the_abdominal_wall_below_the_breast(scattered):
    """Opposite the axilla the outline has a hollow, which views other than oblique ones leave out;
    there is no gland below it."""
    held = without_open_end(scattered)

    def reach(breast):
        """Greatest x of tissue at each 2 mm below the nipple, mm; 0 where there is none."""
        points = breast.frame.position_mm(np.argwhere(breast.labels > 0))
        below = (-along_mm(points[:, 1], points[:, 2]) // 2.0).astype(int)
        most = np.zeros(100)
        np.maximum.at(most, below[below >= 0], points[below >= 0, 0])
        return most

    whole, alone = reach(scattered), reach(held)
    fold = int(np.flatnonzero(np.diff(whole) > 0.5).min())
    assert 10.0 < whole[fold] < whole[fold:].max() - 2.0 < 30.0
    assert (np.diff(alone) < 1.0).all()
    assert alone[fold + 6] < whole[fold + 6] - 8.0
    gland = scattered.frame.position_mm(np.argwhere(scattered.labels == LABEL["gland"]))
    below = -along_mm(gland[:, 1], gland[:, 2]) > 2.0 * (fold + 2)
    assert below.mean() < 1e-3


def test_what_lies_below_the_fold_is_counted_by_label(scattered):
    end, frame = scattered.open_end, scattered.frame
    tissue = np.argwhere(scattered.labels != 0)
    points = frame.position_mm(tissue)
    left_out = (end.held_depth_at(points) < 0.0) & (points @ end.normal < 0.0)
    labels = scattered.labels[tuple(tissue[left_out].T)]
    counted = abdominal_counts(scattered)
    np.testing.assert_allclose(counted, np.bincount(labels, minlength=256), atol=5)
    assert counted[LABEL["adipose"]] > counted[LABEL["skin"]] > 0
    assert not abdominal_counts(without_open_end(scattered)).any()


def test_skin_depth_is_a_distance():
    rng = np.random.default_rng(1)
    shape = draw_shape(600.0, rng)
    outline = Outline(shape, draw_axilla(shape, rng), draw_fold(shape, rng))
    frame = coarse_frame(outline)
    surfaces = surfaces_of(outline, frame)
    depth = skin_depth(surfaces)
    gradient = np.gradient(depth, 2.0)
    slope = np.sqrt(sum(part**2 for part in gradient))
    near = (depth > -2.0) & (depth < 2.0) & (mesh(frame)[0] > 2.0)
    # First order: within 3 % of unit slope near the skin on average, where skin is drawn.
    assert slope[near].mean() == pytest.approx(1.0, abs=0.03)
    assert ((depth > 0) == (surfaces.joined_mm > 0)).all()


def test_fit_volume_scales_shape_not_its_proportions():
    rng = np.random.default_rng(2)
    shape, muscle = draw_shape(400.0, rng), draw_muscle(rng)
    outline = Outline(shape, draw_axilla(shape, rng), draw_fold(shape, rng))
    fitted = fit_volume(outline, muscle, 400.0).shape
    assert fitted.depth_mm / fitted.radius_mm == pytest.approx(shape.depth_mm / shape.radius_mm)
    assert fitted.fullness == shape.fullness


def test_muscles_differ_between_women_and_thin_downwards():
    """The sheet is thickest towards the axilla; thin ones hold more fat, as age has both."""
    muscles = [draw_muscle(np.random.default_rng(seed)) for seed in range(300)]
    sheet, fat = (np.array([getattr(m, name) for m in muscles]) for name in ("sheet_mm", "fat"))
    assert np.median(sheet) == pytest.approx(SHEET_MM[0], rel=0.1)
    assert 7.0 < np.std(sheet) < 12.0
    assert 0.03 <= fat.min() < 0.04 < 0.11 < fat.max() <= 0.12
    assert -0.7 < np.corrcoef(sheet, fat)[0, 1] < -0.3
    body = draw_body(GenerateSettings(volume_ml=500.0), 3, "L")
    _, lateral, superior = mesh(body.frame)
    way, voxel = along_mm(lateral, superior)[0], 2.0
    sections = [
        voxel * np.count_nonzero(((body.muscle_mm > 0.0) & (np.abs(way - at) < 2.0))[6:])
        for at in (20.0, 50.0, 80.0)
    ]
    assert sections == sorted(sections)
    # Beside it there is fat as far forward as its front.
    assert np.count_nonzero(body.muscle_mm > 0.0) < 0.8 * np.count_nonzero(body.behind_mm > 0.0)
    assert (body.muscle_mm <= np.maximum(body.behind_mm, 0.0) + 1e-9)[2:].all()
