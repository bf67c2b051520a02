"""The shape without weight: there and back again, and what cannot have one."""

from dataclasses import replace

import numpy as np
import pytest
from make_run import invoke, read_table, save_breast, write
from test_hyperelastic_breast import skinned, tissue

import mammosim
from mammosim.compression import CompressionSettings, Sample, Sampler, in_posture, unloading
from mammosim.errors import InputError, Interrupted, NotConverged
from mammosim.geometry import View
from mammosim.phantom import CompressedState
from mammosim.pipeline import load_config

SETTINGS = CompressionSettings(model="hyperelastic", resolution_mm=6.0)
LCC, LMLO = View("CC", "L"), View("MLO", "L", 45.0)
PLATES = {
    "model": "hyperelastic", "resolution_mm": 6.0, "plate_edge_mm": 10.0, "thickness_mm": 45.0,
}  # fmt: skip


def shaped(posture):
    return replace(skinned(), shaped_under=posture)


@pytest.mark.parametrize(("posture", "view"), [("standing", LCC), ("prone", LMLO), ("supine", LCC)])
def test_weight_brings_the_unloaded_breast_back_to_its_shape(posture, view):
    breast = shaped(posture)
    back = in_posture(breast, view, SETTINGS, posture).displacement_at(tissue(breast))
    assert np.linalg.norm(back, axis=1).mean() < 0.05
    rest = unloading.unload(breast, view, SETTINGS, posture)
    assert np.linalg.norm(rest.field.displacement_at(tissue(breast)), axis=1).mean() > 0.4


def test_the_unloaded_breast_lies_against_the_pull_and_keeps_its_tissue():
    breast = shaped("prone")
    rest = unloading.unload(breast, LCC, SETTINGS, "prone")
    assert rest.field.displacement_at(tissue(breast))[:, 0].mean() < -0.2
    assert rest.breast.nipple_mm[0] < breast.nipple_mm[0] - 0.5
    for label in (1, 2, 29):
        before, after = (
            np.count_nonzero(one.labels == label) * np.prod(one.voxel_mm)
            for one in (breast, rest.breast)
        )
        assert after == pytest.approx(before, rel=0.02)  # voxels of 1.5 mm, skin of two of them
    assert rest.breast.shaped_under is None
    skin = mammosim.compress(skinned(), "CC", **PLATES).measures["skin_mm"]
    assert rest.settings.skin_sheet.thickness_mm == pytest.approx(skin)


def test_supine_lies_further_back_from_prone_than_from_a_shape_without_weight():
    breast = shaped("prone")
    from_prone = in_posture(breast, LCC, SETTINGS, "supine").displacement_at(tissue(breast))
    from_free = in_posture(skinned(), LCC, SETTINGS, "supine").displacement_at(tissue(breast))
    assert from_prone[:, 0].mean() == pytest.approx(2.0 * from_free[:, 0].mean(), rel=0.2)


def test_compression_begins_at_the_shape_without_weight():
    """The field leads from the voxels' shape to that of the unloaded breast between the plates."""
    breast = shaped("standing")
    found = mammosim.compress(breast, "CC", **PLATES)
    rest = unloading.unload(breast, LCC, SETTINGS, "standing")
    alone = mammosim.compress(rest.breast, "CC", **{**PLATES, "skin": rest.settings.skin})
    points = tissue(breast)
    there = points + rest.field.displacement_at(points)
    there += alone.displacement_at(there)
    # Both fields are trilinear on lattices that are shifted against each other.
    np.testing.assert_allclose(
        np.linalg.norm(points + found.displacement_at(points) - there, axis=1).mean(), 0.0, atol=0.1
    )
    assert found.phantom is breast
    assert found.force_n == alone.force_n
    assert any("shaped_under is experimental" in note for note in found.notes)
    varied = Sampler(found, CompressionSettings(**PLATES)).field(Sample({}))
    np.testing.assert_allclose(varied.displacement_at(points), found.displacement_at(points))


