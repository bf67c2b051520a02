"""Monte Carlo as the scatter and the dose of an exposure."""

from dataclasses import replace

import numpy as np
import pytest
import SimpleITK as sitk
from naive.monte_carlo import MATERIALS, gantry
from naive.projection import phantom, unsqueezed

from mammosim.acquisition import expose, expose_arc
from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.monte_carlo import Plates, make_scene, mixture_of
from mammosim.acquisition.monte_carlo.scene import MAX_MIXTURES
from mammosim.errors import InputError
from mammosim.export import ExportSettings, StudyIdentity, write_images
from mammosim.projection import CoarseBreast, coarse_breast, project, project_arc

KEYS = {"kvp": 28.0, "mas": 80.0, "noise": False, "scatter": {"photons": 20_000}}


@pytest.fixture(scope="module")
def breast():
    """A block of 60 x 70 x 40 mm: fat, with gland in its middle."""
    labels = np.ones((24, 28, 16), np.uint8)
    labels[4:16, 6:22, 4:12] = 29
    return unsqueezed(phantom(labels, voxel_mm=2.5), spacing_mm=5.0)


@pytest.fixture(scope="module")
def paths(breast):
    return project(breast, pixel_mm=1.0)


@pytest.fixture(scope="module")
def image(paths):
    return expose(paths, grid=False, **KEYS)


def test_the_coarse_copy_keeps_the_volume_of_each_tissue(breast, paths):
    copy = coarse_breast(breast, paths.gantry, 1.0)
    voxel_ml = np.prod(copy.spacing_mm) / 1000.0
    gland = (breast.phantom.labels == 29).sum() * 2.5**3 / 1000.0
    # eight samples a voxel; faces that are no planes of the copy are off by half a sample
    assert copy.fraction("gland").sum() * voxel_ml == pytest.approx(gland, rel=0.03)
    assert copy.density.mean() == pytest.approx(1.0, abs=0.01)


def test_the_coarse_copy_attenuates_as_the_path_lengths_do(paths):
    """Also where a mechanical model leaves skin inside the plates, which are moved here."""
    whole = paths.breast
    held = replace(
        whole, support_z_mm=whole.support_z_mm + 0.7, paddle_z_mm=whole.paddle_z_mm - 0.4
    )
    gantry = replace(paths.gantry, support_z_mm=held.support_z_mm)
    amounts = []
    for one, at in ((whole, paths.gantry), (held, gantry)):
        copy = coarse_breast(one, at, 1.0)
        assert copy.spacing_mm[2] * copy.shares.shape[2] == pytest.approx(one.thickness_mm)
        amounts.append([
            (copy.fraction(name) * copy.density).sum() * copy.spacing_mm[2]
            for name in ("adipose", "gland")
        ])  # fmt: skip
    np.testing.assert_allclose(amounts[1], amounts[0], rtol=0.02)


def test_primary_and_scatter_add_up_to_what_is_recorded(image):
    assert image.primary.dtype == image.scatter.dtype == np.float32
    assert image.primary.shape == image.scatter.shape == image.for_processing.shape
    kev = image.for_processing / image.measures["counts_per_kev"]
    inside = (slice(40, 200), slice(8, 40))
    # blur moves energy about; over the middle of the block nothing is gained or lost
    found = (image.primary + image.scatter)[inside].mean()
    assert found == pytest.approx(kev[inside].mean(), rel=0.01)


def test_monte_carlo_is_the_default_and_is_named(image, paths):
    assert image.scatter_model == "monte-carlo"
    assert image.dose_method == "monte-carlo"
    assert image.measures["scatter_photons"] >= 20_000
    assert 0.0 < image.measures["scatter_noise_percent"] < 15.0
    assert not any("scatter:" in note for note in image.notes)
    assert expose(paths, scatter=False, kvp=28.0, mas=80.0).scatter_model == "none"


def test_without_voxels_kernels_run_and_a_note_says_so(paths):
    image = expose(replace(paths, breast=None), grid=False, **KEYS)
    assert image.scatter_model == "kernels"
    assert image.dose_method == "dance"
    assert any("only path lengths are known" in note for note in image.notes)
    asked = expose(paths, **{**KEYS, "scatter": {"model": "kernels"}})
    assert asked.scatter_model == "kernels"
    assert not any("only path lengths" in note for note in asked.notes)


def test_dose_is_monte_carlos_with_dances_beside_it(image):
    by_tissue = image.measures["dose_of_adipose_mgy"]
    assert by_tissue == image.dose.material_mgy["adipose"] > 0.0
    dose = image.dose
    assert image.dose_mgy == dose.mgd_mgy == dose.by["monte-carlo"].mgd_mgy
    for one in dose.by.values():
        assert one.mgd_per_kerma == pytest.approx(one.mgd_mgy / image.air_kerma_mgy)
    # gland under fat gets less than the fat above it; both methods agree within a fifth
    assert dose.by["dance"].mgd_mgy == pytest.approx(dose.mgd_mgy, rel=0.25)
    assert dose.error < 0.05
    # gland lies 10 mm deep and more, under 40 mm
    assert image.measures["core_glandularity_percent"] > image.measures["glandularity_percent"]


def test_the_grid_takes_the_parts_that_the_settings_give(paths, image):
    through = expose(paths, **KEYS)
    at = (slice(100, 140), slice(10, 30))
    expected = 0.75 * image.primary[at].mean() + 0.10 * image.scatter[at].mean()
    kev = through.for_processing[at].mean() / through.measures["counts_per_kev"]
    # the grid changes the scatter's shape a little, its sum over the breast is given
    assert kev == pytest.approx(expected, rel=0.01)
    physical = expose(paths, grid_primary_transmission=None, grid_scatter_transmission=None, **KEYS)
    kev = physical.for_processing[at].mean() / physical.measures["counts_per_kev"]
    part = (kev - 0.75 * image.primary[at].mean()) / image.scatter[at].mean()
    assert -0.1 < part < 0.4
    with pytest.raises(InputError, match=r"grid_scatter_transmission: found null"):
        expose(paths, grid_scatter_transmission=None, scatter={"model": "kernels"}, mas=80.0)


