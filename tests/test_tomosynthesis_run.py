"""A view as a series of projections, end to end; and what is refused beforehand."""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from make_run import invoke, save_breast
from make_run import write as write_small
from PIL import Image

from mammosim.config import read_yaml, to_settings
from mammosim.errors import InputError
from mammosim.pipeline import RunConfig, RunFolder, load_config

SERIES = {"view": "CC", "angle_range_deg": 40, "projections": 3}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return save_breast(tmp_path_factory.mktemp("series"))


def write(folder: Path, name: str = "run.yaml", **changes) -> Path:
    views = [{"dbt": SERIES}, {"view": "CC", "mas": 60}]
    return write_small(folder, name, **{"views": views, **changes})


@pytest.fixture(scope="module")
def finished(folder) -> Path:
    output = folder / "out"
    result = invoke("run", write(folder), "--output", output)
    assert result.exit_code == 0, result.output
    assert "LCC_DBT: 3 projections, 36.0 mm" in result.output
    return output


def test_files_of_a_series(finished):
    found = {path.name for path in (finished / "LCC_DBT").iterdir()}
    assert found == {
        "projections.tif", "lesion_mask.tif", "preview.png", "compressed.nii.gz",
        "displacement.nii.gz", "lattice.nii.gz", "convergence.csv", "compression.json",
        "geometry.json", "labels.json", "labels.ctbl",
        "projections_for_processing.dcm", "projections_for_presentation.dcm",
    }  # fmt: skip
    assert (finished / "LCC" / "for_presentation.dcm").exists()


def test_pages_and_record_tell_the_same(finished):
    record = json.loads((finished / "run.json").read_text())
    geometry = record["tomosynthesis"]["LCC_DBT"]
    with tifffile.TiffFile(finished / "LCC_DBT" / "projections.tif") as stack:
        assert len(stack.pages) == 3
        page = stack.pages[0]
        assert (page.shape, page.dtype) == ((geometry["rows"], geometry["columns"]), np.uint16)
        across = page.tags["XResolution"].value
        assert 10.0 * across[1] / across[0] == pytest.approx(0.8, rel=1e-6)
    assert [taken["angle_deg"] for taken in geometry["projections"]] == [-20.0, 0.0, 20.0]
    pivot = np.array(geometry["pivot_mm"])
    for taken in geometry["projections"]:
        arm = np.array(taken["focal_spot_mm"]) - pivot
        assert np.linalg.norm(arm) == pytest.approx(600.0, abs=1e-5)
        assert np.degrees(np.arctan2(arm[1], arm[2])) == pytest.approx(taken["angle_deg"], abs=1e-6)
        assert taken["mas"] == pytest.approx(geometry["mas"] / 3)
    assert "LCC_DBT/projections.tif" in record["files"]


def test_the_recorded_geometry_finds_the_lesion_on_every_page(finished):
    """A reader's own sum, with nothing but run.json and lesions.csv."""
    geometry = json.loads((finished / "run.json").read_text())["tomosynthesis"]["LCC_DBT"]
    rows = list(csv.DictReader((finished / "lesions.csv").open()))
    row = next(row for row in rows if (row["view"], row["name"]) == ("CC_DBT", "ball"))
    place = np.array([float(row[f"compressed_{axis}_mm"]) for axis in "xyz"])
    first, down, right = (
        np.array(geometry[key]) for key in ("first_pixel_mm", "row_step_mm", "column_step_mm")
    )
    masks = tifffile.imread(finished / "LCC_DBT" / "lesion_mask.tif")
    assert masks.shape == (3, geometry["rows"], geometry["columns"])
    for taken in geometry["projections"]:
        spot = np.array(taken["focal_spot_mm"])
        share = (spot[2] - first[2]) / (spot[2] - place[2])
        shadow = spot + share * (place - spot) - first
        expected = [shadow @ down / (down @ down), shadow @ right / (right @ right)]
        found = np.argwhere(masks[taken["page"]] == int(row["target_id"])).mean(axis=0)
        # a ball of 6 mm in voxels of 1 mm and more, seen in whole pixels of 0.8 mm
        np.testing.assert_allclose(found, expected, atol=1.0)
    spread = [np.argwhere(page)[:, 0].mean() for page in masks]
    assert spread[0] < spread[1] < spread[2]  # the tube goes to +y, the shadow down


