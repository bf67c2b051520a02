"""Contrast-enhanced mammography: two exposures, and the image of iodine."""

from __future__ import annotations

import numpy as np
import pytest
from naive.acquisition import body_paths, half_disc

from mammosim.acquisition import AcquisitionSettings, expose
from mammosim.acquisition.attenuation import attenuation_per_mm, cross_section_cm2_g
from mammosim.acquisition.contrast_agent import materials_of, with_iodine
from mammosim.acquisition.iodine_background import flattened
from mammosim.acquisition.spectrum import make_beam
from mammosim.tissues import Material, composition

PIXEL_MM = 1.0
SHAPE = (200, 120)
LESION, DENSE, FAT = (np.s_[60:80, 20:40], np.s_[90:110, 20:40], np.s_[120:140, 20:40])
PURE = Material("iodine", 4.93, {"I": 1.0}, "")


def phantom():
    """50 mm of fat with a fifth of gland; 10 mm of mass here, 15 mm of gland there."""
    inside = half_disc(SHAPE, PIXEL_MM, 90.0)
    gland, mass = 10.0 * inside, np.zeros(SHAPE)
    gland[DENSE] += 15.0
    mass[LESION] = 10.0
    fat = 50.0 * inside - gland - mass
    lengths = {"adipose": fat, "gland": gland, "mass": mass}
    return body_paths(lengths, pixel_mm=PIXEL_MM, thickness_mm=50.0)


def exposed(**agent):
    return expose(phantom(), noise=False, contrast={"parenchyma_mg_ml": 0.0, **agent})


@pytest.fixture(scope="module")
def image():
    return exposed(lesion_mg_ml=1.0)


def inner(values: np.ndarray, place) -> float:
    return float(np.mean(values[place][6:-6, 6:-6]))


def test_iodine_is_added_and_nothing_is_displaced():
    gland = composition("hammerstein", "oxalate")["gland"]
    energy = np.array([20.0, 33.0, 33.5, 45.0])
    added = attenuation_per_mm(with_iodine(gland, 5.0), energy) - attenuation_per_mm(gland, energy)
    np.testing.assert_allclose(added, 0.005 * cross_section_cm2_g("CS_Total", PURE, energy) / 10)
    assert added[2] > 4.0 * added[1]  # the K edge at 33.17 keV
    assert with_iodine(gland, 0.0) is gland


def test_only_what_takes_iodine_up_holds_it():
    materials = materials_of(AcquisitionSettings(contrast={"parenchyma_mg_ml": 0.0}))
    holding = {name for name, material in materials.items() if "I" in material.mass_fraction}
    assert holding == {"mass", "blood", "iodinated water"}


@pytest.mark.parametrize("filter", ["Cu", "Ti"])
def test_the_high_energy_beam_is_above_the_edge(filter):
    beam = make_beam("W", filter, 49.0)
    above = beam.fluence_mm2_mas[beam.energy_kev > 33.17].sum() / beam.fluence_mm2_mas.sum()
    assert above > 0.5
    low = make_beam("W", "Rh", 28.0)
    assert low.fluence_mm2_mas[low.energy_kev > 33.17].sum() == 0.0


def test_the_image_of_iodine_shows_iodine_and_no_gland(image):
    iodine = image.contrast.iodine.mg_cm2
    background = inner(iodine, FAT)
    bare = exposed(lesion_mg_ml=0.0).contrast.iodine.mg_cm2
    # A mass is denser than gland, which shows as 0.18 mg/cm2.
    nothing = inner(bare, LESION) - inner(bare, FAT)
    assert nothing < 0.25
    assert inner(iodine, LESION) - background - nothing == pytest.approx(1.0, rel=0.05)
    # 15 mm of gland in the low-energy image are as bright as several mg/cm2 of iodine.
    assert abs(inner(iodine, DENSE) - background) < 0.08
    assert abs(background) < 0.05


def test_twice_the_iodine_is_twice_as_bright(image):
    twice = exposed(lesion_mg_ml=2.0)
    one, two = (
        inner(made.contrast.iodine.mg_cm2, LESION) - inner(made.contrast.iodine.mg_cm2, FAT)
        for made in (image, twice)
    )
    none = exposed(lesion_mg_ml=0.0).contrast.iodine.mg_cm2
    nothing = inner(none, LESION) - inner(none, FAT)
    assert (two - nothing) == pytest.approx(2.0 * (one - nothing), rel=0.05)


def test_the_second_exposure_has_its_usual_dose(image):
    high = image.contrast.high_energy
    assert (high.filter, high.filter_mm, high.kvp) == ("Cu", 0.3, 49.0)
    assert high.dose_mgy == pytest.approx(0.43 * image.dose_mgy, rel=1e-6)
    assert image.measures["high_energy_dose_mgy"] == high.dose_mgy
    assert 0.1 < image.measures["recombination_weight"] < 0.7
    assert exposed(mas=20.0, filter="Ti").contrast.high_energy.mas == 20.0


def test_noise_of_the_two_exposures_is_not_the_same():
    # The ideal detector has no fixed pattern, which both exposures would share.
    image = expose(phantom(), seed=3, detector="ideal", contrast={})
    calm = expose(phantom(), seed=3, detector="ideal", contrast={}, noise=False)
    pairs = (image, calm), (image.contrast.high_energy, calm.contrast.high_energy)
    low, high = (
        noisy.for_processing[FAT].astype(float) / mean.for_processing[FAT] for noisy, mean in pairs
    )
    assert abs(np.corrcoef(low.ravel(), high.ravel())[0, 1]) < 0.2
    again = expose(phantom(), seed=3, detector="ideal", contrast={})
    np.testing.assert_array_equal(image.contrast.iodine.mg_cm2, again.contrast.iodine.mg_cm2)


