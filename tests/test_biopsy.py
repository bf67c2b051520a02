"""From mammogram to needle: exact answers for breasts compressed by formula, and a run's table."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from make_run import invoke, read_table, save_breast, write
from naive.projection import phantom

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import Landmark, Lesion
from mammosim.pipeline import load_config
from mammosim.targets import Target, aim_needles

LESION = 160
NIPPLE = np.array([30.0, 0.0, 0.0])


def breast():
    """A half ball of fat with a cube of lesion and a landmark."""
    at = np.stack(np.indices((31, 61, 61)), axis=-1) - [0.0, 30.0, 30.0]
    labels = (np.linalg.norm(at, axis=-1) <= 30.0).astype(np.uint8)
    inside = np.abs(at - [12.0, 6.0, 4.0]).max(axis=-1) <= 1.0
    labels[inside] = LESION
    lesion = Lesion("m", "mass", LESION, "mass", at[inside].mean(axis=0), 27.0)
    mark = Landmark("edge", np.array([2.0, 25.0, 0.0]))
    return phantom(
        labels, 1.0, [0.0, -30.0, -30.0], lesions=(lesion,), landmarks=(mark,), nipple_mm=NIPPLE
    )


def held(body, view_name, scale, model="springs"):
    """The breast stretched by three factors along the axes of the compression frame."""
    view = View(view_name, "L")
    stretch = view.rotation.T @ np.diag(scale) @ view.rotation

    def displacement_at(points_mm):
        points = np.atleast_2d(points_mm)
        return points @ stretch.T - points

    def original_point(points_mm):
        return np.atleast_2d(points_mm) @ np.linalg.inv(stretch).T

    field = SimpleNamespace(displacement_at=displacement_at, original_point=original_point)
    return CompressedBreast(
        body, view, model, field, -20.0, 20.0, 0.0, True, {"force_n": 90.0},
        np.zeros(0, [("iteration", int)]),
    )  # fmt: skip


def targets_of(compressed, in_field=True):
    """Rows with what `aim_needles` takes of them."""
    body = compressed.phantom
    places = [
        ("m", "mass", body.lesions[0].position_mm),
        ("edge", "landmark", body.landmarks[0].position_mm),
        ("nipple", "nipple", NIPPLE),
    ]
    rows = []
    for number, (name, kind, place) in enumerate(places, start=1):
        shift = compressed.displacement_at(place)[0]
        rows.append(
            Target(number, name, kind, compressed.view.name, 1.0, *place, "12:00", 1.0, 1.0,
                   0.0, 0.0, 0.0, *shift, float(np.linalg.norm(shift)), 1.0, 1.0, 1.0, 0.0, 0.0,
                   0.0, in_field)
        )  # fmt: skip
    return rows


def aimed(mammogram, biopsy, **keys):
    return aim_needles(mammogram, targets_of(mammogram), biopsy, **keys)


def vector(row, stem):
    return np.array([getattr(row, f"{stem}_{axis}_mm") for axis in "xyz"])


def test_the_same_compression_again_is_hit():
    body = breast()
    mammogram = held(body, "MLO", (1.2, 1.1, 0.6))
    for row in aimed(mammogram, held(body, "MLO", (1.2, 1.1, 0.6))):
        assert row.miss_mm == pytest.approx(0.0, abs=1e-12)
        assert row.needle_miss_mm == pytest.approx(0.0, abs=1e-12)
    assert row.biopsy_thickness_mm == 40.0


def test_a_released_breast_is_missed_by_what_compression_did_between_nipple_and_lesion():
    body = breast()
    mammogram = held(body, "CC", (1.2, 1.1, 0.6))
    lesion = np.array([12.0, 6.0, 4.0])
    row = aimed(mammogram, held(body, "CC", (1.0, 1.0, 1.0), model="none"))[0]
    # Seen at (1.2, 1.1, 0.6) times the vector from the nipple; it is at the vector itself.
    miss = (lesion - NIPPLE) * (1.0 - np.array([1.2, 1.1, 0.6]))
    np.testing.assert_allclose(vector(row, "miss"), miss, atol=1e-12)
    np.testing.assert_allclose(vector(row, "biopsy"), lesion, atol=1e-12)
    np.testing.assert_allclose(vector(row, "aim"), lesion - miss, atol=1e-12)
    assert row.miss_mm == pytest.approx(np.linalg.norm(miss))
    # From above, along -z: what is left is in the plane; the lesion is higher than aimed at.
    assert row.needle_miss_mm == pytest.approx(np.hypot(*miss[:2]))
    assert row.depth_error_mm == pytest.approx(-miss[2])
    assert row.biopsy_view == "none"
    assert np.isnan(row.biopsy_thickness_mm)
    # Nothing is released, and the clip stays where the needle left it.
    assert row.clip_shift_mm == pytest.approx(0.0, abs=1e-12)
    assert row.clip_from_lesion_mm == pytest.approx(row.miss_mm)


def test_a_lateral_needle_goes_along_the_chest_wall():
    body = breast()
    mammogram = held(body, "CC", (1.2, 1.1, 0.6))
    row = aimed(mammogram, held(body, "CC", (1.0, 1.0, 1.0), model="none"), needle="lateral")[0]
    miss = vector(row, "miss")
    assert row.depth_error_mm == pytest.approx(miss[1])
    assert row.needle_miss_mm == pytest.approx(np.hypot(miss[0], miss[2]))


def test_a_clip_goes_the_way_back_when_the_plates_open():
    body = breast()
    mammogram, biopsy = held(body, "CC", (1.2, 1.1, 0.6)), held(body, "ML", (1.15, 1.05, 0.7))
    row = aimed(mammogram, biopsy)[0]
    lesion = biopsy.view.rotation @ np.array([12.0, 6.0, 4.0])
    back = lesion - lesion * [1.15, 1.05, 0.7]
    assert row.clip_along_mm == pytest.approx(back[2])
    assert row.clip_across_mm == pytest.approx(np.hypot(back[0], back[1]))
    assert row.clip_shift_mm == pytest.approx(np.linalg.norm(back))
    # The clip at the point aimed at goes back with the tissue that was there.
    left = biopsy.original_point(vector(row, "aim"))[0]
    assert row.aim_in_breast
    assert row.clip_from_lesion_mm == pytest.approx(np.linalg.norm(left - [12.0, 6.0, 4.0]))


def test_a_needle_that_ends_in_air_leaves_no_clip():
    body = breast()
    # A compression that spreads the breast to half as wide again puts the edge far out.
    row = aimed(held(body, "CC", (1.0, 1.6, 1.0)), held(body, "CC", (1, 1, 1), model="none"))[1]
    assert row.name == "edge"
    assert not row.aim_in_breast
    assert np.isnan(row.clip_from_lesion_mm)
    assert row.miss_mm == pytest.approx(0.6 * 25.0)


def test_what_is_not_in_the_picture_is_not_aimed_at():
    body = breast()
    mammogram = held(body, "CC", (1.2, 1.1, 0.6))
    rows = aim_needles(
        mammogram, targets_of(mammogram, in_field=False), held(body, "CC", (1.1, 1, 0.8))
    )
    assert np.isnan(rows[0].miss_mm)
    assert np.isnan(rows[0].needle_miss_mm)
    assert np.isfinite(rows[0].biopsy_x_mm)
    assert rows[0].clip_shift_mm > 0.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return save_breast(tmp_path_factory.mktemp("user"))


def test_a_run_writes_the_needles_table(folder):
    biopsy = {"view": "same", "thickness_mm": 44}
    path = write(folder, targets={"biopsy": biopsy})
    result = invoke("run", path, "--output", folder / "out")
    assert result.exit_code == 0, result.output
    rows = read_table(folder / "out" / "biopsy.csv")
    assert [(row["name"], row["view"], row["biopsy_view"]) for row in rows] == [
        ("ball", "CC", "CC"), ("mark", "CC", "CC"), ("ball", "MLO", "MLO"), ("mark", "MLO", "MLO"),
    ]  # fmt: skip
    seen = {(row["name"], row["view"]): row for row in read_table(folder / "out" / "lesions.csv")}
    for row in rows:
        assert float(row["biopsy_thickness_mm"]) == 44.0
        before = seen[row["name"], row["view"]]
        shift = [float(row[f"biopsy_{axis}_mm"]) - float(before[f"{axis}_mm"]) for axis in "xyz"]
        # Four decimals are written.
        assert float(row["clip_shift_mm"]) == pytest.approx(np.linalg.norm(shift), abs=5e-4)
        # 8 mm less compression: less shift along its axis, and a miss that is not nothing.
        assert abs(float(row["clip_along_mm"])) < abs(float(before["shift_along_mm"]))
        assert float(row["miss_mm"]) > 0.1
    again = invoke("run", path, "--output", folder / "again")
    assert again.exit_code == 0
    assert (folder / "again" / "biopsy.csv").read_bytes() == (
        folder / "out" / "biopsy.csv"
    ).read_bytes()


def test_another_views_compression_is_not_computed_twice(folder, monkeypatch):
    from mammosim.pipeline.run import shift_analysis

    def refuse(*arguments, **keys):
        raise AssertionError("computed again")

    monkeypatch.setattr(shift_analysis, "compress", refuse)
    path = write(folder, "mlo.yaml", targets={"biopsy": {"view": "MLO"}})
    assert invoke("run", path, "--output", folder / "mlo").exit_code == 0
    rows = {(row["name"], row["view"]): row for row in read_table(folder / "mlo" / "biopsy.csv")}
    # An MLO lesion sought under the same MLO compression is hit, a CC one is not.
    assert float(rows["ball", "MLO"]["miss_mm"]) == pytest.approx(0.0, abs=1e-4)
    assert float(rows["ball", "CC"]["miss_mm"]) > 0.1


def test_a_biopsy_that_does_not_converge_is_said(folder, tmp_path):
    compression = {
        "model": "springs",
        "thickness_mm": 36,
        "resolution_mm": 3,
        "solver": "relaxation",
        "max_sweeps": 3,
    }
    path = write(
        folder, "short.yaml", views=["CC"], targets={"biopsy": {"view": "ML"}},
        compression=compression,
    )  # fmt: skip
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 3
    assert "biopsy for LCC: LML: relaxation stopped" in (tmp_path / "out" / "run.json").read_text()


def test_a_posture_says_where_lesions_lie_without_plates(folder, tmp_path):
    path = write(folder, "prone.yaml", views=["CC"], targets={"biopsy": {"posture": "prone"}})
    result = invoke("run", path, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    ball, _ = read_table(tmp_path / "out" / "biopsy.csv")
    assert (ball["biopsy_view"], ball["biopsy_thickness_mm"]) == ("prone", "")
    before = read_table(tmp_path / "out" / "lesions.csv")[0]
    assert float(ball["biopsy_x_mm"]) > float(before["x_mm"])  # it hangs forward
    assert "posture is experimental" in (tmp_path / "out" / "run.json").read_text()


BAD = [
    ({"view": "same"}, "view: same needs thickness_mm or force_n"),
    ({"view": "none", "thickness_mm": 40}, "no plates, so thickness_mm must not be given"),
    ({"view": "CC", "thickness_mm": 40, "force_n": 90}, "give one of thickness_mm and force_n"),
    ({"view": "CC", "posture": "prone"}, "posture: prone needs view: none"),
    ({"posture": "sitting"}, "targets.biopsy.posture: found 'sitting'"),
    ({"view": "LM"}, "targets.biopsy.view: found 'LM'"),
    ({"needle": "up"}, "targets.biopsy.needle: found 'up'"),
]


@pytest.mark.parametrize(("biopsy", "message"), BAD)
def test_bad_settings_are_refused(biopsy, message, folder):
    with pytest.raises(InputError, match=message):
        load_config(write(folder, "bad.yaml", targets={"biopsy": biopsy}))
