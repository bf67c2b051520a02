"""How sure a shift is: the ellipsoid, what is drawn, and whether truths fall where they should."""

from __future__ import annotations

import dataclasses
import re

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from make_phantom import half_ellipsoid_breast
from make_run import invoke, read_table, save_breast, write

from mammosim.cli.progress import progress
from mammosim.compression import (
    MODELS,
    CompressionSettings,
    Sample,
    Sampler,
    compress,
    in_posture,
)
from mammosim.compression.samples import (
    FASCIA_SPREAD,
    LATTICE_SHIFTS,
    STIFFENING_SPREAD,
    stiffness_group,
)
from mammosim.errors import InputError, Interrupted
from mammosim.geometry import View
from mammosim.phantom import Landmark
from mammosim.pipeline import Plan, load_config
from mammosim.targets import (
    UncertaintySettings,
    draw_samples,
    sampled_shifts,
    target_origins,
    uncertainties,
)
from mammosim.targets.ellipsoid import prediction_ellipsoid

KEYS = {
    "springs": {"model": "springs", "thickness_mm": 36.0, "resolution_mm": 4.0},
    "hyperelastic": {
        "model": "hyperelastic", "chest_wall": "sliding", "thickness_mm": 36.0,
        "resolution_mm": 4.0,
    },
}  # fmt: skip
"""How the breast is compressed, by the model."""

PLACES = {"middle": (14.0, 0.0, 2.0), "up": (10.0, 4.0, 14.0), "aside": (8.0, 16.0, -6.0)}


def breast():
    """A half ellipsoid with three points to follow."""
    marks = tuple(Landmark(name, np.array(place)) for name, place in PLACES.items())
    return dataclasses.replace(half_ellipsoid_breast(voxel_mm=2.0), landmarks=marks)


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """These lattices are too small to be worth waking a thread for, hundreds of times."""
    usual = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(usual)


def make_sampler(model):
    compressed = compress(breast(), view="CC", **KEYS[model])
    return Sampler(compressed, CompressionSettings(**KEYS[model])), compressed


@pytest.fixture(scope="module", params=list(KEYS))
def sampler(request):
    """What varies a compression, by each model, and that compression."""
    return make_sampler(request.param)


@pytest.fixture(scope="module")
def springs():
    return make_sampler("springs")


# The ellipsoid.


def test_the_ellipsoid_covers_one_more_sample_as_often_as_it_says():
    """Small samples of a slanted normal distribution: Fisher's quantile, not chi-squared's."""
    rng = np.random.default_rng(3)
    slant = np.array([[3.0, 0.0, 0.0], [1.0, 0.5, 0.0], [-2.0, 0.3, 0.1]])
    inside = 0
    for _ in range(4000):
        drawn = rng.normal(size=(13, 3)) @ slant.T + 5.0
        inside += prediction_ellipsoid(drawn[:12]).contains(drawn[12:])[0]
    # 3 standard deviations of 4000 draws: 1 %. With chi-squared's quantile it would be 84 %.
    assert inside / 4000 == pytest.approx(0.95, abs=0.0104)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_axes_are_those_of_the_covariance(seed):
    drawn = np.random.default_rng(seed).normal(size=(40, 3)) * [4.0, 2.0, 0.5]
    found = prediction_ellipsoid(drawn)
    np.testing.assert_allclose(found.mean_mm, drawn.mean(axis=0))
    assert (np.diff(found.semi_axes_mm) <= 0.0).all()
    np.testing.assert_allclose(found.directions @ found.directions.T, np.eye(3), atol=1e-12)
    scaled = found.directions.T @ np.diag(found.semi_axes_mm**2) @ found.directions
    np.testing.assert_allclose(
        scaled / scaled[0, 0], found.covariance_mm2 / found.covariance_mm2[0, 0]
    )
    tip = found.mean_mm + 0.999 * found.semi_axes_mm[:, None] * found.directions
    beyond = found.mean_mm + 1.001 * found.semi_axes_mm[:, None] * found.directions
    assert found.contains(tip).all()
    assert not found.contains(beyond).any()