def test_the_preview_and_the_table_are_the_middle_projection(finished):
    rows = list(csv.DictReader((finished / "lesions.csv").open()))
    assert {row["view"] for row in rows} == {"CC", "CC_DBT"}
    grey = np.asarray(Image.open(finished / "LCC_DBT" / "preview.png"))
    assert grey.shape == tifffile.imread(finished / "LCC_DBT" / "projections.tif").shape[1:]
    assert grey.max() > 150  # the curve has a shoulder, so that nothing reaches white
    page = (finished / "report.html").read_text()
    assert "LCC_DBT" in page


def test_the_saved_configuration_gives_the_same_projections(folder, finished):
    saved = read_yaml(finished / "config.yaml")
    assert saved["views"][0]["acquisition"] == {"grid": False}
    output = folder / "again"
    assert invoke("run", finished / "config.yaml", "--output", output).exit_code == 0
    stack = "LCC_DBT/projections.tif"
    assert (output / stack).read_bytes() == (finished / stack).read_bytes()


def config(*views, **sections) -> RunConfig:
    return to_settings(
        RunConfig, {"phantom": {"generate": {}}, "views": list(views), **sections}, ""
    )


@pytest.mark.parametrize(
    "view",
    [
        {"dbt": "MLO"},
        {"dbt": {"view": "MLO"}},
        {"view": "MLO", "dbt": {}},
        {"view": "MLO", "dbt": "MLO"},
    ],
)
def test_ways_to_write_a_series(view):
    (read,) = config(view).views
    assert (read.view, read.label) == ("MLO", "MLO_DBT")
    assert (read.dbt.angle_range_deg, read.dbt.projections) == (50.0, 25)


def test_a_view_may_be_taken_both_ways_and_with_a_grid():
    both = config("CC", {"dbt": "CC", "thickness_mm": 40, "grid": True}, acquisition={"mas": 70})
    assert [view.label for view in both.views] == ["CC", "CC_DBT"]
    series = both.resolved_views[1]
    assert series.compression.thickness_mm == 40
    assert series.acquisition.grid
    assert series.acquisition.mas == 70
    plain = config({"dbt": "CC"}, acquisition={"grid": True})
    assert not plain.resolved_views[0].acquisition.grid


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ({"view": "CC", "dbt": {"view": "MLO"}}, r"dbt\.view: found MLO, expected CC"),
        ({"dbt": {"projections": 3}}, r"views\.0\.dbt\.view: missing"),
        ({"dbt": {"view": "CC", "angle": 3}}, r"views\.0\.dbt\.angle: unknown key"),
        ({"dbt": {"view": "CC", "projections": 0}}, r"projections: found 0, expected greater"),
        ({"dbt": {"view": "CC", "projections": 2.5}}, r"projections: found 2\.5"),
        ({"dbt": {"view": "CC", "angle_range_deg": 200}}, r"angle_range_deg: found 200"),
        ({"dbt": 25}, r"views\.0\.dbt: found 25"),
        (
            {"dbt": {"view": "CC", "system": "like-none"}},
            r"dbt\.system: found 'like-none', expected one of like-dimensions, ",
        ),
        (
            {"dbt": {"view": "CC", "projections": 3, "shares": [1, 2]}},
            r"shares: found 2, expected one for each of the 3 projections",
        ),
        (
            {"dbt": {"view": "CC", "angle_range_deg": 0, "reconstruct": {}}},
            r"reconstruct: found 25 projections over 0 degrees, expected at least 2 over more",
        ),
        (
            {"dbt": {"view": "CC", "projections": 1, "reconstruct": {}}},
            r"reconstruct: found 1 projections over 50 degrees",
        ),
        (
            {"dbt": {"view": "CC", "reconstruct": {"synthetic_2d": True}}},
            r"synthetic_2d: found true with method: fdk, .* expected method: sart",
        ),
        (
            {"dbt": {"view": "CC", "angle_range_deg": 10, "detector_angle_range_deg": 12}},
            r"detector_angle_range_deg: found 12, expected at most angle_range_deg, 10",
        ),
        ({"dbt": {"view": "CC", "reconstruct": {"method": "mlem"}}}, r"method: found 'mlem'"),
    ],
)
def test_faulty_series_are_refused(view, message):
    with pytest.raises(InputError, match=message) as caught:
        config(view)
    assert "at least 1 of them" not in str(caught.value)


