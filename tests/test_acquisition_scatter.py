from dataclasses import replace

import numpy as np
import pytest
from naive.acquisition import layered as naive_layered
from naive.acquisition import semicircle_paths
from naive.projection import phantom, unsqueezed

from mammosim.acquisition import AcquisitionSettings, expose
from mammosim.acquisition.blocks import block_mean
from mammosim.acquisition.coarse import coarse_paths
from mammosim.acquisition.detectors import find_detector
from mammosim.acquisition.recording import beam_for, response_for, scatter_case
from mammosim.acquisition.scatter import SCATTER_MODELS, Scatter, ScatterCase
from mammosim.acquisition.scatter.layered import (
    AROUND_MM,
    MEAN_WAY,
    MULTIPLE,
    TANGENTS,
    CellGrid,
    Emission,
    Layer,
    layered_scatter,
)
from mammosim.acquisition.signal import primary
from mammosim.errors import InputError
from mammosim.projection import project
from mammosim.tissues import composition

CELL_MM = 2.0
MATERIALS = composition("hammerstein", "hydroxyapatite")


def flat_emission(rng, energies=1):
    """An emission of any shape."""
    falling = np.exp(-TANGENTS) * rng.uniform(0.05, 0.2, (energies, 1))
    return Emission(falling, np.full(energies, 0.5))


def test_layered_scatter_agrees_with_the_sum_over_all_pairs_of_cells():
    """Below a focal spot that is far away, where the rays are parallel."""
    rng = np.random.default_rng(2)
    shape = (1, 9, 6)
    layers = [
        Layer(14.0, np.full(shape, 0.05), flat_emission(rng), plate=True),
        Layer(25.0, rng.uniform(0.0, 0.8, shape), flat_emission(rng)),
        Layer(40.0, rng.uniform(0.0, 0.8, shape), flat_emission(rng)),
    ]
    beam = rng.uniform(0.5, 1.5, shape)
    found = layered_scatter(beam, layers, CellGrid(CELL_MM, 4.0, 0.0, 1e9))
    np.testing.assert_allclose(
        found,
        naive_layered(beam[0], layers, CELL_MM, TANGENTS, MULTIPLE, AROUND_MM, MEAN_WAY),
        rtol=1e-6,
    )


def test_layered_scatter_is_linear_in_the_beam_and_absent_without_layers():
    rng = np.random.default_rng(3)
    layers = [Layer(30.0, rng.uniform(0.0, 1.0, (2, 12, 8)), flat_emission(rng, 2))]
    beam, grid = rng.uniform(0.5, 1.5, (2, 12, 8)), CellGrid(CELL_MM, 5.5, 0.0, 650.0)
    once = layered_scatter(beam, layers, grid)
    np.testing.assert_allclose(layered_scatter(3.0 * beam, layers, grid), 3.0 * once, rtol=1e-9)
    assert not layered_scatter(beam, [], grid).any()


# FDA's MC-GPU v1.3: semicircle of radius 80 mm, half gland and half fat, W/Rh 28 kV, air gap 15 mm,
# ideal detector; scatter over primary at the centre of mass, 6 to 20 mm from the chest wall, and
# 10 to 20 mm inside the edge, bare and between 3 mm of polycarbonate and 1 mm of support
MCGPU = [
    (20.0, False, (0.234, 0.202, 0.199)),
    (60.0, False, (0.637, 0.532, 0.522)),
    (40.0, True, (0.510, 0.427, 0.474)),
    (60.0, True, (0.725, 0.590, 0.687)),
]