def test_what_does_not_vary_has_an_ellipsoid_of_no_size():
    found = prediction_ellipsoid(np.ones((8, 3)))
    assert (found.semi_axes_mm == 0.0).all()
    assert found.contains([1.0, 1.0, 1.0])[0]
    assert not found.contains([1.0, 1.0, 1.1])[0]


# What is drawn.


def test_draws_are_seeded_within_their_ranges_and_one_breast_is_one_breast():
    wanted = UncertaintySettings(samples=400, stiffness_spread=0.3)
    groups = ("adipose", "gland", "skin")
    drawn = draw_samples(wanted, groups, "LCC", 5)
    assert drawn == draw_samples(wanted, groups, "LCC", 5)
    assert drawn != draw_samples(wanted, groups, "LCC", 6)
    other = draw_samples(wanted, groups, "LMLO", 5)
    assert [sample.stiffness for sample in drawn] == [sample.stiffness for sample in other]
    assert [sample.lattice for sample in drawn] == [sample.lattice for sample in other]
    assert drawn[0].thickness_mm != other[0].thickness_mm
    plates = np.array([(s.thickness_mm, s.height_mm, s.edge_mm) for s in drawn])
    assert np.abs(plates).max() <= 5.0
    assert np.abs(plates).max(axis=0).min() > 4.9
    logs = np.log([[sample.stiffness[group] for group in groups] for sample in drawn])
    # 1200 draws: 2 % of statistics.
    assert logs.std() == pytest.approx(0.3, rel=0.06)
    assert {sample.lattice % 4 for sample in drawn} == {0, 1, 2, 3}
    still = draw_samples(UncertaintySettings(lattice=False), groups, "LCC", 5)
    assert {sample.lattice for sample in still} == {0}


def test_fibres_are_drawn_where_a_model_knows_them(sampler):
    varied, compressed = sampler
    assert varied.has_fibres == (compressed.model == "hyperelastic")

    def ratios(nominal, **keys):
        samples = draw_samples(
            UncertaintySettings(samples=300, **keys), ("skin",), "CC", 3, nominal
        )
        return np.array([sample.fibre_ratio for sample in samples], float)

    drawn = ratios(1.0)
    assert drawn.min() > 1.0
    assert drawn.max() < 3.0
    assert drawn.mean() == pytest.approx(2.0, abs=0.1)  # three standard deviations of 300
    assert ratios(4.0).mean() == pytest.approx(4.0, abs=0.31)
    assert np.isnan(ratios(None)).all()
    assert np.isnan(ratios(1.0, fibre_ratio=1.0)).all()
    if varied.has_fibres:  # they hold the breast back towards the front
        points = np.array([mark.position_mm for mark in compressed.phantom.landmarks])
        nominal = varied.field(Sample({})).displacement_at(points)
        fibrous = varied.field(Sample({}, fibre_ratio=3.0)).displacement_at(points)
        assert (fibrous[:, 0] < nominal[:, 0]).all()


def test_a_posture_varies_with_the_tissue():
    keys = CompressionSettings(model="hyperelastic", resolution_mm=6.0)
    held = in_posture(breast(), View("CC", "L"), keys, "prone")
    varied = Sampler(held, keys)
    points = held.phantom.landmarks[0].position_mm[None]
    np.testing.assert_array_equal(
        varied.field(Sample({})).displacement_mm, held.field.displacement_mm
    )
    factors = dict.fromkeys(varied.groups, 2.0) | {"fascia": 2.0 ** (1.0 / FASCIA_SPREAD)}
    del factors["skin_stiffening"]
    stiff = varied.field(Sample(factors))
    moved, less = held.displacement_at(points)[0, 0], stiff.displacement_at(points)[0, 0]
    assert less == pytest.approx(0.5 * moved, rel=0.02)  # small strain