def test_a_series_twice_is_refused():
    with pytest.raises(InputError, match="CC_DBT is listed twice"):
        config({"dbt": "CC"}, {"dbt": "CC", "thickness_mm": 50})


def test_a_system_fills_what_is_left_out():
    (view,) = config({"dbt": {"view": "CC", "system": "like-senoclaire", "projections": 5}}).views
    assert (view.dbt.angle_range_deg, view.dbt.projections) == (25.0, 5)
    assert view.dbt.detector_angle_range_deg == 0.0
    hologic = {"view": "CC", "system": "like-dimensions"}
    (turning, other) = (
        config({"dbt": {**hologic, **keys}}).views[0].dbt for keys in ({}, {"angle_range_deg": 5})
    )
    assert turning.detector_angle_range_deg == 4.2
    assert other.detector_angle_range_deg == pytest.approx(4.2 / 3.0)  # the same part of the arc
    (saved,) = config({"dbt": view.dbt.model_dump()}).views
    assert saved.dbt == view.dbt


BEFOREHAND = [
    (
        {"views": [{"dbt": {"view": "CC", "angle_range_deg": 180, "pivot_to_detector_mm": 10}}]},
        r"angle_range_deg: found 180, which moves the focal spot down to 10 mm above the detector",
    ),
    (
        {
            "views": [{"dbt": {"view": "CC", "pivot_to_detector_mm": 250}}],
            "projection": {"source_to_detector_mm": 200},
        },
        r"pivot_to_detector_mm: found 250, expected at most projection.source_to_detector_mm, 200",
    ),
    ({"projection": {"pixel_mm": 1e-5}}, r"pixel_mm: found 1e-05, which needs \d+\.\d GB"),
    ({"acquisition": {"spectrum_file": "none.txt"}}, r"spectrum_file: no such file"),
    ({"acquisition": {"spectrum_file": "bad.txt"}}, r"bad.txt: .*expected two columns"),
    ({"acquisition": {"spectrum_file": "hard.txt", "kvp": 28}}, r"found photons of 35 keV"),
    ({"acquisition": {"composition": "none.yaml"}}, r"none.yaml: no such file"),
    ({"acquisition": {"kvp": 60}}, r"acquisition.kvp: found 60.* 20 to 49 kV"),
    ({"acquisition": {"mas": 0}}, r"acquisition.mas: found 0.*zero dose"),
    ({"acquisition": {"target": "Cu"}}, r"acquisition.target: found 'Cu', expected one of W"),
    ({"acquisition": {"filter": "Sn"}}, r"acquisition.filter: found 'Sn', expected one of Mo"),
]


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(("changes", "message"), BEFOREHAND)
def test_refused_before_anything_is_computed(
    changes, message, command, folder, tmp_path, monkeypatch
):
    (folder / "bad.txt").write_text("20 1 1\n21 1 1\n")
    (folder / "hard.txt").write_text("20 1e6\n35 1e6\n")
    monkeypatch.setattr("mammosim.pipeline.run.simulation.compress", None)  # must not get so far
    path = write(folder, f"{tmp_path.name}.yaml", **changes)
    output = ["--output", tmp_path / "out"] if command == "run" else []
    result = invoke(command, path, *output)
    assert result.exit_code == 2, result.output

    assert re.search(message, result.output), result.output
    assert "Traceback" not in result.output


def test_an_arc_into_the_breast_is_refused_by_check(folder):
    """Above the support, but not above the breast on it."""
    dbt = {"view": "CC", "angle_range_deg": 176, "pivot_to_detector_mm": 0, "projections": 3}
    result = invoke("check", write(folder, "low.yaml", views=[{"dbt": dbt}]))
    assert result.exit_code == 2, result.output
    assert (
        "CC_DBT: projection.source_to_detector_mm: found 650, expected more than" in result.output
    )