def test_a_shape_that_is_not_found_is_said(monkeypatch):
    monkeypatch.setattr(unloading, "MAX_PASSES", 2)
    monkeypatch.setattr(unloading, "MEAN_MM", 0.0)
    message = (
        r"shaped_under: found no shape without weight .* prone, .* after 2 passes .* mm at most"
    )
    with pytest.raises(NotConverged, match=message) as caught:
        unloading.unload(shaped("prone"), LCC, SETTINGS, "prone")
    assert not caught.value.reached.converged
    varied = Sampler(
        replace(caught.value.reached, phantom=shaped("prone"), posture="supine"), SETTINGS
    )
    assert varied.field(Sample({})) is None


@pytest.mark.parametrize(
    ("interrupted", "error", "message"),
    [(True, Interrupted, "prone: the search for the unloaded shape was interrupted"),
     (False, NotConverged, r"under its weight \(prone\) stopped at an estimated error of")],
)  # fmt: skip
def test_a_solver_that_stops_ends_the_search(monkeypatch, interrupted, error, message):
    hang = unloading.hang

    def stopped(*given):
        found = hang(*given)
        return replace(found, state=replace(found.state, converged=False, interrupted=interrupted))

    monkeypatch.setattr(unloading, "hang", stopped)
    with pytest.raises(error, match=message):
        unloading.unload(shaped("prone"), LCC, SETTINGS, "prone")


def test_springs_and_plates_have_no_shape_without_weight():
    with pytest.raises(
        InputError, match=r"shaped_under: found prone, which .* hyperelastic; found springs"
    ):
        mammosim.compress(shaped("prone"), "CC", model="springs", resolution_mm=6.0)
    between = replace(shaped("prone"), compressed=CompressedState("CC"))
    with pytest.raises(InputError, match=r"shaped_under: found prone .* plates hold already"):
        mammosim.compress(between, "CC", **PLATES)
    left = mammosim.compress(shaped("prone"), "CC", model="none")
    assert not left.field.displacement_mm.any()


@pytest.mark.parametrize(
    ("phantom", "model", "message"),
    [({"shaped_under": "prone"}, "springs", "found prone, which needs compression.model: hyper"),
     ({"shaped_under": "sitting"}, "hyperelastic", "phantom.shaped_under: found 'sitting'"),
     ({"shaped_under": "supine", "compressed_for": "CC"}, "none",
      "shaped_under: found supine with compressed_for: CC")],
)  # fmt: skip
def test_a_configuration_that_cannot_be_is_refused(tmp_path, phantom, model, message):
    folder = save_breast(tmp_path)
    phantom = {"file": "breast.npz", **phantom}
    path = write(folder, "bad.yaml", phantom=phantom, compression={"model": model})
    with pytest.raises(InputError, match=message):
        load_config(path)


def test_a_run_says_where_a_lesion_lies_supine_and_how_sure_that_is(tmp_path):
    folder = save_breast(tmp_path)
    ball = {"name": "ball", "kind": "mass", "diameter_mm": 6, "position_mm": [12, 8, 6]}
    path = write(
        folder, "prone.yaml", views=["CC"],
        phantom={"file": "breast.npz", "shaped_under": "prone", "lesions": [ball]},
        compression={"model": "hyperelastic", "resolution_mm": 8, "thickness_mm": 36},
        targets={"biopsy": {"posture": "supine"}, "uncertainty": {"samples": 10}},
    )  # fmt: skip
    assert invoke("check", path).exit_code == 0
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    rows = {(r["name"], r["view"]): r for r in read_table(tmp_path / "out" / "uncertainty.csv")}
    place = rows["ball", "CC supine"]
    assert float(place["shift_x_mm"]) < -0.1
    assert 0.0 < float(place["short_mm"]) <= float(place["long_mm"]) < 10.0
    assert float(rows["ball", "CC"]["miss_sd_mm"]) > 0.0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Without plates, the woman supine (experimental)" in page
    assert "shape is taken as free of weight" not in (tmp_path / "out" / "run.json").read_text()
