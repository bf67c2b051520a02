"""From pixels back to the uncompressed breast: round trips, and plain answers elsewhere."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from make_run import invoke, read_table, save_breast, write

from mammosim.cli.located_lines import located_lines
from mammosim.errors import InputError
from mammosim.pipeline import locate_in_run, read_views
from mammosim.targets import curve_of, point_at_height, point_from_image_points


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A finished run of a small breast: CC, MLO and a series of projections at -15, 0, 15."""
    folder = save_breast(tmp_path_factory.mktemp("user"))
    sweep = {"view": "CC", "angle_range_deg": 30, "projections": 3}
    path = write(folder, views=["CC", "MLO", {"dbt": sweep}])
    result = invoke("run", path, "--output", folder / "out")
    assert result.exit_code == 0, result.output
    return folder / "out"


def rows_of(run: Path, view: str) -> dict[str, dict[str, str]]:
    return {row["name"]: row for row in read_table(run / "lesions.csv") if row["view"] == view}


def place(row: dict[str, str], stem: str = "") -> np.ndarray:
    return np.array([float(row[f"{stem}{axis}_mm"]) for axis in "xyz"])


def image_of(saved, point, angle=0.0):
    """Row and column at which an uncompressed point appears, through the saved field."""
    image_point = saved.image_point(0.0, 0.0, angle)
    after = point + saved.field.displacement_at(point)[0]
    return image_point.gantry.project(image_point.gantry.gantry_from_breast(after)), after


def test_the_saved_field_is_the_one_that_was_written(run):
    views = read_views(run, ["CC", "LMLO", "CC_DBT"])
    for name, saved in views.items():
        for row in rows_of(run, name.removeprefix("L")).values():
            if row["kind"] == "mass":
                continue  # the mean over its voxels, not the field at its centre
            shift = saved.field.displacement_at(place(row))[0]
            # Four decimals in the table, single precision in the file.
            np.testing.assert_allclose(shift, place(row, "shift_"), atol=1e-4)


@pytest.mark.parametrize("view", ["CC", "MLO"])
def test_pixel_and_height_lead_back_to_the_point(run, view):
    saved = read_views(run, [view])[view]
    rng = np.random.default_rng(7)
    for _ in range(12):
        point = rng.uniform([8.0, -12.0, -10.0], [20.0, 12.0, 10.0])
        pixel, after = image_of(saved, point)
        height = saved.gantry.gantry_from_breast(after)[2]
        found = point_at_height(saved.image_point(*pixel), height)
        # Newton's inverse stops at 1e-6 mm; the field folds nowhere here.
        np.testing.assert_allclose(found.point_mm, point, atol=1e-4)
        assert found.height_mm[0] == pytest.approx(height, abs=1e-4)
        curve = curve_of(saved.image_point(*pixel), 0.5)
        nearest = np.linalg.norm(curve.point_mm - point, axis=1).min()
        assert nearest < 0.5  # half a step, stretched by compression


def test_two_views_or_a_stereotactic_pair_meet_in_the_point(run):
    views = read_views(run, ["CC", "MLO"])
    rng = np.random.default_rng(8)
    for _ in range(8):
        point = rng.uniform([8.0, -12.0, -10.0], [20.0, 12.0, 10.0])
        for pair in ((("CC", 0.0), ("MLO", 0.0)), (("CC", -15.0), ("CC", 15.0))):
            image_points = [
                views[name].image_point(*image_of(views[name], point, angle)[0], angle)
                for name, angle in pair
            ]
            found = point_from_image_points(image_points)
            # The least squares end at 1e-8 mm; finite differences of a piecewise linear field.
            np.testing.assert_allclose(found.point_mm, point, atol=1e-3)
            assert max(found.misfit_mm) < 1e-3


def test_a_pixels_error_is_told_by_the_misfit(run):
    views = read_views(run, ["CC", "MLO"])
    point = np.array([14.0, 4.0, 3.0])
    image_points = [
        views[name].image_point(*image_of(views[name], point)[0]) for name in ("CC", "MLO")
    ]
    # Columns of both views measure x: 5 pixels of 0.8 mm apart, they are both half right.
    wrong = views["MLO"].image_point(image_points[1].row, image_points[1].column + 5.0)
    found = point_from_image_points([image_points[0], wrong])
    assert 1.0 < sum(found.misfit_mm) < 5.0
    assert np.linalg.norm(found.point_mm - point) < 5.0


