from dataclasses import replace

import numpy as np
import pytest
from naive.acquisition import scatter as naive_scatter
from naive.acquisition import semicircle_paths
from naive.projection import phantom, unsqueezed
from scipy.ndimage import map_coordinates

from mammosim.acquisition import AcquisitionSettings, expose
from mammosim.acquisition.coarse import coarse_paths
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.recording import beam_for
from mammosim.acquisition.scatter import SCATTER_MODELS, Scatter, ScatterCase
from mammosim.acquisition.scatter.convolution import KERNELS, boone_ratio, scatter_signal
from mammosim.errors import InputError
from mammosim.projection import project
from mammosim.tissues import composition

CELL_MM = 2.0
MATERIALS = composition("hammerstein", "hydroxyapatite")


def semicircle(diameter_cm, margin_mm=20.0, cell_mm=CELL_MM):
    """Share of each cell inside a semicircle on column 0, by 8 x 8 points."""
    radius = 5.0 * diameter_cm
    rows = 2 * int((radius + margin_mm) / cell_mm)
    columns = int((radius + margin_mm) / cell_mm)
    fine = (np.arange(8) + 0.5) / 8.0
    y = ((np.arange(rows)[:, None] + fine).ravel() - rows / 2) * cell_mm
    x = ((np.arange(columns)[:, None] + fine).ravel()) * cell_mm
    inside = np.hypot(y[:, None], x[None, :]) <= radius
    return inside.reshape(rows, 8, columns, 8).mean(axis=(1, 3))


def ratio_at_centre_of_mass(diameter_cm, thickness_cm, cell_mm=CELL_MM):
    part = semicircle(diameter_cm, cell_mm=cell_mm)
    thickness = np.where(part > 0.0, 10.0 * thickness_cm, 0.0)
    scatter = scatter_signal(part, thickness, cell_mm)
    column = 4.0 * 5.0 * diameter_cm / (3.0 * np.pi) / cell_mm - 0.5
    row = part.shape[0] / 2 - 0.5
    return map_coordinates(scatter, [[row], [column]], order=1)[0]


@pytest.mark.parametrize("thickness_cm", [2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 6.5, 7.0, 8.0])
@pytest.mark.parametrize("diameter_cm", [3.0, 4.0, 6.0, 10.0, 16.0, 24.0, 30.0])
def test_ratio_agrees_with_boones_formula(diameter_cm, thickness_cm):
    """Over the whole range that the formula was made for."""
    # 1 per cent is the formula's own error; the kernels miss it by at most 0.8. A semicircle of
    # 15 mm is coarse in cells of 2 mm, which takes another 0.9 per cent; half-way between two
    # kernels 0.2 more.
    cell_mm = 1.0 if diameter_cm == 3.0 else CELL_MM
    expected = boone_ratio(diameter_cm, thickness_cm)
    found = ratio_at_centre_of_mass(diameter_cm, thickness_cm, cell_mm)
    assert found == pytest.approx(expected, rel=0.01)
    assert ratio_at_centre_of_mass(diameter_cm, thickness_cm) == pytest.approx(expected, rel=0.02)


def test_boones_formula():
    found = [boone_ratio(16.0, thickness) for thickness in (2.0, 4.0, 6.0, 8.0)]
    np.testing.assert_allclose(found, [0.235, 0.413, 0.622, 0.889], atol=5e-4)


def test_fft_agrees_with_the_sum_over_all_cells():
    rng = np.random.default_rng(2)
    primary = rng.uniform(0.5, 1.5, (9, 6))
    thickness = rng.choice([0.0, 20.0, 50.0], (9, 6))

    def kernel_of(thickness_mm, r):
        a1, l1, a2, l2 = KERNELS[round(thickness_mm / 10.0) - 1]
        one = a1 * np.exp(-r / l1) / (2 * np.pi * l1**2)
        return one + a2 * np.exp(-r / l2) / (2 * np.pi * l2**2)

    expected = naive_scatter(primary, thickness, CELL_MM, kernel_of)
    np.testing.assert_allclose(scatter_signal(primary, thickness, CELL_MM), expected, rtol=1e-9)


