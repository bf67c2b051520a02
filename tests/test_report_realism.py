"""Numbers beside published ranges: the texture's exponent on known noise, verdicts, the page."""

from __future__ import annotations

import dataclasses
import html
import math

import numpy as np
import pytest
from make_records import make_compressed, make_mammogram

from mammosim.geometry import View
from mammosim.report import ReportedView, render_report
from mammosim.report.realism import Finding, realism
from mammosim.report.texture import power_law_exponent

VIEW = View("CC", "L")
PITCH_MM = 0.5


def power_law_noise(shape, exponent, seed=1):
    """Gaussian noise whose power falls as frequency to minus `exponent`, standard deviation 1."""
    rng = np.random.default_rng(seed)
    frequency = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) * frequency ** (-exponent / 2.0)
    noise = np.fft.irfft2(spectrum, shape)
    return noise / noise.std()


def textured(exponent, shape=(480, 360), margin_px=20):
    """A mammogram of 240 x 180 mm whose logarithm is such noise, breast but for a margin."""
    mammogram = make_mammogram(VIEW)
    gantry = dataclasses.replace(mammogram.gantry, rows=shape[0], columns=shape[1])
    raw = 4000.0 * np.exp(0.1 * power_law_noise(shape, exponent))
    shown = np.zeros(shape, np.uint16)
    shown[margin_px:-margin_px, :-margin_px] = 2000
    return dataclasses.replace(
        mammogram, gantry=gantry, for_processing=raw.astype(np.uint16), for_presentation=shown
    )


@pytest.mark.parametrize("exponent", [1.5, 2.0, 3.0, 3.5])
def test_the_exponent_of_known_noise_is_found(exponent):
    # 30 to 40 squares of 14 rings: the median scatters by a few hundredths; a window of finite
    # size flattens steep spectra a little.
    assert power_law_exponent(textured(exponent)) == pytest.approx(exponent, abs=0.15)


def test_a_gradient_of_thickness_does_not_count_as_texture():
    flat = textured(2.0)
    slope = np.exp(-np.linspace(0.0, 1.0, 480))[:, None]
    tilted = dataclasses.replace(
        flat, for_processing=(flat.for_processing * slope).astype(np.uint16)
    )
    assert power_law_exponent(tilted) == pytest.approx(power_law_exponent(flat), abs=0.05)


def test_without_a_square_in_the_breast_nothing_is_measured():
    small = textured(3.0, shape=(100, 80))
    assert math.isnan(power_law_exponent(small))
    finding = realism(make_compressed(VIEW), small)[0]
    assert finding.verdict == "not measured"
    assert finding.value_text == "–"


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (0.9, "lower than published"), (1.0, "as published"), (2.0, "as published"),
        (2.1, "higher than published"), (math.nan, "not measured"),
    ],
)  # fmt: skip
def test_verdicts_say_where_a_number_lies(value, verdict):
    assert Finding("x", "mm", value, 1.0, 2.0, "a source").verdict == verdict


def test_a_range_that_is_not_published_is_not_called_so():
    unpublished = [
        f.name
        for f in realism(make_compressed(VIEW), make_mammogram(VIEW))
        if f.basis == "expected"
    ]
    assert unpublished == ["Quantum noise of a pixel behind the dense part"]
    assert (
        Finding("x", "", 3.0, 1.0, 2.0, "ours", basis="expected").verdict == "higher than expected"
    )


def test_ranges_follow_thickness_view_and_pixel():
    findings = {f.name: f for f in realism(make_compressed(VIEW), make_mammogram(VIEW))}
    dose = findings["Mean glandular dose"]
    assert 2.0 < dose.high < 2.5  # 52 mm, between the guideline's 45 and 53 mm
    noise = findings["Quantum noise of a pixel behind the dense part"]
    assert noise.high == pytest.approx(3.4 * 0.07 / PITCH_MM)
    mlo = {
        f.name: f
        for f in realism(make_compressed(View("MLO", "L")), make_mammogram(View("MLO", "L")))
    }
    pressure = "Mean pressure under the paddle"
    assert mlo[pressure].high < findings[pressure].high
    assert findings[pressure].value == 11.24


def test_every_finding_names_its_source_and_a_range():
    page = _page()
    for finding in realism(make_compressed(VIEW), make_mammogram(VIEW)):
        assert finding.source
        assert 0.0 <= finding.low < finding.high
        assert finding.name in page
        assert finding.verdict in page


def _page():
    record = {"determinism": "", "seed": 1, "versions": {}, "stage_seconds": {},
              "peak_memory_mb": 1.0, "settings": {}, "references": [], "run_hash": ""}  # fmt: skip
    views = [ReportedView(make_compressed(VIEW), make_mammogram(VIEW))]
    return html.unescape(render_report(views, [], record))