def test_the_command_brings_the_tables_lesion_back(run):
    cc, mlo = (rows_of(run, view)["ball"] for view in ("CC", "MLO"))
    pixel = [cc["image_row_px"], cc["image_col_px"]]
    result = invoke(
        "locate", run, "--view", "CC", "--pixel", *pixel, "--height-mm", cc["compressed_z_mm"]
    )
    assert result.exit_code == 0, result.output
    # A pixel is 0.8 mm, the lesion's shadow some pixels wide, and its centroid the mean of what
    # compression bends.
    np.testing.assert_allclose(said(result.output), place(cc), atol=0.5)
    result = invoke(
        "locate", run, "--view", "CC", "--pixel", *pixel,
        "--view", "MLO", "--pixel", mlo["image_row_px"], mlo["image_col_px"],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(said(result.output), place(cc), atol=0.5)
    assert f"{cc['clock_position']}, " in result.output
    assert "mm from the pixel" in result.output


def said(output: str) -> list[float]:
    words = output.split("uncompressed: ")[1].split(" mm")[0].replace(",", "").split()
    return [float(word) for word in words[1::2]]


def test_the_projections_of_a_series_are_a_stereotactic_pair(run):
    """Pixels from the written lesion masks of the outermost projections."""
    tifffile = pytest.importorskip("tifffile")
    masks = tifffile.imread(run / "LCC_DBT" / "lesion_mask.tif")
    row = rows_of(run, "CC_DBT")["ball"]
    options = []
    for page, angle in ((masks[0], -15), (masks[-1], 15)):
        pixel = np.argwhere(page == int(row["target_id"])).mean(axis=0)
        options += ["--view", "CC_DBT", "--tube-angle", angle, "--pixel", *pixel]
    result = invoke("locate", run, *options)
    assert result.exit_code == 0, result.output
    # A mask's centre is good to about half a pixel of 0.8 mm; over 30 degrees that is 0.8 mm of
    # height, and 1 / 0.8 of it before the breast was compressed.
    np.testing.assert_allclose(said(result.output), place(row), atol=1.2)


def test_one_pixel_gives_the_curve(run):
    cc = rows_of(run, "CC")["ball"]
    result = invoke("locate", run, "--view", "CC", "--pixel", cc["image_row_px"],
                    cc["image_col_px"], "--step-mm", 2)  # fmt: skip
    assert result.exit_code == 0, result.output
    lines = [line.split() for line in result.output.splitlines()[1:-1]]
    heights = [float(line[0]) for line in lines]
    assert heights == sorted(heights)
    assert np.diff(heights[1:-1]) == pytest.approx(2.0)
    points = np.array([[float(word) for word in line[1:4]] for line in lines])
    assert np.linalg.norm(points - place(cc), axis=1).min() < 1.5


def test_a_step_larger_than_the_breast_leaves_both_ends(run):
    cc = rows_of(run, "CC")["ball"]
    image_point = read_views(run, ["CC"])["CC"].image_point(
        float(cc["image_row_px"]), float(cc["image_col_px"])
    )
    fine, ends = curve_of(image_point, 0.5), curve_of(image_point, 200.0)
    assert ends.height_mm.size in (2, 3)  # a multiple of 200 may lie between: 0
    assert ends.height_mm[[0, -1]].tolist() == fine.height_mm[[0, -1]].tolist()
    np.testing.assert_allclose(ends.point_mm[-1], fine.point_mm[-1])


def test_without_labels_the_lattice_says_where_tissue_is(run, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(run / "LCC", copy / "LCC")
    (copy / "LCC" / "compressed.nii.gz").unlink()
    cc = rows_of(run, "CC")["ball"]
    image_point = read_views(copy, ["CC"])["CC"].image_point(
        float(cc["image_row_px"]), float(cc["image_col_px"])
    )
    with_labels = read_views(run, ["CC"])["CC"].image_point(image_point.row, image_point.column)
    for end in (0, -1):
        # The lattice has 3 mm, the phantom's voxels 1 mm.
        assert curve_of(image_point).height_mm[end] == pytest.approx(
            curve_of(with_labels).height_mm[end], abs=3.0
        )


BAD = [
    (["--view", "CC", "--pixel", "a", 100], r"--pixel: found 'a 100', expected row and column"),
    (["--view", "CC", "--pixel", 2, 100], r"lies outside the breast; no tissue is on its ray"),
    (["--view", "CC", "--pixel", -3, 10], r"the row is not on the image, which has 300"),
    (["--view", "CC", "--pixel", 150, 900], r"the column is not on the image"),
    (["--view", "CC", "--pixel", 150, 10, "--height-mm", 80], r"found 80, which is in air; on th"),
    (["--view", "ML", "--pixel", 150, 10], r"view: found 'ML', .* has LCC, LCC_DBT, LMLO"),
    (["--view", "CC", "--view", "MLO", "--pixel", 1, 1], r"found 2 views and 1 pixels"),
    (["--view", "CC", "--pixel", 150, 10, "--tube-angle", 90], r"tube_angle_deg: found 90"),
    (
        ["--view", "CC", "--pixel", 150, 10, "--tube-angle", 5, "--tube-angle", 6],
        r"found 2 tube angles and 1 views",
    ),
    (
        ["--view", "CC", "--pixel", 150, 10, "--view", "CC", "--pixel", 150, 10],
        r"their rays differ by 0.00 degrees, expected at least 1",
    ),
    (
        ["--view", "CC", "--pixel", 150, 10, "--view", "MLO", "--pixel", 150, 10,
         "--height-mm", 5],
        r"a height can be given for one view",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("options", "message"), BAD)
def test_bad_input_gets_a_plain_answer(run, options, message):
    result = invoke("locate", run, *options)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert __import__("re").search(message, result.output), result.output


def test_three_pictures_are_refused(run):
    with pytest.raises(InputError, match="found 3 views, expected one or two"):
        locate_in_run(run, ["CC"] * 3, [(1.0, 1.0)] * 3)


def test_a_folder_that_is_no_run(tmp_path):
    result = invoke("locate", tmp_path, "--view", "CC", "--pixel", 1, 1)
    assert result.exit_code == 2
    assert "expected the folder of a finished run" in result.output


def test_files_that_are_gone_or_broken_are_named(run, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(run / "LCC", copy / "LCC")
    folder = copy / "LCC"
    (folder / "lattice.nii.gz").rename(folder / "away")
    with pytest.raises(InputError, match=r"lattice.nii.gz: no such file; export.volumes must"):
        read_views(copy, ["CC"])
    (folder / "lattice.nii.gz").write_bytes(b"not a volume")
    with pytest.raises(InputError, match=r"lattice.nii.gz: cannot be read"):
        read_views(copy, ["CC"])
    shutil.copy(folder / "compressed.nii.gz", folder / "lattice.nii.gz")
    with pytest.raises(InputError, match="expected the same nodes with three components"):
        read_views(copy, ["CC"])
    (folder / "away").replace(folder / "lattice.nii.gz")
    (folder / "compression.json").write_text("{")
    with pytest.raises(InputError, match=r"compression.json: cannot be read as JSON"):
        read_views(copy, ["CC"])
    (folder / "compression.json").write_text("[]")
    with pytest.raises(InputError, match=r"compression.json: expected a JSON object"):
        read_views(copy, ["CC"])
    (folder / "geometry.json").write_text(json.dumps({"view": {"name": "CC"}}))
    with pytest.raises(InputError, match=r"geometry.json: expected JSON with view, detector_edge"):
        read_views(copy, ["CC"])


def test_what_did_not_converge_is_said(run, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(run / "LCC", copy / "LCC")
    file = copy / "LCC" / "compression.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "converged": False}))
    cc = rows_of(run, "CC")["ball"]
    pixel = (float(cc["image_row_px"]), float(cc["image_col_px"]))
    lines = located_lines(locate_in_run(copy, ["CC"], [pixel]))
    assert lines[0] == "note: the compression of CC did not converge"


def test_pixels_of_two_things_are_questioned(run):
    cc, mlo = (rows_of(run, view) for view in ("CC", "MLO"))
    pixels = [
        (float(row["image_row_px"]), float(row["image_col_px"]))
        for row in (cc["ball"], mlo["nipple"])
    ]
    pixels[1] = (pixels[1][0], pixels[1][1] - 4.0)  # well inside the skin
    lines = located_lines(locate_in_run(run, ["CC", "MLO"], pixels))
    assert "do they show the same lesion?" in lines[-1]
