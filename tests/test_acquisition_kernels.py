"""Compiled loops over pixels against their slow twins."""

from __future__ import annotations

import numpy as np
import pytest
from naive import acquisition as naive
from naive.acquisition import body_paths
from naive.acquisition import primary as naive_primary

from mammosim.acquisition import _kernels
from mammosim.acquisition.attenuation import attenuation_per_mm
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.signal import primary, rays_of, response
from mammosim.acquisition.spectrum import make_beam
from mammosim.tissues import composition

MATERIALS = composition("hammerstein", "hydroxyapatite")
GANTRIES = [
    body_paths({"gland": np.zeros((7, 5))}, pixel_mm=20.0, laterality=side).gantry for side in "LR"
]
"""Pixels so large that rays at the corners are oblique: 1/cos is up to 1.02."""


def test_compiled_primary_agrees_with_its_twin():
    rng = np.random.default_rng(4)
    lengths = {name: rng.uniform(-5.0, 20.0, (7, 5)).clip(0.0) for name in ("adipose", "gland")}
    lengths["calcification"] = np.where(rng.random((7, 5)) < 0.2, 0.3, 0.0)
    for image in lengths.values():
        image[2] = 0.0
    for laterality in "LR":
        paths = body_paths(lengths, pixel_mm=20.0, laterality=laterality)
        unit = response(make_beam("W", "Rh", 28.0), find_detector("a-Se-70"), GANTRIES[0], 0.0)
        mu = np.stack(
            [attenuation_per_mm(MATERIALS[name], unit.energy_kev) for name in lengths], axis=1
        )
        signal, square = primary(paths, MATERIALS, unit)
        depth = unit.flat_depth
        expected = naive_primary(
            paths.attenuating_mm, mu, unit.energy_weight[0], depth, paths.gantry
        )
        met = paths.length_mm.any(axis=0)
        np.testing.assert_allclose(signal[met], expected[met], rtol=1e-6)  # float32 result
        np.testing.assert_allclose(signal, expected, rtol=1e-4)  # mean depth where there is air
        expected = naive_primary(
            paths.attenuating_mm, mu, unit.square_weight[0], depth, paths.gantry
        )
        np.testing.assert_allclose(square[met], expected[met], rtol=1e-6)


@pytest.mark.parametrize("cell", [1, 2, 3])
def test_scatter_is_added_as_its_twin_adds_it(cell):
    rng = np.random.default_rng(5)
    signal = rng.uniform(0.0, 9.0, (7, 5)).astype(np.float32)
    square = (signal * rng.uniform(15.0, 25.0, (7, 5))).astype(np.float32)
    signal[3, 2] = square[3, 2] = 0.0  # behind metal
    coarse = rng.uniform(0.0, 3.0, (-(-7 // cell), -(-5 // cell)))
    expected = naive.with_scatter(coarse, cell, (0.75, 0.1), signal, square)
    _kernels.add_scatter_kernel(coarse, float(cell), 0.75, 0.1, signal, square)
    np.testing.assert_allclose(np.array([signal, square]), expected, rtol=1e-6)  # float32


@pytest.mark.parametrize("gantry", GANTRIES, ids=["L", "R"])
@pytest.mark.parametrize("columns", [1, 5])
def test_log_attenuation_agrees_with_its_twin(gantry, columns):
    rng = np.random.default_rng(6)
    air = rng.uniform(50.0, 60.0, columns)
    signal = rng.uniform(0.0, 60.0, (7, 5)).astype(np.float32)
    signal[0, 0] = 0.0  # counts as a millionth of air
    expected = naive.log_attenuation(signal, air, 0.3, gantry)
    assert expected[0, 0] == pytest.approx(np.log(1e6))
    out = np.empty_like(signal)
    _kernels.log_attenuation_kernel(signal, air, 0.3, rays_of(gantry), out)
    np.testing.assert_allclose(out, expected, rtol=1e-5, atol=1e-6)  # float32 of up to 14


def test_grey_levels_are_those_of_their_twin():
    rng = np.random.default_rng(7)
    attenuation = rng.uniform(-0.5, 4.0, (9, 8)).astype(np.float32)
    bounds = ((0.0, 1.5), (0.0, 0.6), (-0.5, 2.5), (0.0, 0.9), (1.5, 4.5), (1.5, 4.5), (0.0, 1.0))
    coarse = [rng.uniform(low, high, (3, 3)) for low, high in bounds]
    curve = _kernels.ToneCurve(2.5, 0.6, 0.15, 0.65, 0.15, 0.55, 0.8, 1.3, 1.7, 0.012)
    out = np.empty(attenuation.shape, np.uint16)
    _kernels.present_kernel(attenuation, *coarse, 3.0, (1.0, 1.8), 3.1, curve, 4095.0, out)
    shown = []
    for at in np.ndindex(attenuation.shape):
        here = [naive.bilinear(one, 3, *at) for one in coarse]
        shown.append(
            np.floor(4095.0 * naive.grey(attenuation[at], *here, (1.0, 1.8), 3.1, curve) + 0.5)
        )
    shown = np.array(shown)
    assert (shown < 0.06 * 4095).any()
    assert (shown > 0.85 * 4095).any()
    # One value where rounding falls to the other side.
    np.testing.assert_allclose(out.ravel(), shown, atol=1)
    assert (out.ravel() == shown).mean() > 0.95
