"""Voxels that septa fill in part: modulus, projection, Monte Carlo's copy, whole voxels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import mammosim
from mammosim.export.whole_voxels import to_whole_voxels
from mammosim.phantom import phantom_summary
from mammosim.projection.coarse_copy import coarse_breast
from mammosim.tissues import TISSUES, Moduli, density_g_cm3, stiffening, stiffness_kpa

MIXTURES = {name: tissue for name, tissue in TISSUES.items() if tissue.mixture}


@pytest.fixture(scope="module")
def breast():
    return mammosim.generate_phantom("scattered", 2.0, 3, volume_ml=200.0)


@pytest.fixture(scope="module")
def compressed(breast):
    return mammosim.compress(breast, "CC", model="none")


def test_mixtures_are_wholes_of_tissues_with_materials():
    assert {81, 82, 84} <= {tissue.label for tissue in MIXTURES.values()}
    for tissue in MIXTURES.values():
        assert sum(tissue.mixture.values()) == pytest.approx(1.0, abs=1e-12)
        assert all(TISSUES[name].material for name in tissue.mixture)


@pytest.mark.parametrize("name", MIXTURES)
def test_a_mixture_has_the_mean_of_its_tissues(name):
    parts = MIXTURES[name].mixture
    for value in (density_g_cm3, stiffening, lambda tissue: stiffness_kpa(tissue, "thesis"),
                  Moduli("krouskop", {"ligament": 200.0})):  # fmt: skip
        expected = sum(part * value(tissue) for tissue, part in parts.items())
        assert value(name) == pytest.approx(expected)


def test_volumes_count_each_tissue_of_a_mixture(breast):
    volume = phantom_summary(breast).volume_ml
    counts = np.bincount(breast.labels.ravel(), minlength=256) * breast.voxel_mm.prod() / 1000.0
    expected = counts[88] + 0.5 * counts[84] + 0.25 * counts[82] + 0.125 * counts[81]
    assert volume["ligament"] == pytest.approx(expected)
    assert not set(volume) & set(MIXTURES)


def test_a_mixture_attenuates_as_its_tissues_do(compressed):
    """Against the same breast with fat in place of mixtures: what ligament gains, fat loses."""
    paths = mammosim.project(compressed, pixel_mm=1.0, smooth_voxels=False)
    assert not set(paths.tissues) & set(MIXTURES)
    whole = compressed.phantom.labels.copy()
    for tissue in MIXTURES.values():
        whole[whole == tissue.label] = TISSUES["adipose"].label
    phantom = dataclasses.replace(compressed.phantom, labels=whole)
    other = dataclasses.replace(compressed, phantom=phantom)
    plain = mammosim.project(other, pixel_mm=1.0, smooth_voxels=False)
    fat, wall = (paths.tissues.index(name) for name in ("adipose", "ligament"))
    gained = paths.length_mm[wall].copy()
    if "ligament" in plain.tissues:  # this breast may have no voxel that is all ligament
        gained -= plain.length_mm[plain.tissues.index("ligament")]
    lost = plain.length_mm[plain.tissues.index("adipose")] - paths.length_mm[fat]
    assert gained.max() > 0.5
    # Sums of some hundred single-precision lengths of up to 100 mm.
    np.testing.assert_allclose(gained, lost, atol=1e-3)
    np.testing.assert_allclose(paths.length_mm.sum(axis=0), plain.length_mm.sum(axis=0), atol=1e-3)


def test_the_copy_for_radiation_transport_keeps_the_septa(compressed):
    paths = mammosim.project(compressed, pixel_mm=1.0)
    copy = coarse_breast(compressed, paths.gantry, 4.0)
    ratio = copy.fraction("ligament").sum() / copy.fraction("adipose").sum()
    volume = phantom_summary(compressed.phantom).volume_ml
    # Of what is in the field and near it; the muscle's fat is behind it.
    assert ratio == pytest.approx(volume["ligament"] / volume["adipose"], rel=0.15)


def test_whole_voxels_keep_volumes(breast):
    whole = breast.labels.copy()
    to_whole_voxels(whole)
    assert not np.isin(whole, [tissue.label for tissue in MIXTURES.values()]).any()
    changed = np.isin(breast.labels, [tissue.label for tissue in MIXTURES.values()])
    np.testing.assert_array_equal(whole[~changed], breast.labels[~changed])
    before = phantom_summary(breast).volume_ml["ligament"]
    after = phantom_summary(dataclasses.replace(breast, labels=whole)).volume_ml["ligament"]
    # Of each mixture in each layer at most a voxel more or less.
    assert after == pytest.approx(before, abs=3 * len(whole) * 8.0e-3 * 0.5)