def test_scatter_is_linear_in_the_primary_and_absent_without_tissue():
    part = semicircle(8.0)
    thickness = 40.0 * part
    np.testing.assert_allclose(
        scatter_signal(3.0 * part, thickness, CELL_MM),
        3.0 * scatter_signal(part, thickness, CELL_MM), rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    assert not scatter_signal(np.ones((20, 20)), np.zeros((20, 20)), CELL_MM).any()


def test_ratio_falls_towards_the_edge_of_the_breast():
    """At a straight edge half the neighbourhood is missing; in air scatter dies away."""
    part = semicircle(16.0)
    scatter = scatter_signal(part, np.where(part > 0.0, 50.0, 0.0), CELL_MM)
    middle_row = scatter[part.shape[0] // 2]
    edge = int(80.0 / CELL_MM)
    inside = middle_row[int(34.0 / CELL_MM)]
    # a circle bends away from its edge, so a little less than the half of a straight one
    assert 0.35 * inside < middle_row[edge] < 0.5 * inside
    assert np.all(np.diff(middle_row[edge - 10 :]) < 0.0)
    assert middle_row[edge + 8] < 0.2 * inside


def test_thickness_beyond_the_kernels_takes_the_last_one():
    part = semicircle(10.0)
    at_limit = scatter_signal(part, np.full(part.shape, 100.0), CELL_MM)
    np.testing.assert_array_equal(
        scatter_signal(part, np.full(part.shape, 130.0), CELL_MM), at_limit
    )


def case(**given) -> ScatterCase:
    """A uniform semicircle with everything that a model may ask for but voxels."""
    settings = AcquisitionSettings(kvp=28.0)
    paths = semicircle_paths(12.0, 4.0, pixel_mm=1.0)
    coarse = coarse_paths(paths, MATERIALS)
    primary = np.where(coarse.inside, 1.0, 5.0)
    return ScatterCase(
        primary, coarse.tissue_mm, coarse.cell, paths.gantry, beam_for(settings, paths),
        find_detector(settings.detector), settings.support_mm, MATERIALS, **given,
    )  # fmt: skip


@pytest.mark.parametrize("name", SCATTER_MODELS)
def test_every_model_returns_a_signal_of_the_cells_and_changes_nothing(name):
    given = case()
    before = given.primary.copy(), given.thickness_mm.copy()
    scatter = SCATTER_MODELS[name](given).signal
    assert scatter.shape == given.primary.shape
    assert scatter.dtype == np.float64
    assert (scatter >= 0.0).all()
    np.testing.assert_array_equal(given.primary, before[0])
    np.testing.assert_array_equal(given.thickness_mm, before[1])


def test_a_model_is_chosen_by_name_and_true_and_false_still_mean_what_they_did():
    paths = semicircle_paths(12.0, 4.0, pixel_mm=1.0)
    keys = {"kvp": 28.0, "mas": 80.0, "noise": False}

    def picture(scatter):
        return expose(paths, scatter=scatter, **keys).for_processing

    np.testing.assert_array_equal(picture({"model": "kernels"}), picture(True))
    np.testing.assert_array_equal(picture({"model": "none"}), picture(False))
    assert picture(True).mean() > picture(False).mean()


def test_a_model_sees_the_breast_of_the_paths_or_the_one_given(monkeypatch):
    seen = []

    def model(given):
        seen.append(given.breast)
        return Scatter(np.zeros_like(given.primary))

    monkeypatch.setitem(SCATTER_MODELS, "monte-carlo", model)
    breast = unsqueezed(phantom(np.ones((20, 20, 20), np.uint8)), spacing_mm=5.0)
    paths = project(breast, pixel_mm=2.0)
    assert paths.breast is breast
    keys = {"kvp": 28.0, "mas": 80.0}
    expose(paths, **keys)
    other = replace(breast)
    expose(paths, breast=other, **keys)
    expose(replace(paths, breast=None), **keys)
    assert [each is one for each, one in zip(seen, (breast, other, None), strict=True)] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("scatter", "message"),
    [
        (
            {"model": "monte"},
            "acquisition.scatter.model: found 'monte', expected one of monte-carlo",
        ),
        ({"photon": 3}, "acquisition.scatter.photon: unknown key"),
        ({"photons": 0}, "acquisition.scatter.photons: found 0, expected"),
        ({"photons": 10**12}, "acquisition.scatter.photons: found 1000000000000, expected"),
        ("kernels", "acquisition.scatter: found 'kernels', expected true, false, or a section"),
    ],
)
def test_a_scatter_section_that_cannot_be_used_is_one_mistake(scatter, message):
    with pytest.raises(InputError) as caught:
        expose(semicircle_paths(8.0, 4.0), scatter=scatter)
    assert len(caught.value.problems) == 1
    assert message in str(caught.value)
