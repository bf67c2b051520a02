"""The table of lesion kinds: every one is inserted, projected, shown and coded."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from naive.projection import phantom, unsqueezed

from mammosim.config import to_settings
from mammosim.errors import InputError
from mammosim.export.segmentation import lesion_codes
from mammosim.phantom import LESION_KINDS, LesionSettings, insert_lesions
from mammosim.phantom.found_lesions import number_lesions
from mammosim.phantom.lesion_kinds import OwnKeys, lesion_tissues
from mammosim.projection import project
from mammosim.tissues import TISSUES


def breast():
    """A block of gland in a shell of fat, 40 mm wide."""
    labels = np.full((40, 40, 40), TISSUES["adipose"].label, np.uint8)
    labels[8:32, 8:32, 8:32] = TISSUES["gland"].label
    return phantom(labels)


def inserted(kind: str, **keys):
    entry = LesionSettings(name="one", kind=kind, position_mm=(20.0, 20.0, 20.0), **keys)
    return insert_lesions(breast(), [entry], np.random.default_rng(3))


@pytest.mark.parametrize("kind", LESION_KINDS)
def test_a_lesion_of_every_kind_is_inserted_and_has_a_channel_of_its_own(kind):
    made = inserted(kind)
    (lesion,) = made.lesions
    voxels = np.argwhere(made.labels == lesion.label)
    assert lesion.kind == kind
    assert lesion.tissue == LESION_KINDS[kind].tissue
    assert 0.0 < lesion.volume_mm3 <= len(voxels)
    assert lesion.fill == pytest.approx(min(1.0, lesion.volume_mm3 / len(voxels)))
    reach = np.linalg.norm(voxels - 20.0, axis=1).max()
    # Half a voxel's diagonal more: its centre may lie that far from what touches it.
    form = LESION_KINDS[kind].form(LesionSettings(name="a", kind=kind))
    assert reach <= 0.5 * form.diameter_mm + 0.9
    paths = project(unsqueezed(made, spacing_mm=8.0), pixel_mm=1.0)
    channel = paths.lesion_labels.index(lesion.label)
    assert paths.materials[channel] == TISSUES[lesion.tissue].material
    assert paths.length_mm[channel].max() > 0.0


@pytest.mark.parametrize("kind", LESION_KINDS)
def test_every_kind_has_a_title_and_codes(kind):
    category, of_type = lesion_codes(kind)
    for code in (category, of_type):
        assert code.value
        assert code.scheme_designator == "SCT"
        assert code.meaning
    assert LESION_KINDS[kind].title
    assert LESION_KINDS[kind].tissue in TISSUES


@pytest.mark.parametrize("kind", LESION_KINDS)
def test_keys_of_a_kind_are_refused_by_the_others(kind):
    own = LESION_KINDS[kind].keys
    keys = dict(own.model_fields) if own else {}
    assert set(keys) <= set(OwnKeys.model_fields)
    given = {"margin": "smooth", "morphology": "linear", "count": 4, "calcification_mm": 0.2}
    for other in set(LESION_KINDS) - {kind}:
        for key in keys:
            values = {"name": "a", "kind": other, key: given[key]}
            with pytest.raises(InputError, match=f"{key} does not belong to kind '{other}'"):
                to_settings(LesionSettings, values, "x.yaml")


@pytest.mark.parametrize(("tissue", "kind"), lesion_tissues().items())
def test_pieces_of_a_tissue_that_only_lesions_have_are_found_in_a_file(tissue, kind):
    one = breast()
    labels = one.labels.copy()
    labels[10:12, 10:12, 10:12] = labels[16:18, 10:12, 10:12] = TISSUES[tissue].label
    found = number_lesions(labels, one.frame, "file")[0]
    assert {lesion.kind for lesion in found} == {kind}
    assert len(found) == (1 if LESION_KINDS[kind].clustered else 2)  # they are 4 mm apart


def test_an_entry_in_the_table_is_enough_for_a_new_kind(monkeypatch):
    """A kind of a tissue that is no lesion's own: it is inserted, but not sought in files."""
    seed = dataclasses.replace(LESION_KINDS["clip"], tissue="gland", title="Seed")
    monkeypatch.setitem(LESION_KINDS, "seed", seed)
    made = inserted("seed", diameter_mm=6.0)
    assert made.lesions[0].kind == "seed"
    assert made.tissue_of_label[made.lesions[0].label] == "gland"
    assert "gland" not in lesion_tissues()
    assert lesion_codes("seed") == lesion_codes("clip")


def test_an_unknown_kind_is_refused_by_name():
    with pytest.raises(InputError, match="kind: found 'cyst', expected one of mass, calcification"):
        to_settings(LesionSettings, {"name": "a", "kind": "cyst"}, "x.yaml")