def test_the_dose_map_is_written_where_it_is_asked_for(paths, tmp_path):
    image = expose(paths, dose_map=True, **KEYS)
    dose = image.dose.dose_map
    assert dose.mgy.shape == coarse_breast(paths.breast, paths.gantry, 1.0).shares.shape
    write_images(
        tmp_path, paths, image, (), ExportSettings(dose_map=True, dicom=False),
        StudyIdentity("0" * 64, "x"),
    )  # fmt: skip
    file = sitk.ReadImage(str(tmp_path / "dose_map.nii.gz"))
    read = sitk.GetArrayFromImage(file)
    np.testing.assert_array_equal(read.transpose(2, 1, 0), dose.mgy)
    assert file.GetSpacing() == pytest.approx(dose.spacing_mm)
    # to the patient's front, left and head: a left breast under a paddle above it, which gets most
    np.testing.assert_allclose(file.GetDirection(), (0, 1, 0, -1, 0, 0, 0, 0, 1), atol=1e-6)
    tissue = paths.gantry.detector_edge_mm + dose.origin_mm[0] + 0.5 * dose.spacing_mm[0]
    assert file.GetOrigin()[1] == pytest.approx(-tissue)
    upwards = read.mean(axis=(1, 2))
    upwards = upwards[upwards > 0.0]
    assert upwards[-1] > 3.0 * upwards[0]
    assert read[read > 0.0].mean() < image.air_kerma_mgy < read.max()
    assert expose(paths, **KEYS).dose.dose_map is None


def test_a_series_interpolates_over_its_angles(breast, image):
    arc = project_arc(breast, {"angle_range_deg": 20.0, "projections": 5}, pixel_mm=1.0)
    series = expose_arc(arc, **{**KEYS, "mas": 400.0})
    middle = series.middle
    assert middle.scatter_model == "monte-carlo"
    assert middle.measures["scatter_to_primary_ratio"] == pytest.approx(
        image.measures["scatter_to_primary_ratio"], rel=0.1
    )
    # oblique photons go a little farther through fat before they meet gland
    assert series.dose_mgy == pytest.approx(5.0 * middle.dose_mgy, rel=0.05)
    error = np.hypot(image.dose.error, middle.dose.error)
    assert error < 0.03
    assert middle.dose_mgy == pytest.approx(image.dose_mgy, rel=4.0 * error)


def test_a_breast_too_large_for_the_copy_is_refused(monkeypatch, paths):
    monkeypatch.setattr("mammosim.projection.coarse_copy.MAX_VOXELS", 1000)
    with pytest.raises(InputError, match=r"needs .* voxels of 1 mm, at most 1e\+03 are allowed"):
        expose(paths, **KEYS)


def test_scatter_over_primary_that_no_breast_has_is_noted(paths, image):
    """Lengths that attenuate three times what the voxels do leave less primary than there is."""
    dim = expose(replace(paths, attenuating_mm=3.0 * paths.attenuating_mm), grid=False, **KEYS)
    assert any("scatter-to-primary ratio in front of the grid: found" in n for n in dim.notes)
    assert not any("scatter-to-primary" in note for note in image.notes)


def test_too_many_mixtures_are_rounded_to_quarters():
    """Fifteen materials at random: volumes stay, and no voxel changes by more than the bound."""
    rng = np.random.default_rng(7)
    parts = rng.multinomial(8, np.full(16, 1 / 16), (50, 50, 40))  # the last is air
    shares = np.zeros(parts.shape[:3], np.uint64)
    for column in range(15):
        shares |= parts[..., column].astype(np.uint64) << np.uint64(4 * column)
    assert np.unique(shares).size > MAX_MIXTURES
    names = tuple(MATERIALS)[:15]
    copy = CoarseBreast(
        np.array([0.0, -25.0, 0.0]), np.ones(3), names, shares, np.ones(shares.shape, np.float32)
    )
    plates = Plates(BEAM_MATERIALS["polycarbonate"], BEAM_MATERIALS["carbon fibre"], 0.0, 0.0)
    scene = make_scene(copy, plates, gantry(), MATERIALS)
    words = scene.space.words.reshape([len(axis) - 1 for axis in scene.space[:3]])[scene.inner]
    found = scene.fraction[mixture_of(words)]
    found = np.concatenate([found[..., :15], found[..., -1:]], axis=-1)  # without plates
    assert (found * 4.0 == np.round(found * 4.0)).all()
    expected = parts / 8.0
    np.testing.assert_allclose(found.mean(axis=(0, 1, 2)), expected.mean(axis=(0, 1, 2)), rtol=0.01)
    moved = 0.5 * np.abs(found - expected).sum(axis=-1)
    assert (moved <= (parts % 2).sum(axis=-1) / 16.0 + 1e-12).all()
    energy = np.array([20.0])
    mu = np.array([
        attenuation_per_mm(one, energy)[0]
        for one in (*(MATERIALS[name] for name in names), BEAM_MATERIALS["air"])
    ])  # fmt: skip
    off = np.abs((found - expected) @ mu)
    there = np.where((parts > 0) | (found > 0.0), mu, np.nan)
    assert (off <= moved * (np.nanmax(there, -1) - np.nanmin(there, -1)) + 1e-12).all()