def test_the_sample_that_deviates_by_nothing_is_the_compression_itself(sampler):
    varied, compressed = sampler
    field = varied.field(Sample({}))
    if compressed.model == "hyperelastic":  # from rest, as the compression itself: bit for bit
        np.testing.assert_array_equal(field.displacement_mm, compressed.field.displacement_mm)
    points = compressed.phantom.frame.position_mm(np.argwhere(compressed.phantom.labels > 0))
    # Both are within 0.01 lattice units of 4 mm of the same equilibrium.
    np.testing.assert_allclose(
        field.displacement_at(points), compressed.displacement_at(points), atol=0.08
    )


def test_a_sample_is_what_its_settings_would_give_alone(sampler):
    varied, compressed = sampler
    sample = Sample({"gland": 2.0}, thickness_mm=-4.0, height_mm=1.0, edge_mm=-1.0)
    field = varied.field(sample)
    moduli = CompressionSettings(model=compressed.model).moduli
    keys = {key: value for key, value in KEYS[compressed.model].items() if key != "thickness_mm"}
    again = compress(
        compressed.phantom, view="CC", support_z_mm=compressed.support_z_mm + 3.0,
        paddle_z_mm=compressed.paddle_z_mm - 1.0, plate_edge_mm=compressed.plate_edge_mm - 1.0,
        stiffness_kpa={"gland": 2.0 * moduli("gland")}, **keys,
    )  # fmt: skip
    if compressed.model == "hyperelastic":
        np.testing.assert_array_equal(field.displacement_mm, again.field.displacement_mm)
    points = np.array([mark.position_mm for mark in compressed.phantom.landmarks])
    np.testing.assert_allclose(
        field.displacement_at(points), again.displacement_at(points), atol=0.08
    )


def test_all_moduli_together_change_nothing_one_alone_does(sampler):
    varied, compressed = sampler
    points = np.array([mark.position_mm for mark in compressed.phantom.landmarks])
    nominal = varied.field(Sample({})).displacement_at(points)
    tissues = ("adipose", "gland", "skin")
    together = varied.field(Sample(dict.fromkeys(tissues, 4.0)))
    np.testing.assert_allclose(together.displacement_at(points), nominal, atol=0.08)
    stiff = varied.field(Sample({"gland": 6.0})).displacement_at(points)
    assert np.abs(stiff - nominal).max() > 0.1
    stiffens = ("skin_stiffening",) if compressed.model == "hyperelastic" else ()
    assert varied.groups == tissues + stiffens
    assert stiffness_group("tdlu") == "gland"


def test_skin_that_stiffens_is_varied_where_it_does():
    varied, compressed = make_sampler("hyperelastic")
    points = np.array([mark.position_mm for mark in compressed.phantom.landmarks])
    keys = KEYS["hyperelastic"] | {
        "support_z_mm": compressed.support_z_mm, "paddle_z_mm": compressed.paddle_z_mm,
        "skin": {"stiffening": 96.0},
    }  # fmt: skip
    del keys["thickness_mm"]
    again = compress(compressed.phantom, view="CC", **keys)
    sample = Sample({"skin_stiffening": 16.0 ** (1.0 / STIFFENING_SPREAD)})  # 6 by default
    field = varied.field(sample)
    np.testing.assert_array_equal(field.displacement_mm, again.field.displacement_mm)
    found = field.displacement_at(points)
    assert np.abs(found - compressed.field.displacement_at(points)).max() > 0.01
    linear = CompressionSettings(**KEYS["hyperelastic"], skin={"stiffening": 0.0})
    assert "skin_stiffening" not in Sampler(compressed, linear).groups


LARGE = {
    "springs": {"model": "springs", "resolution_mm": 2.0},
    "hyperelastic": {"model": "hyperelastic", "chest_wall": "sliding", "resolution_mm": 5.0},
}
"""Lattices large enough for threads to be woken: 80 000 nodes, and 4 000 with blocks of 126."""


