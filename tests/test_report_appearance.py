"""How a mammogram looks: measures on images whose numbers are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from mammosim.report.appearance import MEASURES, appearance, measures_of
from mammosim.report.appearance.pectoral import find_muscle
from mammosim.report.appearance.region import find_region, inner_breast, smooth

PX = 0.2
SHAPE = (900, 500)  # 180 x 100 mm
CENTRE = (90.0, 0.0)
RADII_MM = (80.0, 64.0)


def ellipse(shape=SHAPE, px=PX, nipple=False):
    """Half an ellipse at the left edge, and distance (mm) inside its edge, roughly."""
    rows, columns = np.indices(shape) * px
    part = np.hypot((rows - CENTRE[0]) / RADII_MM[0], (columns - CENTRE[1]) / RADII_MM[1])
    breast = part < 1.0
    if nipple:
        breast |= (np.abs(rows - CENTRE[0]) < 5.0) & (columns < RADII_MM[1] + 5.0)
    return breast, ndimage.distance_transform_edt(np.pad(breast, 1, mode="edge"))[1:-1, 1:-1] * px


def power_law_noise(exponent, shape=SHAPE, seed=2):
    rng = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    frequency[0, 0] = np.inf
    noise = np.fft.irfft2(
        np.fft.rfft2(rng.standard_normal(shape)) * frequency ** (-exponent / 2.0), shape
    )
    return noise / noise.std()


def textured(exponent=2.8, deviation=0.05, mean=0.4):
    breast, _ = ellipse()
    return np.where(breast, mean + deviation * power_law_noise(exponent), 0.0).clip(0.0, 1.0)


@pytest.mark.parametrize("view", ["CC", "MLO"])
def test_every_measure_has_a_range_and_a_name(view):
    for measure, low, high in measures_of(view).values():
        assert measure.name
        assert low < high
    # 42 in all, a tenth wider than measured
    assert len(measures_of("CC")) + len(measures_of("MLO")) == 42
    assert measures_of("CC")["skew"][1] == pytest.approx(0.0087 - 0.1 * (1.4257 - 0.0087))


def test_all_that_is_measured_is_in_the_table():
    assert set(appearance(textured(), PX, "CC")) <= set(MEASURES)


@pytest.mark.parametrize("mirrored", [False, True])
def test_shape_of_a_half_ellipse(mirrored):
    grey = textured()[:, ::-1] if mirrored else textured()
    found = appearance(grey, PX, "CC")
    assert found["depth_over_length"] == pytest.approx(
        64.0 / 160.0, abs=0.02
    )  # rounded at its ends
    assert found["top_over_greatest"] < 0.3


def test_percentiles_and_skewness_of_known_grey():
    breast, _ = ellipse()
    rng = np.random.default_rng(1)
    values = 0.2 + 0.05 * rng.gamma(4.0, 1.0, SHAPE)  # skewness 1
    found = appearance(np.where(breast, values, 0.0), PX, "CC")
    assert found["grey_p50"] == pytest.approx(0.2 + 0.05 * 3.672, abs=0.002)
    assert found["grey_p5"] == pytest.approx(0.2 + 0.05 * 1.366, abs=0.002)
    assert found["skew"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("exponent", [2.4, 3.0])
def test_exponents_of_known_noise(exponent):
    found = appearance(textured(exponent), PX, "CC")
    assert found["beta_015_07"] == pytest.approx(exponent, abs=0.2)
    assert found["beta_07_2"] == pytest.approx(exponent, abs=0.2)


def test_bright_lines_make_bands_skewed_and_ridges_that_point_where_they_run():
    breast, _ = ellipse()
    rows, columns = np.indices(SHAPE) * PX
    noise = 0.4 + 0.06 * power_law_noise(2.8)
    angle = np.arctan2(rows - 90.0, 64.0 - columns)  # lines through the tip
    lines = 0.9 * (np.abs((angle * 16.0) % 2.0 - 1.0) < 0.06)
    radial = appearance(np.where(breast, noise + smooth(lines, 1.5), 0.0), PX, "CC")
    plain = appearance(np.where(breast, noise, 0.0), PX, "CC")
    assert radial["ridge0.8_to_nipple"] > 0.6 > abs(plain["ridge0.8_to_nipple"]) + 0.4
    assert radial["band0.6_skew"] > plain["band0.6_skew"] + 0.5
    assert radial["ridge0.8_bright_dark"] > 1.5
    assert plain["ridge0.8_bright_dark"] == pytest.approx(1.0, abs=0.15)  # symmetric noise
    assert radial["ridge0.8_length_mm"] > 2.0 * plain["ridge0.8_length_mm"]


def test_a_skin_line_of_known_width_and_the_grey_below_it():
    breast, depth = ellipse()
    line = 0.6 * np.exp(-0.5 * ((depth - 1.5) / 0.6) ** 2)  # half width 1.41 mm, from 0.21 to 1.2
    below = np.where(depth < 8.0, 0.25, 0.2 + 0.1 * np.clip(power_law_noise(2.5), -2.0, 2.0))
    image = np.where(breast, smooth(below, 1.0) * (depth > 1.0) + line, 0.0)
    found = appearance(image, PX, "CC")
    assert found["skin_width_mm"] == pytest.approx(1.41, abs=0.5)  # pixels of 0.2 mm
    assert 0.5 < found["skin_rise_mm"] < 1.7
    core = image[depth > 8.0]
    low, high = np.quantile(core, [0.01, 0.99])
    assert found["subcut_5mm"] == pytest.approx((0.25 - low) / (high - low), abs=0.03)


def test_the_nipple_is_told_from_the_breast():
    breast, _ = ellipse(nipple=True)
    rows, columns = np.indices(SHAPE) * PX
    image = np.where(breast, 0.4 + 0.05 * power_law_noise(2.8), 0.0)
    image[breast & (columns > RADII_MM[1] + 0.5)] = 0.3
    found = appearance(image, PX, "CC")
    region = find_region(image, PX)
    values = region.grey[inner_breast(region, np.zeros(region.breast.shape, bool))]
    low, high = np.quantile(values, [0.01, 0.99])
    assert found["nipple_grey"] == pytest.approx((0.3 - low) / (high - low), abs=0.02)
    assert "nipple_grey" not in appearance(textured(), PX, "CC")
    assert rows[region.nipple.any(axis=1)[: SHAPE[0]].argmax(), 0] >= 0.0


def test_a_pattern_of_voxels_is_found_and_noise_is_none():
    breast, _ = ellipse()
    rows, columns = np.indices(SHAPE) * PX
    weave = 0.02 * np.sin(2.0 * np.pi * 1.7 * (rows + 0.3 * columns))
    image = textured(2.8, 0.03)
    assert appearance(image, PX, "CC")["margin_lattice_share_over_5"] < 0.3
    woven = np.where(breast, image + weave, 0.0)
    assert appearance(woven, PX, "CC")["margin_lattice_share_over_5"] > 0.9


def with_muscle(width_mm=40.0, length_mm=120.0, blur_mm=1.2):
    """An MLO: a breast up to the upper edge, and a brighter triangle in its corner."""
    rows, columns = np.indices(SHAPE) * PX
    breast = columns < np.where(
        rows < 90.0, 64.0, 64.0 * np.sqrt(np.clip(1 - ((rows - 90) / 80) ** 2, 0, 1))
    )
    inside = width_mm * (1.0 - rows / length_mm) - columns
    distance = inside * length_mm / np.hypot(width_mm, length_mm)
    step = 0.3 / (1.0 + np.exp(-distance / (0.55 * blur_mm)))  # logistic, about that deviation
    return np.where(breast, 0.25 + 0.02 * power_law_noise(2.8) + step, 0.0)


def test_the_muscles_line_grey_and_edge():
    image = with_muscle()
    line = find_muscle(find_region(image, PX))
    assert line.width_mm == pytest.approx(40.0, abs=4.0)
    assert line.length_mm == pytest.approx(120.0, abs=8.0)
    found = appearance(image, PX, "MLO")
    assert found["muscle_grey"] == pytest.approx(0.55, abs=0.03)
    # a logistic falls from 85 to 15 % over 3.47 of its scale, here 0.66 mm
    assert found["pect_edge_15_85_mm"] == pytest.approx(3.47 * 0.66, abs=0.8)
    assert found["pect_edge_wander_mm"] < 1.0
    blurred = appearance(with_muscle(blur_mm=2.5), PX, "MLO")
    assert blurred["pect_edge_15_85_mm"] > found["pect_edge_15_85_mm"] + 1.0


def test_nothing_is_measured_where_there_is_no_breast():
    assert appearance(np.zeros((300, 200)), PX, "CC") == {}


@pytest.mark.parametrize("sigma", [2.0, 7.0, 20.0])
def test_wide_smoothing_on_a_coarse_grid_is_that_on_the_fine_one(sigma):
    image = power_law_noise(2.0, (230, 190), seed=3)
    fine = ndimage.gaussian_filter(image, sigma)
    margin = int(4 * sigma) if sigma < 10 else 60
    inner = np.s_[margin:-margin, margin:-margin]
    # relative to what smoothing takes out
    error = np.abs(smooth(image, sigma) - fine)[inner].max()
    assert error < 0.03 * (image - fine).std()
