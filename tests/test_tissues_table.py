"""The tissue table and label maps."""

from __future__ import annotations

import pytest

from mammosim.errors import InputError
from mammosim.tissues import (
    LABEL_MAPS,
    LESION_LABELS,
    STIFFNESS_SETS,
    TISSUES,
    Moduli,
    density_g_cm3,
    load_label_map,
    stiffening,
    stiffness_kpa,
)


def test_labels_are_unique_and_lesion_labels_free():
    labels = [tissue.label for tissue in TISSUES.values()]
    assert len(set(labels)) == len(labels)
    assert not set(LESION_LABELS) & set(labels)


@pytest.mark.parametrize("name", STIFFNESS_SETS)
@pytest.mark.parametrize("tissue", [name for name in TISSUES if name != "air"])
def test_every_tissue_has_a_stiffness_in_every_set(tissue, name):
    assert 1.0 < stiffness_kpa(tissue, name) < 150.0  # the stiffest, carcinoma: 106


@pytest.mark.parametrize(
    ("tissue", "thesis", "victre", "krouskop"),
    [("adipose", 4.5, 5.0, 18.0), ("gland", 15.0, 15.0, 28.0), ("skin", 16.0, 5.0, 16.0),
     ("mass", 45.0, 20.0, 106.0), ("duct", 15.0, 15.0, 28.0), ("calcification", 45.0, 20.0, 106.0)],
)  # fmt: skip
def test_stiffness_of_the_sets(tissue, thesis, victre, krouskop):
    assert stiffness_kpa(tissue, "krouskop") == krouskop
    assert stiffness_kpa(tissue, "thesis") == thesis
    assert stiffness_kpa(tissue, "victre") == victre


@pytest.mark.parametrize(
    ("tissue", "enl"),
    [("adipose", 7.5), ("gland", 10.0), ("mass", 20.0), ("skin", 20.0), ("vein", 10.0)],
)
def test_stiffening_of_the_thesis_listing(tissue, enl):
    assert stiffening(tissue) == enl


@pytest.mark.parametrize("tissue", [name for name in TISSUES if name != "air"])
def test_every_tissue_stiffens_and_has_a_density(tissue):
    assert 5.0 < stiffening(tissue) < 25.0
    assert (0.2 if tissue == "lung" else 0.9) < density_g_cm3(tissue) < 5.0  # a lung holds air


def test_unknown_set():
    with pytest.raises(InputError, match=r"compression\.stiffness: found 'x', expected one of"):
        stiffness_kpa("gland", "x")


def test_label_maps_name_tissues_of_the_table():
    for mapping in LABEL_MAPS.values():
        assert set(mapping.values()) <= set(TISSUES)


def test_a_label_map_from_a_file(tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text("0: air\n7: gland\n")
    assert dict(load_label_map(str(path))) == {0: "air", 7: "gland"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0: air\n7: liver\n", r"label 7: found 'liver', expected one of air"),
        ("zero: air\n", r"label 'zero': expected a number of at most 3 decimals"),
        ("1.23456: air\n", r"label 1.23456: expected a number of at most 3"),
        ("true: air\n", r"label True: expected a number"),
        ("- 1\n", "expected lines of 'label: tissue'"),
    ],
)
def test_bad_label_maps(text, message, tmp_path):
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_label_map(str(path))


def test_unknown_label_map():
    with pytest.raises(InputError, match=r"phantom\.labels: found 'vitcre', expected one of"):
        load_label_map("vitcre")


def test_given_moduli_stand_for_the_sets_and_reach_what_is_like_them():
    moduli = Moduli("victre", {"mass": 100.0, "gland": 9.0})
    assert moduli("mass") == 100.0
    assert moduli("calcification") == 100.0  # victre does not name it: it is like mass
    assert moduli("duct") == 15.0  # victre names it
    assert moduli("muscle") == 9.0
    assert Moduli("thesis")("skin") == stiffness_kpa("skin", "thesis")
