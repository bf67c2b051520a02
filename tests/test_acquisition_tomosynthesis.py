"""A series of projections: dose, noise and scale of its members."""

import numpy as np
import pytest
from make_run import FEW_PHOTONS
from naive.projection import phantom, unsqueezed
from scipy import ndimage

from mammosim.acquisition import expose, expose_arc
from mammosim.errors import InputError
from mammosim.projection import project, project_arc

ADIPOSE, GLAND = 1, 29
KEYS = {"kvp": 28.0, "mas": 90.0}


def block(thickness_voxels=10):
    """A slab of fat with a lump of gland, 40 x 70 x 40 mm."""
    labels = np.full((20, 35, thickness_voxels), ADIPOSE, dtype=np.uint8)
    labels[5:10, 14:20, 3:6] = GLAND
    return unsqueezed(phantom(labels, [2.0, 2.0, 4.0], [1.0, -34.0, 2.0]), plates_mm=(0.0, 40.0))


def sweep(projections=5, **keys):
    return project_arc(
        block(), {"projections": projections, **keys}, pixel_mm=0.5, detector_mm=[150.0, 60.0]
    )


@pytest.fixture(scope="module")
def series():
    return expose_arc(sweep(), seed=3, **KEYS)


def test_load_and_dose_are_split_evenly(series):
    picture = expose(
        project(block(), pixel_mm=0.5, detector_mm=[150.0, 60.0]), grid=False, noise=False, **KEYS
    )
    dance = picture.dose.by["dance"].mgd_mgy
    error = 4.0 * np.hypot(picture.dose.error, series.middle.dose.error)
    assert error < 0.1
    assert series.mas == pytest.approx(90.0)
    assert series.middle.mas == pytest.approx(18.0)
    # oblique photons leave some per cent less in the gland
    assert 0.9 < series.dose_mgy / (5.0 * series.middle.dose_mgy) < 1.02
    assert series.air_kerma_mgy == pytest.approx(picture.air_kerma_mgy, rel=1e-9)
    assert series.middle.dose_mgy == pytest.approx(picture.dose_mgy / 5, rel=error)
    assert series.middle.dose.by["dance"].mgd_mgy == pytest.approx(dance / 5, rel=1e-9)
    assert series.middle.measures["projections"] == 5.0
    assert series.middle.measures["dose_of_all_projections_mgy"] == series.dose_mgy
    assert not any("upright tube" in note for note in series.notes)


def test_shares_split_load_and_dose(series):
    shares = [1.0, 2.0, 4.0, 2.0, 1.0]
    uneven = expose_arc(sweep(shares=shares), seed=3, noise=False, **KEYS)
    np.testing.assert_allclose(uneven.loads_mas, 90.0 * np.array(shares) / 10.0)
    assert uneven.middle.mas == pytest.approx(36.0)
    assert uneven.air_kerma_mgy == pytest.approx(series.air_kerma_mgy, rel=1e-9)
    # t(angle) is the same; more of the load at small angles gives more dose.
    np.testing.assert_allclose(uneven.dose_factors, series.dose_factors, rtol=1e-9)
    ratio = uneven.mean_dose_factor / series.mean_dose_factor
    assert uneven.dose_mgy / series.dose_mgy == pytest.approx(ratio, rel=1e-9)
    # The attenuation that a reconstruction starts from knows each projection's own load.
    even = expose_arc(sweep(), seed=3, noise=False, **KEYS)
    for index in (0, 2):
        np.testing.assert_allclose(
            uneven.attenuation(index), even.attenuation(index), atol=0.02
        )  # of whole pixel values


def test_each_projection_knows_where_the_shadow_is(series):
    for gantry, picture, box in zip(
        series.gantries, series.projections, series.shadows, strict=True
    ):
        row, end_row, column, end_column = box
        assert picture[row:end_row, column:end_column].min() < 0.2 * picture.max()
        corners = [[1.0, -34.0, 0.0], [39.0, 34.0, 40.0]]
        place = gantry.project(
            np.array(corners) - [gantry.detector_edge_mm, 0, gantry.support_z_mm]
        )
        assert np.all(place[:, 0] >= row - 1)
        assert np.all(place[:, 0] <= end_row)


def test_exposure_control_gives_the_load_and_dose_of_a_mammogram():
    arc = sweep(3)
    kernels = {"model": "kernels"}  # Monte Carlo's load differs by its noise
    one = expose(arc.paths(1), noise=False, scatter=kernels)
    series = expose_arc(arc, noise=False, scatter=kernels)
    assert series.mas == pytest.approx(one.mas, rel=1e-9)
    assert series.dose_mgy == pytest.approx(one.dose_mgy, rel=1e-9)
    assert any("t, the dose over that of the upright tube" in note for note in series.notes)


def test_the_middle_projection_is_the_upright_one(series):
    assert series.gantries[2].tube_angle_deg == 0.0
    assert series.middle.gantry is series.gantries[2]
    np.testing.assert_array_equal(series.projections[2], series.middle.for_processing)
    assert not series.middle.grid