def test_each_draw_has_noise_of_its_own_in_both_exposures():
    draws = {}
    made = expose(phantom(), seed=3, contrast={}, realisations=2, watch=draws.__setitem__)
    high = [draw.contrast.high_energy.for_processing for draw in draws.values()]
    np.testing.assert_array_equal(high[0], made.contrast.high_energy.for_processing)
    assert (high[0] != high[1]).mean() > 0.5


def test_without_an_agent_there_is_no_pair():
    assert expose(phantom()).contrast is None


def test_what_is_shown_has_no_wide_background_and_keeps_a_lesion(image):
    """A window of 10 mm: of 20 mm of mass three fifths stay, of gland nothing."""
    paths = phantom()
    thinner = np.linspace(1.0, 0.94, SHAPE[0])[:, None]  # 3 mm from end to end
    lengths = {
        name: length * thinner
        for name, length in zip(paths.materials, paths.length_mm, strict=True)
    }
    uneven = body_paths(lengths, pixel_mm=PIXEL_MM, thickness_mm=50.0)
    made = expose(uneven, noise=False, contrast={"parenchyma_mg_ml": 0.0}).contrast.iodine
    ends = (np.s_[50:60, 10:20], np.s_[150:160, 10:20])
    before, after = (
        abs(float(values[ends[0]].mean() - values[ends[1]].mean()))
        for values in (made.mg_cm2, made.flattened_mg_cm2)
    )
    assert before > 0.8
    assert after < 0.25 * before
    flat = image.contrast.iodine.flattened_mg_cm2
    assert 0.5 < inner(flat, LESION) - inner(flat, FAT) < 0.9


def test_neither_a_bulge_at_the_wall_nor_a_nipple_throws_a_shadow():
    """As below, without a lesion; 6 mm thicker at the wall, and with a nipple of 10 mm."""
    pixel_mm, thickness_mm, radius_mm = 0.5, 40.0, 80.0
    rows, columns = np.mgrid[0:400, 0:240] * pixel_mm
    depth_mm = radius_mm - np.hypot(rows - 100.0, columns)
    free = np.clip(1.0 - depth_mm / (0.5 * thickness_mm), 0.0, 1.0)
    fat_mm = np.where(depth_mm > 0.0, thickness_mm * np.sqrt(1.0 - free**2), 0.0)
    fat_mm += np.where(depth_mm > 0.0, 6.0 * np.clip(1.0 - columns / 5.0, 0.0, 1.0), 0.0)
    nipple = (np.abs(rows - 100.0) < 5.0) & (columns > 75.0) & (columns < 86.0)
    fat_mm = np.where(nipple, np.maximum(fat_mm, 8.0), fat_mm)
    iodine = (0.8 * (fat_mm - thickness_mm)).astype(np.float32)
    for turned in (slice(None), slice(None, None, -1)):  # the wall left or right
        made = (iodine[:, turned], (0.05 * fat_mm[:, turned]).astype(np.float32))
        shown = flattened(*made, pixel_mm, thickness_mm)[:, turned]
        wall = (columns < 20.0) & (depth_mm > 3.0)
        assert iodine[wall].max() > 4.0
        assert np.abs(shown[wall]).max() < 0.9
        behind = (np.abs(rows - 100.0) < 5.0) & (columns > 50.0) & (depth_mm > 6.0)
        assert np.abs(shown[behind]).max() < 0.5
        assert np.abs(shown[nipple & (depth_mm < -1.0)].mean()) < 0.5


def test_the_margin_is_flat_up_to_the_skin():
    """A breast of fat whose margin is round, 0.8 mg/cm2 per mm, and a lesion near the skin."""
    pixel_mm, thickness_mm, radius_mm = 0.5, 40.0, 80.0
    rows, columns = np.mgrid[0:400, 0:200] * pixel_mm
    depth_mm = radius_mm - np.hypot(rows - 100.0, columns)
    free = np.clip(1.0 - depth_mm / (0.5 * thickness_mm), 0.0, 1.0)  # 1 at the skin: half a circle
    fat_mm = np.where(depth_mm > 0.0, thickness_mm * np.sqrt(1.0 - free**2), 0.0)
    lesion = np.hypot(rows - 100.0, columns - 70.0) < 4.0
    iodine = (0.8 * (fat_mm - thickness_mm) + lesion).astype(np.float32)
    shown = flattened(iodine, (0.05 * fat_mm).astype(np.float32), pixel_mm, thickness_mm)
    breast = (depth_mm > 3.0) & ~lesion
    assert iodine[breast].min() < -10.0
    # Cells of 1 mm, where a millimetre of depth is 2.6 mg/cm2.
    assert np.abs(shown[breast]).max() < 0.9
    assert np.sqrt(np.mean(shown[breast] ** 2)) < 0.15
    assert shown[lesion].mean() == pytest.approx(1.0, abs=0.15)
    np.testing.assert_array_equal(shown[depth_mm < -3.0], iodine[depth_mm < -3.0])