@pytest.mark.parametrize("keys", LARGE.values(), ids=list(LARGE))
def test_a_sample_is_the_same_on_any_number_of_threads(keys):
    body = half_ellipsoid_breast(voxel_mm=2.0, semi_axes_mm=(70.0, 70.0, 60.0))
    compressed = compress(body, view="CC", thickness_mm=80.0, **keys)
    varied = Sampler(compressed, CompressionSettings(**keys))
    sample = Sample({"gland": 1.5, "skin": 0.7}, thickness_mm=3.0, lattice=3)
    fields = []
    for threads in (1, numba.config.NUMBA_NUM_THREADS):
        numba.set_num_threads(threads)
        fields.append(varied.field(sample).displacement_mm)
    numba.set_num_threads(1)
    np.testing.assert_array_equal(*fields)


def test_a_sample_is_never_squeezed_flat(sampler):
    varied, compressed = sampler
    field = varied.field(Sample({}, thickness_mm=-100.0))
    points = compressed.phantom.frame.position_mm(np.argwhere(compressed.phantom.labels > 0))
    z = points[:, 2] + field.displacement_at(points)[:, 2]
    assert np.ptp(z[points[:, 0] > 12.0]) > 0.45 * compressed.thickness_mm


# Calibration. It tests the sampling, not the physics: truths come from the same model.


def test_truths_of_the_same_ranges_fall_into_the_ellipsoid_95_times_of_100(springs):
    varied, compressed = springs
    wanted = UncertaintySettings(samples=160)
    origins = target_origins(compressed.phantom)
    samples = draw_samples(wanted, varied.groups, "LCC", 11)
    shifts = sampled_shifts(varied, origins, samples)
    inside = [
        prediction_ellipsoid(shifts[:60, target]).contains(shifts[60:, target])
        for target in range(len(origins))
    ]
    # 100 truths, four targets that move together: three standard deviations are 6.5 %; even draws
    # fall inside a little more often than normal ones. An ellipsoid of half the volume, 0.79 of
    # the axes, would hold 84 %.
    assert 0.885 <= np.mean(inside) < 1.0


def test_rows_hold_the_samples_statistics(springs):
    varied, compressed = springs
    origins = target_origins(compressed.phantom)
    samples = draw_samples(UncertaintySettings(samples=12), varied.groups, "LCC", 2)
    numbers = {}
    shifts = sampled_shifts(varied, origins, samples, lambda n, row: numbers.update({n: row}))
    assert list(numbers) == list(range(12))
    assert numbers[5]["error_estimate_voxel"] <= 0.01
    shifts[3] = np.nan  # one that did not converge
    rows = uncertainties(origins, {"CC": shifts}, {"CC": np.zeros_like(shifts)})
    assert [row.name for row in rows] == ["middle", "up", "aside", "nipple"]
    up, known = rows[1], np.delete(shifts, 3, axis=0)
    assert up.samples == 11
    assert up.shift_z_mm == pytest.approx(known[:, 1, 2].mean())
    assert up.cov_xz_mm2 == pytest.approx(np.cov(known[:, 1, 0], known[:, 1, 2])[0, 1])
    assert up.long_mm >= up.middle_mm >= up.short_mm > 0.0
    misses = np.linalg.norm(known[:, 1] - known[:, -1], axis=1)
    assert up.miss_mean_mm == pytest.approx(misses.mean())
    assert up.miss_95_mm == pytest.approx(np.quantile(misses, 0.95))
    assert np.isnan(rows[-1].miss_mean_mm)
    assert np.isnan(uncertainties(origins, {"CC": shifts})[0].miss_mean_mm)
    assert uncertainties(origins, {"CC": shifts[:4]}) == []
    few = np.full_like(shifts, np.nan)
    few[:3] = 0.0
    assert np.isnan(uncertainties(origins, {"CC": shifts}, {"CC": few})[0].miss_mean_mm)