def test_all_projections_share_one_scale(series):
    """Air right under each focal spot: energy over the square of the spot's height."""
    for angle in (40.0, 10.0):
        arc = project_arc(
            block(), {"angle_range_deg": angle, "projections": 3}, pixel_mm=1.0,
            detector_mm=[600.0, 60.0], focal_spot_y_mm=0.0,
        )  # fmt: skip
        quiet = expose_arc(arc, noise=False, scatter=False, **KEYS)
        found, height = [], []
        for gantry, counts in zip(arc.gantries, quiet.projections, strict=True):
            row = round(float(gantry.pixel_of(50.0, gantry.focal_spot_mm[1])[0]))
            found.append(float(counts[row, 50]))
            height.append(gantry.focal_spot_height_mm)
        if angle == 40.0:  # upright, the foot lies behind the breast
            found, height = found[::2], height[::2]
            assert found[0] == pytest.approx(found[1], rel=2e-3)
        assert max(found) < 16383
    assert quiet.counts_per_kev > 0.0


def test_a_turned_detector_measures_the_same_attenuation_along_each_ray():
    """Obliqueness and flat layers, which do not turn, are taken out for either detector."""
    keys = {"angle_range_deg": 40.0, "projections": 3}
    quiet = {"noise": False, "scatter": False, **KEYS}
    fixed, turning = (
        expose_arc(
            project_arc(block(), {**keys, "detector_angle_range_deg": turn}, pixel_mm=1.0,
                        detector_mm=[150.0, 60.0], support_to_detector_mm=30.0,
                        smooth_voxels=False), **quiet,
        )
        for turn in (0.0, 20.0)
    )  # fmt: skip
    gantry, other = fixed.gantries[2], turning.gantries[2]
    assert other.detector_angle_deg == 10.0
    place = gantry.project(other.detector_mm(*np.indices((150, 60))))
    expected = ndimage.map_coordinates(
        fixed.attenuation(2), np.moveaxis(place, -1, 0), order=1, cval=np.nan
    )
    found = turning.attenuation(2)
    flat = ndimage.maximum_filter(found, 5) - ndimage.minimum_filter(found, 5) < 0.05
    inside = flat & np.isfinite(expected)
    assert (inside & (found > 1.0)).sum() > 500
    assert (inside & (found < 0.1)).sum() > 500
    # Pixel values are whole numbers, about 500 behind the thickest fat.
    np.testing.assert_allclose(found[inside], expected[inside], atol=6e-3)
    # Air: photons fall with the square of the distance and the slant of the detector; the slant of
    # the layers is that of the ray. What a slant gains in the converter is below a per cent.
    seen = []
    for series, gantry_ in ((fixed, gantry), (turning, other)):
        ray = gantry_.detector_mm(*np.indices((150, 60))) - gantry_.focal_spot_mm
        distance = np.linalg.norm(ray, axis=-1)
        photons = gantry_.focal_spot_height_mm / distance**3
        seen.append(series.projections[2] / series.counts_per_kev / photons)
    expected = ndimage.map_coordinates(seen[0], np.moveaxis(place, -1, 0), order=1, cval=np.nan)
    air = inside & (found < 0.1)
    np.testing.assert_allclose(seen[1][air], expected[air], rtol=8e-3)


def test_noise_is_another_in_each_projection_and_the_seeds_alone(series):
    again, other = (expose_arc(sweep(), seed=seed, **KEYS) for seed in (3, 4))
    np.testing.assert_array_equal(again.projections, series.projections)
    assert (other.projections != series.projections).mean() > 0.5
    # The fixed pattern is the same in all; what changes with the seed must not repeat itself.
    changed = series.projections.astype(float) - other.projections
    air = np.s_[2:30, 90:]
    assert abs(np.corrcoef(changed[0][air].ravel(), changed[4][air].ravel())[0, 1]) < 0.1


def test_a_noise_seed_of_a_series_changes_its_noise_and_nothing_else(series):
    """Also 0: it is a seed like any other, not the lack of one."""
    for noise_seed in (0, 7):
        other = expose_arc(sweep(), seed=3, noise_seed=noise_seed, **KEYS)
        assert (other.projections != series.projections).mean() > 0.5
        np.testing.assert_array_equal(other.loads_mas, series.loads_mas)


def test_each_projection_has_its_share_of_the_quanta():
    """Variance over signal squared of a projection is that of the whole load times their number."""
    arc = sweep(3, angle_range_deg=0.0)
    series = expose_arc(arc, detector="a-Se-70", **KEYS)
    whole = expose(arc.paths(1), grid=False, **KEYS)
    part = np.s_[20:60, 100:118]  # air
    first, second = (series.projections[k][part].astype(float) for k in (0, 2))
    spread = np.var(first - second) / 2.0 / first.mean() ** 2
    # The same photons: scatter's own noise is not the detector's.
    pair = [expose(arc.paths(1), grid=False, noise_seed=seed, **KEYS) for seed in (1, 2)]
    one, two = (image.for_processing[part].astype(float) for image in pair)
    assert whole.mas == pytest.approx(3.0 * series.middle.mas)
    # 720 pixels a variance: 5 per cent standard error each
    assert spread == pytest.approx(3.0 * np.var(one - two) / 2.0 / one.mean() ** 2, rel=0.25)


def test_a_grid_only_when_asked_for():
    keys = KEYS | FEW_PHOTONS
    assert expose_arc(sweep(1), grid=True, **keys).middle.grid
    assert expose_arc(sweep(1), **keys).notes == expose_arc(sweep(1), **keys).middle.notes


def test_unknown_keys_are_refused():
    with pytest.raises(InputError, match=r"acquisition.dose: unknown key"):
        expose_arc(sweep(1), dose=1.0)