@pytest.mark.parametrize(("thickness_mm", "plates", "expected"), MCGPU)
def test_kernels_agree_with_monte_carlo_on_slabs(thickness_mm, plates, expected):
    given = upright_semicircle(thickness_mm, plates)
    ratio = SCATTER_MODELS["kernels"](given).signal, given.primary
    gantry = given.gantry
    y = gantry.y_max_mm - (np.arange(given.primary.shape[0]) + 0.5) * given.cell_mm
    x = (np.arange(given.primary.shape[1]) + 0.5) * given.cell_mm
    radius = np.hypot(x[None, :], y[:, None]) * 635.0 / 650.0
    centre = (np.abs(x[None, :] - 34.0) < 10.0) & (np.abs(y[:, None]) < 10.0)
    band = (x[None, :] > 6.0) & (x[None, :] < 20.0) & (np.abs(y[:, None]) < 40.0)
    ring = (radius > 60.0) & (radius < 70.0) & (x[None, :] > 20.0)
    found = [ratio[0][cells].sum() / ratio[1][cells].sum() for cells in (centre, band, ring)]
    # 0 to 4 % in the middle and 0 to 6 in the ring, another composition and spectrum among it
    np.testing.assert_allclose(found[:2], expected[:2], rtol=0.05)
    assert found[2] == pytest.approx(expected[2], rel=0.08)


def upright_semicircle(thickness_mm, plates):
    """The slab of `MCGPU` between parallel plates, with upright sides."""
    settings = AcquisitionSettings(
        kvp=28.0, detector="ideal", paddle_mm=3.0 * plates, support_mm=1.0 * plates
    )
    paths = semicircle_paths(16.0, thickness_mm / 10.0, pixel_mm=1.0, margin_mm=40.0)
    gantry = paths.gantry
    row, column = np.indices((gantry.rows, gantry.columns))
    radius = np.hypot(*np.moveaxis(gantry.detector_xy_mm(row, column), -1, 0))
    height, spot = gantry.focal_spot_height_mm, gantry.focal_spot_mm[2]
    levels = (np.arange(40) + 0.5) / 40 * thickness_mm
    inside = np.mean([radius * (spot - z) / height < 80.0 for z in levels], axis=0)
    length = 0.5 * inside * thickness_mm * np.hypot(1.0, radius / height)
    both = np.stack([length, length]).astype(np.float32)
    paths = replace(paths, length_mm=both, attenuating_mm=both)
    coarse = coarse_paths(paths, MATERIALS)
    beam = beam_for(settings, paths)
    signal, _ = primary(paths, MATERIALS, response_for(settings, beam, gantry))
    return scatter_case(
        block_mean(signal, coarse.cell), coarse.tissue_mm, coarse.cell, gantry, beam, settings, None
    )


def test_kernels_do_not_peak_at_an_upright_side():
    """Monte Carlo falls by a third from 8 mm inside the side of a bare slab to 2 mm outside it.

    Straight above the cells just outside there is only air, but what arrives there crosses tissue.
    """
    given = upright_semicircle(80.0, False)
    found = SCATTER_MODELS["kernels"](given).signal
    y = given.gantry.y_max_mm - (np.arange(found.shape[0]) + 0.5) * given.cell_mm
    x = (np.arange(found.shape[1]) + 0.5) * given.cell_mm
    radius = np.hypot(x[None, :], y[:, None])
    rings = [found[(radius >= r) & (radius < r + 2.0) & (x > 10.0)].mean() for r in (72, 80, 82)]
    assert max(rings[1:]) < 1.1 * rings[0]


def test_kernels_know_plates_and_air_gap():
    bare, between = (upright_semicircle(40.0, plates) for plates in (False, True))
    far = replace(bare, gantry=replace(bare.gantry, support_to_detector_mm=100.0))
    empty = replace(bare, thickness_mm=np.zeros_like(bare.thickness_mm))
    scatter = {
        name: SCATTER_MODELS["kernels"](given).signal
        for name, given in {"bare": bare, "between": between, "far": far, "empty": empty}.items()
    }
    middle = (slice(50, 70), slice(10, 25))
    beside = (slice(2, 6), slice(20, 40))
    assert scatter["far"][middle].mean() < 0.7 * scatter["bare"][middle].mean()
    assert not scatter["empty"].any()
    # beside the breast nearly all comes from the plates
    part = between.primary[beside].mean() / bare.primary[beside].mean()
    assert scatter["between"][beside].mean() > 3.0 * part * scatter["bare"][beside].mean()


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