def test_progress_says_which_sample_is_computed(springs, capsys, monkeypatch):
    monkeypatch.setattr("mammosim.cli.progress.SECONDS_PER_LINE", -1.0)
    compressed = springs[1]
    with progress(Plan((), 1.0, ()), verbose=True) as on_progress:
        on_progress("LCC", "uncertainty", None)
        on_progress("LCC", "uncertainty, sample 7 of 50", compressed.history[-1])
    said = capsys.readouterr().err
    assert "LCC: compressing again for the uncertainty (" in said
    assert "LCC: uncertainty, sample 7 of 50 (" in said


def test_where_nothing_varies_there_is_no_spread(sampler):
    """The same compression every time: a covariance of exactly nothing."""
    varied, compressed = sampler
    still = UncertaintySettings(stiffness_spread=0, thickness_mm=0, plate_height_mm=0,
                                plate_edge_mm=0, lattice=False)  # fmt: skip
    origins = target_origins(compressed.phantom)
    samples = draw_samples(still, varied.groups, "LCC", 4)[:5]
    rows = uncertainties(origins, {"CC": sampled_shifts(varied, origins, samples)})
    assert len(rows) == len(origins)
    for row in rows:
        spread = dataclasses.asdict(row)
        assert {value for key, value in spread.items() if key.startswith("cov_")} == {0.0}
        assert (row.long_mm, row.middle_mm, row.short_mm) == (0.0, 0.0, 0.0)


def test_samples_do_not_depend_on_those_before(sampler):
    varied, compressed = sampler
    origins = target_origins(compressed.phantom)
    samples = draw_samples(UncertaintySettings(), varied.groups, "LCC", 7)[:3]
    shifts = sampled_shifts(varied, origins, samples)
    assert np.isfinite(shifts).all()
    np.testing.assert_array_equal(sampled_shifts(varied, origins, samples[::-1])[::-1], shifts)
    assert len(np.unique(shifts[:, 0, 2])) == 3


def test_lattices_off_their_place_hold_the_same_breast(sampler):
    """Their surface is another staircase of 4 mm, the breast between the plates is not."""
    varied, compressed = sampler
    points = np.array([mark.position_mm for mark in compressed.phantom.landmarks])
    nominal = compressed.displacement_at(points)
    for number, shift in enumerate(LATTICE_SHIFTS):
        found = varied.compressed(Sample({}, lattice=number))
        away = found.field.frame.origin_mm - compressed.field.frame.origin_mm
        assert away[1:] / 4.0 % 1.0 == pytest.approx(shift)
        assert found.converged
        # Half an element's edge.
        np.testing.assert_allclose(found.displacement_at(points), nominal, atol=2.0)


def test_a_sample_that_is_interrupted_ends_all(springs, monkeypatch):
    varied, compressed = springs
    stopped = dataclasses.replace(compressed, interrupted=True)
    stopping = dataclasses.replace(MODELS["springs"], compress=lambda *given, **keys: stopped)
    monkeypatch.setitem(MODELS, "springs", stopping)
    with pytest.raises(Interrupted, match="LCC: a sample was interrupted"):
        varied.field(Sample({}))


def test_a_sample_says_how_it_deviates():
    sample = Sample({"adipose": 0.8, "gland": 1.25}, 4.04, -3.0, 0.5, lattice=6)
    assert str(sample) == (
        "gap +4.0, height -3.0, edge +0.5 mm, adipose x 0.80, gland x 1.25, lattice 2"
    )


def test_a_sample_without_equilibrium_is_not_counted(springs, monkeypatch):
    varied, compressed = springs
    monkeypatch.setattr(varied, "field", lambda sample, watch: None)
    shifts = sampled_shifts(varied, target_origins(compressed.phantom), [Sample({})])
    assert np.isnan(shifts).all()


# A run.


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return save_breast(tmp_path_factory.mktemp("user"))