def test_a_detector_that_turns_into_the_support_is_refused_by_check(folder):
    dbt = {**SERIES, "detector_angle_range_deg": 30}
    result = invoke("check", write(folder, "turn.yaml", views=[{"dbt": dbt}]))
    assert result.exit_code == 2, result.output
    assert "turns the detector by -15 degrees, whose edge then reaches the breast" in result.output


def test_check_warns_of_a_dose_without_its_angle(folder):
    """Only Monte Carlo finds the dose at each angle of the tube."""
    said = []
    for model in ("kernels", "monte-carlo"):
        path = write(folder, f"{model}.yaml", views=[{"dbt": SERIES}],
                     acquisition={"scatter": {"model": model}})  # fmt: skip
        said.append(invoke("check", path).output)
    assert re.search(r"CC_DBT: tube angle at which t, .* is taken as 1: found 20 degrees", said[0])
    assert "taken as 1" not in said[1]


def test_check_says_what_slices_need_to_be_installed(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "itk", None)
    path = write(folder, "slices.yaml", views=[{"dbt": {**SERIES, "reconstruct": {}}}])
    result = invoke("check", path)
    assert result.exit_code == 2, result.output
    assert "dbt.reconstruct: itk-rtk cannot be imported" in result.output
    assert "pip install itk-rtk" in result.output


def test_check_refuses_slices_larger_than_memory(folder, monkeypatch):
    for module in ("pipeline.configuration.preflight", "reconstruction.reconstruct"):
        monkeypatch.setattr(sys.modules[f"mammosim.{module}"], "load_rtk", lambda: None)
    fine = {"slice_mm": 0.1, "pixel_mm": 0.02}
    path = write(folder, "small.yaml", views=[{"dbt": {**SERIES, "reconstruct": {}}}])
    assert invoke("check", path).exit_code == 0
    # A function of the module's name hides it from a dotted path.
    module = sys.modules["mammosim.reconstruction.reconstruct"]
    monkeypatch.setattr(module, "installed_memory", lambda: 4e9)
    path = write(folder, "fine.yaml", views=[{"dbt": {**SERIES, "reconstruct": fine}}])
    result = invoke("check", path)
    assert result.exit_code == 2, result.output
    assert re.search(
        r"slices of 0.1 mm with pixels of 0.02 mm, \d+ million voxels, which need "
        r"\d+\.\d GB; this machine has 4.0 GB",
        result.output,
    )


def test_a_generated_breast_is_cut_off_at_a_small_detector(folder):
    path = write(
        folder, "generated.yaml", phantom={"generate": {"volume_ml": 400, "voxel_mm": 0.5}},
        compression={"model": "springs", "thickness_mm": 48},
        projection={"detector_mm": [120, 150]}, views=["CC", {"dbt": "MLO"}],
    )  # fmt: skip
    result = invoke("check", path)
    assert result.exit_code == 0
    assert "LCC: the breast is cut off" in result.output
    assert "LMLO_DBT: the breast is cut off" in result.output


def test_check_tells_of_the_projections(folder):
    result = invoke("check", write(folder, "plan.yaml"))
    assert result.exit_code == 0, result.output
    assert "CC_DBT: compressed to 36 mm" in result.output
    assert "from 3 tube positions over 40 degrees" in result.output


def test_a_views_own_files_are_relative_to_the_configuration(folder, tmp_path, monkeypatch):
    """A spectrum beside the file, asked for by one view, from another folder."""
    (folder / "line.txt").write_text("19 1e6\n20 1e6\n21 1e6\n")
    views = ["CC", {"view": "MLO", "spectrum_file": "line.txt"},
             {"view": "ML", "acquisition": {"spectrum_file": "line.txt"}}]  # fmt: skip
    path = write(folder, "own.yaml", views=views)
    monkeypatch.chdir(tmp_path)
    config = load_config(path)
    files = [view.acquisition.spectrum_file for view in config.resolved_views]
    assert files == [None, str(folder / "line.txt"), str(folder / "line.txt")]
    hashes = []
    for text in ("19 1e6\n20 1e6\n", "19 1e6\n20 2e6\n"):
        (folder / "line.txt").write_text(text)
        hashes.append(RunFolder(tmp_path / "run", config)._hash)
    assert hashes[0] != hashes[1]
