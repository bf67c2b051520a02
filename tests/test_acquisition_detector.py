from dataclasses import replace

import numpy as np
import pytest

from mammosim.acquisition.detectors import DETECTORS, find_detector
from mammosim.acquisition.noise import detect, noise_through_blur
from mammosim.errors import InputError

PIXEL_MM = 0.07
QUIET = replace(find_detector("a-Se-70"), electronic_noise_kev=0.0, structure_noise=0.0)


def flat_field(detector, signal_kev, variance_kev2, seed=1, size=512, pixel_mm=PIXEL_MM):
    signal = np.full((size, size), signal_kev, np.float32)
    variance = np.full((size, size), variance_kev2, np.float32)
    detect(signal, variance, detector, pixel_mm, np.random.default_rng(seed))
    return signal.astype(np.float64)


@pytest.mark.parametrize("name", DETECTORS)
def test_quantum_noise_has_the_predicted_variance(name):
    detector = replace(DETECTORS[name], electronic_noise_kev=0.0, structure_noise=0.0)
    recorded = flat_field(detector, 7.0e4, 1.5e6)
    expected = 1.5e6 * noise_through_blur(detector, PIXEL_MM)
    # 262 144 pixels: the standard error of a variance is sqrt(2/n) = 0.3 per cent; four of them,
    # and correlation by blur doubles it
    assert recorded.var() == pytest.approx(expected, rel=0.025)
    assert recorded.mean() == pytest.approx(7.0e4, rel=1e-4)


def test_the_aperture_is_not_applied_to_pixel_noise():
    """With the aperture's sinc as well, another 40 per cent of the variance would be gone."""
    axis = (np.arange(200) + 0.5) / 400.0 / PIXEL_MM
    fx, fy = np.meshgrid(axis, axis)
    aperture = np.sinc(PIXEL_MM * fx) * np.sinc(PIXEL_MM * fy)
    both = np.mean((QUIET.transfer(np.hypot(fx, fy)) * aperture) ** 2)
    left = noise_through_blur(QUIET, PIXEL_MM)
    assert 0.6 < left < 0.7
    assert both / left == pytest.approx(0.65, abs=0.05)


def test_electronic_noise_and_fixed_pattern_add_up():
    detector = replace(QUIET, electronic_noise_kev=300.0, structure_noise=0.01)
    variances = [flat_field(detector, level, 20.0 * level).var() for level in (0.0, 1e5)]
    left = noise_through_blur(detector, PIXEL_MM)
    expected = [300.0**2, 300.0**2 + 20.0 * 1e5 * left + (0.01 * 1e5) ** 2]
    np.testing.assert_allclose(variances, expected, rtol=0.025)  # as above


def test_fixed_pattern_is_the_same_in_every_exposure():
    detector = replace(QUIET, structure_noise=0.01)
    one, two = (flat_field(detector, 1e5, 0.0, seed=seed) for seed in (1, 2))
    np.testing.assert_array_equal(one, two)
    assert one.std() == pytest.approx(1e3, rel=0.02)


def test_blur_has_the_converters_transfer_function():
    detector = find_detector("CsI-100")
    columns = np.arange(500) * 0.1
    for frequency in (1.0, 2.0, 4.0):
        wave = 1000.0 + 500.0 * np.cos(2.0 * np.pi * frequency * columns)
        signal = np.tile(wave.astype(np.float32), (64, 1))
        detect(signal, None, detector, 0.1, np.random.default_rng(0))
        middle = signal[32, 100:400]  # whole periods, away from the edges
        phase = np.exp(-2j * np.pi * frequency * columns[100:400])
        found = 2.0 * abs(np.mean(middle * phase)) / 500.0
        assert found == pytest.approx(detector.transfer(np.array(frequency)), rel=5e-3)


def test_caesium_iodide_has_the_measured_mtf():
    """0.73, 0.42, 0.28 at 2, 4, 5 per mm with the aperture of 0.1 mm; fitted within 0.03."""
    f = np.array([2.0, 4.0, 5.0])
    found = find_detector("CsI-100").transfer(f) * np.sinc(0.1 * f)
    np.testing.assert_allclose(found, [0.73, 0.42, 0.28], atol=0.03)


def test_selenium_is_above_two_fifths_at_nyquist():
    nyquist = np.array(0.5 / PIXEL_MM)
    found = find_detector("a-Se-70").transfer(nyquist) * np.sinc(PIXEL_MM * nyquist)
    assert 0.40 < found < 0.50


def test_blur_keeps_a_flat_field_and_the_sum():
    flat = np.full((50, 40), 123.0, np.float32)
    detect(flat, None, QUIET, PIXEL_MM, np.random.default_rng(0))
    np.testing.assert_allclose(flat, 123.0, rtol=1e-6)
    point = np.zeros((101, 101), np.float32)
    point[50, 50] = 1.0
    detect(point, None, find_detector("CsI-100"), 0.1, np.random.default_rng(0))
    assert point.sum() == pytest.approx(1.0, abs=0.02)  # long tails leave the picture


def test_absorption_efficiency_lies_between_none_and_all():
    energy = np.linspace(12.7, 35.0, 40)
    for name, detector in DETECTORS.items():
        efficiency = detector.efficiency(energy)
        if name == "ideal":
            assert np.all(efficiency == 1.0)
        else:
            assert np.all((efficiency > 0.2) & (efficiency < 1.0))


def test_unknown_detector():
    with pytest.raises(
        InputError, match=r"acquisition.detector: found 'film', expected one of a-Se"
    ):
        find_detector("film")