def test_a_run_tells_how_sure_it_is(folder):
    targets = {"uncertainty": {"samples": 10}, "biopsy": {"view": "ML"}}
    path = write(folder, targets=targets)
    assert invoke("run", path, "--output", folder / "out").exit_code == 0
    rows = read_table(folder / "out" / "uncertainty.csv")
    assert [(row["name"], row["view"]) for row in rows] == [
        (name, view) for view in ("CC", "MLO") for name in ("ball", "mark", "nipple")
    ]
    lesions = {
        (row["name"], row["view"]): row for row in read_table(folder / "out" / "lesions.csv")
    }
    for row in rows:
        seen = lesions[row["name"], row["view"]]
        assert seen["ellipsoid_long_mm"] == row["long_mm"]
        # The run's own shift is one of those that could have been.
        away = [float(row[f"shift_{axis}_mm"]) - float(seen[f"shift_{axis}_mm"]) for axis in "xyz"]
        assert np.linalg.norm(away) < float(row["long_mm"])
    assert float(rows[0]["miss_95_mm"]) > 0.0
    again = invoke("run", path, "--output", folder / "again")
    assert again.exit_code == 0
    for name in ("uncertainty.csv", "lesions.csv"):
        assert (folder / "again" / name).read_bytes() == (folder / "out" / name).read_bytes()


def test_a_run_by_elements_tells_how_sure_it_is(folder):
    elements = {"model": "hyperelastic", "chest_wall": "sliding", "thickness_mm": 36}
    path = write(folder, "elements.yaml", views=["CC"], targets={"uncertainty": {"samples": 10}},
                 compression={**elements, "resolution_mm": 6})  # fmt: skip
    assert invoke("check", path).exit_code == 0
    assert invoke("run", path, "--output", folder / "elements").exit_code == 0
    rows = read_table(folder / "elements" / "uncertainty.csv")
    assert [(row["name"], row["samples"]) for row in rows] == [
        ("ball", "10"), ("mark", "10"), ("nipple", "10"),
    ]  # fmt: skip
    assert all(0.1 < float(row["short_mm"]) <= float(row["long_mm"]) < 30.0 for row in rows)


def test_the_plan_tells_of_samples_and_needles_before(folder):
    alone = invoke("check", write(folder, "plain.yaml"))
    targets = {"uncertainty": {"samples": 2000}, "biopsy": {"view": "ML"}}
    planned = invoke("check", write(folder, "planned.yaml", targets=targets))
    assert "uncertainty: 2000 samples of each compression" in planned.output
    assert "biopsy: a vertical needle, the breast held in ML" in planned.output
    minutes = [
        float(result.output.split("memory and ")[1].split(" minutes")[0])
        for result in (alone, planned)
    ]
    assert minutes[1] > minutes[0]


def test_samples_that_fail_are_told(folder, monkeypatch):
    monkeypatch.setattr(Sampler, "field", lambda self, sample, watch: None)
    path = write(folder, "fail.yaml", views=["CC"], targets={"uncertainty": {"samples": 10}})
    assert invoke("run", path, "--output", folder / "fail").exit_code == 0
    said = (folder / "fail" / "run.json").read_text()
    assert "LCC: 10 of 10 samples did not converge and were omitted: 1 (gap " in said
    assert re.search(r"lattice \d\); and 5 more", said)
    assert not (folder / "fail" / "uncertainty.csv").exists()


BAD = [
    ({"samples": 0}, {}, "targets.uncertainty.samples: found 0, expected greater than or equal to"),
    ({"thickness_mm": -1}, {}, "targets.uncertainty.thickness_mm: found -1"),
    ({}, {"model": "none"}, "CC has compression.model none; only springs and hyperelastic"),
]


@pytest.mark.parametrize(("uncertainty", "compression", "message"), BAD)
def test_bad_settings_are_refused(uncertainty, compression, message, folder):
    with pytest.raises(InputError, match=message):
        load_config(
            write(folder, "bad.yaml", compression=compression,
                  targets={"uncertainty": uncertainty, "biopsy": {"view": "ML"}})
        )  # fmt: skip
