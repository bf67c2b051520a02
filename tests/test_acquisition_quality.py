"""The measuring methods themselves, on pictures whose quality is known."""

import numpy as np
import pytest
from scipy.special import erf

from mammosim.acquisition.quality import detective_efficiency, edge_mtf, noise_power
from mammosim.errors import InputError

PIXEL_MM = 0.1


def edge(angle_deg=2.0, sigma_mm=0.06, shape=(200, 240), turn=False):
    """An edge blurred by a Gaussian and sampled by points."""
    row, column = np.indices(shape)
    slope = np.tan(np.radians(angle_deg))
    across = (column - shape[1] / 2 - slope * (row - shape[0] / 2)) * np.cos(np.radians(angle_deg))
    image = 100.0 + 400.0 * (1.0 + erf(across * PIXEL_MM / (np.sqrt(2.0) * sigma_mm)))
    return image[:, ::-1] if turn else image


@pytest.mark.parametrize("angle_deg", [-2.7, 1.6, 2.0])
@pytest.mark.parametrize("turn", [False, True])
def test_mtf_of_a_gaussian_edge(angle_deg, turn):
    frequency, found = edge_mtf(edge(angle_deg, turn=turn), PIXEL_MM)
    assert frequency[0] == 0.0
    assert frequency[-1] == pytest.approx(5.0, abs=0.1)
    expected = np.exp(-2.0 * (np.pi * 0.06 * frequency) ** 2)
    np.testing.assert_allclose(found, expected, atol=2e-3)  # bins of a tenth of a pixel


def test_mtf_of_a_noisy_edge():
    noisy = edge() + np.random.default_rng(1).normal(0.0, 4.0, (200, 240))
    frequency, found = edge_mtf(noisy, PIXEL_MM)
    low = frequency < 3.0
    # 0.5 per cent noise of the step, 20 pixels a bin, 100 mm-1/10 of differences
    np.testing.assert_allclose(
        found[low], np.exp(-2.0 * (np.pi * 0.06 * frequency[low]) ** 2), atol=0.06
    )


def test_an_edge_along_the_columns_or_none_is_refused():
    with pytest.raises(InputError, match=r"found an edge at 0\.00 degrees to the columns"):
        edge_mtf(edge(0.0), PIXEL_MM)
    flat = np.random.default_rng(0).normal(100.0, 1.0, (50, 60))
    with pytest.raises(InputError, match="expected an edge"):
        edge_mtf(flat, PIXEL_MM)


def test_white_noise_has_its_variance_at_every_frequency():
    fields = np.random.default_rng(2).normal(500.0, 10.0, (4, 512, 512))
    frequency, found = noise_power(fields, PIXEL_MM, side=128)
    assert (frequency[0], frequency.size) == (pytest.approx(1 / 12.8), 63)
    expected = 10.0**2 / 500.0**2 * PIXEL_MM**2
    assert found.mean() == pytest.approx(expected, rel=0.02)
    # 196 half-overlapping squares and 28 lines a frequency: 2 per cent; five of them
    np.testing.assert_allclose(found, expected, rtol=0.10)


def test_a_slow_trend_is_no_noise():
    y, x = np.mgrid[0:256, 0:256] / 256.0
    field = 500.0 * (1.0 + 0.2 * x - 0.1 * y + 0.1 * x * y)
    _, found = noise_power([field], PIXEL_MM, side=256)
    assert found.max() < 1e-20


def test_coloured_noise_keeps_its_colour():
    white = np.random.default_rng(3).normal(0.0, 1.0, (512, 512))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(512, PIXEL_MM), np.fft.fftfreq(512, PIXEL_MM)))
    field = 100.0 + np.fft.ifft2(np.fft.fft2(white) * np.exp(-0.3 * frequency)).real
    axis, found = noise_power([field], PIXEL_MM, side=128)
    expected = np.exp(-0.6 * axis) / 100.0**2 * PIXEL_MM**2
    assert np.mean(found / expected) == pytest.approx(1.0, abs=0.05)


def test_pictures_smaller_than_a_square_are_refused():
    with pytest.raises(InputError, match="no image of 256 x 256 pixels"):
        noise_power([np.ones((200, 300))], PIXEL_MM)


def test_an_ideal_counter_has_an_efficiency_of_one():
    assert detective_efficiency(np.ones(1), np.array([1e-3]), 1000.0)[0] == pytest.approx(1.0)
