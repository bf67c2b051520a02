"""Blur by focal spot and pixel."""

import numpy as np
import pytest
from naive.acquisition import body_paths

from mammosim.acquisition import AcquisitionSettings, expose
from mammosim.acquisition.blur import blur_shadow, filter_image, spot_width_mm
from mammosim.acquisition.recording import detector_input
from mammosim.errors import InputError

PIXEL_MM = 0.1


def wave(frequency_per_mm, shape=(64, 500)):
    columns = np.arange(shape[1]) * PIXEL_MM
    line = 1000.0 + 500.0 * np.cos(2.0 * np.pi * frequency_per_mm * columns)
    return np.tile(line.astype(np.float32), (shape[0], 1))


def amplitude(image, frequency_per_mm):
    """Of a wave along columns, over whole periods away from the edges."""
    part = image[image.shape[0] // 2, 100:400].astype(np.float64)
    phase = np.exp(-2j * np.pi * frequency_per_mm * np.arange(100, 400) * PIXEL_MM)
    return 2.0 * abs(np.mean(part * phase))


@pytest.mark.parametrize("spot_mm", [0.0, 0.02, 0.15])
@pytest.mark.parametrize("frequency", [1.0, 3.0, 4.5])
def test_waves_lose_the_sinc_of_pixel_and_spot(frequency, spot_mm):
    signal = wave(frequency)
    blur_shadow(signal, signal.copy(), PIXEL_MM, spot_mm)
    expected = np.sinc(PIXEL_MM * frequency) * np.sinc(spot_mm * frequency)
    # the wave ends at the margin, 10 mm from what is looked at: the filter's tail there is 1e-3
    assert amplitude(signal, frequency) / 500.0 == pytest.approx(expected, abs=2e-3)
    turned = np.ascontiguousarray(wave(frequency).T)
    blur_shadow(turned, turned.copy(), PIXEL_MM, spot_mm)
    np.testing.assert_allclose(turned.T, signal, atol=2e-3)


def test_flat_fields_and_the_mean_energy_stay():
    signal = np.full((40, 50), 7.0, np.float32)
    square = 20.0 * signal
    blur_shadow(signal, square, PIXEL_MM, 0.05)
    np.testing.assert_allclose(signal, 7.0, rtol=1e-6)
    np.testing.assert_allclose(square, 140.0, rtol=1e-6)
    edge = np.where(np.arange(60) < 30, 5.0, 0.0).astype(np.float32) * np.ones((40, 1), np.float32)
    square = 20.0 * edge
    blur_shadow(edge, square, PIXEL_MM, 0.05)
    assert edge.min() >= 0.0
    where = edge[:, :29] > 0.0
    np.testing.assert_allclose(square[:, :29][where], 20.0 * edge[:, :29][where], rtol=1e-6)


def test_nothing_behind_metal_is_no_warning():
    signal = np.zeros((20, 20), np.float32)
    with np.errstate(all="raise"):
        blur_shadow(signal, signal.copy(), PIXEL_MM, 0.0)
    assert not signal.any()


def test_the_sum_of_a_spike_is_kept():
    image = np.zeros((101, 101), np.float32)
    image[50, 50] = 1.0
    filter_image(image, lambda u, v: np.sinc(PIXEL_MM * u) * np.sinc(PIXEL_MM * v), PIXEL_MM)
    assert image.sum() == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(image, image.T, atol=1e-6)


def test_the_spots_shadow_grows_with_height():
    gantry = body_paths({"gland": np.zeros((4, 4))}).gantry  # 650 mm, support 15 mm above
    widths = [spot_width_mm(0.3, gantry, height) for height in (-15.0, 0.0, 50.0, 310.0)]
    np.testing.assert_allclose(widths, [0.0, 0.3 * 15 / 635, 0.3 * 65 / 585, 0.3], rtol=1e-12)


def test_a_larger_spot_blurs_more_and_none_blurs_least():
    gland = np.where(np.arange(200) == 100, 45.0, 40.0) * np.ones((20, 1))
    paths = body_paths({"gland": gland}, pixel_mm=PIXEL_MM, thickness_mm=100.0)
    contrast = []
    for spot_mm in (0.0, 0.3, 1.0):
        settings = AcquisitionSettings(
            focal_spot_mm=spot_mm, kvp=28.0, mas=50.0, scatter=False, grid=False
        )
        line = detector_input(paths, settings).signal[10].astype(float)
        contrast.append(1.0 - line[100] / line[:80].mean())
    assert contrast[0] > contrast[1] > contrast[2] > 0.3 * contrast[0]


def test_faulty_spots_are_refused():
    paths = body_paths({"gland": np.full((4, 4), 40.0)})
    with pytest.raises(InputError, match=r"focal_spot_mm: found -0\.1"):
        expose(paths, focal_spot_mm=-0.1)
