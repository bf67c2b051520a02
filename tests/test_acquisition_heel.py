"""Heel effect: off-axis spectra, and their way into the signal."""

import numpy as np
import pytest
from naive.acquisition import body_paths

from mammosim.acquisition import AcquisitionSettings, expose
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.heel import TUBE_TILT_DEG, heel_ratio
from mammosim.acquisition.recording import detector_input
from mammosim.acquisition.signal import response
from mammosim.acquisition.spectrum import make_beam
from mammosim.acquisition.tube import tube_fluence
from mammosim.errors import InputError

BEAM = make_beam("W", "Rh", 28.0)
AXIS = np.tan(np.radians(TUBE_TILT_DEG))


def test_nothing_changes_on_the_tubes_axis():
    ratio = heel_ratio("W", 28.0, BEAM.energy_kev, np.array([AXIS]))
    np.testing.assert_allclose(ratio, 1.0, rtol=1e-12)


def test_the_beam_weakens_and_hardens_towards_the_anode():
    tangents = np.arange(0.0, 181.0, 10.0) / 650.0
    ratio = heel_ratio("W", 28.0, BEAM.energy_kev, tangents)
    photons = ratio * BEAM.fluence_mm2_mas
    total = photons.sum(axis=1)
    assert np.all(np.diff(total) < 0.0)
    assert np.all(np.diff(photons @ BEAM.energy_kev / total) > 0.0)


def test_size_of_the_effect():
    """SpekPy itself, W/Rh 28 kV: fluence per solid angle 6 degrees towards the cathode and 9
    towards the anode against the axis, computed with its x offset and an ideal filter: 1.019 and
    0.889."""
    tangents = np.tan(np.radians([TUBE_TILT_DEG - 6.0, TUBE_TILT_DEG + 9.0]))
    thin = make_beam("W", "Rh", 28.0, air_mm=0.0, paddle_mm=0.0)
    ratio = heel_ratio("W", 28.0, thin.energy_kev, tangents)
    found = ratio @ thin.fluence_mm2_mas / thin.fluence_mm2_mas.sum()
    # 1 per cent: linear between nodes of 2 degrees, and SpekPy's own attenuation of the filter
    np.testing.assert_allclose(found, [1.019, 0.889], rtol=0.01)


@pytest.mark.parametrize("angle_deg", [-6.0, 9.0])
def test_fluence_is_that_at_one_metre_along_the_ray(angle_deg):
    """The same point asked of SpekPy, on a nearer plane."""
    import spekpy

    angle = np.radians(angle_deg)
    tube = spekpy.Spek(
        kvp=28.0, th=16.0, dk=0.25, targ="W", physics="casim",
        x=-100.0 * np.sin(angle), z=100.0 * np.cos(angle), mas=1.0,
    )  # fmt: skip
    _, per_kev_cm2 = tube.get_spectrum(edges=False, flu=True, diff=True)
    found = tube_fluence("W", 28.0, angle_deg)[1]
    np.testing.assert_allclose(found, per_kev_cm2 * 0.25 / 100.0, rtol=1e-9)


@pytest.mark.parametrize("laterality", ["L", "R"])
def test_columns_get_their_own_beam(laterality):
    paths = body_paths(
        {"gland": np.full((6, 180), 30.0)}, pixel_mm=1.0, laterality=laterality, thickness_mm=30.0
    )
    keys = {"kvp": 28.0, "mas": 50.0, "scatter": False}
    plain, heel = (
        detector_input(paths, AcquisitionSettings(heel=heel, **keys)).signal[3]
        for heel in (False, True)
    )
    ratio = (heel / plain)[:: 1 if laterality == "L" else -1]  # from the chest wall
    assert np.all(np.diff(ratio.reshape(9, 20).mean(axis=1)) < 0.0)
    assert ratio[1] > 1.0 > ratio[-2]
    assert ratio[68] == pytest.approx(1.0, abs=2e-3)  # the axis, 68.3 mm in front
    unit = response(BEAM, find_detector("a-Se-70"), paths.gantry, 1.0, heel=True)
    assert unit.energy_weight.shape[0] == 180
    # Behind 30 mm of gland the beam is harder, so that the anode's own absorption counts less.
    air = unit.air_profile[:: 1 if laterality == "L" else -1]
    assert air[-1] / air[0] < ratio[-1] / ratio[0]


def test_the_picture_for_reading_is_free_of_it():
    paths = body_paths({"adipose": np.full((200, 90), 40.0)}, pixel_mm=1.0, thickness_mm=40.0)
    image = expose(paths, kvp=28.0, mas=80.0, heel=True, noise=False, scatter=False)
    counts = image.for_processing[100].astype(float)
    assert counts[5] / counts[85] > 1.03
    shown = image.for_presentation[95:105].astype(float)
    assert shown[:, 5].mean() == pytest.approx(shown[:, 85].mean(), abs=0.02 * 4095)


def test_a_spectrum_file_has_no_anode():
    paths = body_paths({"gland": np.full((4, 4), 40.0)})
    with pytest.raises(InputError, match=r"heel: found true with a spectrum_file"):
        expose(paths, heel=True, spectrum_file="any.txt")
