"""README's first command: the quickstart's own file, as the command line runs it, coarsely."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pydicom
import pytest
import tifffile
from make_run import invoke

CONFIGS = Path(__file__).parents[1] / "configs"

COARSELY = {
    "phantom.generate.voxel_mm": 3,
    "compression.resolution_mm": 8,
    "projection.pixel_mm": 0.8,
    "acquisition.scatter.photons": 10_000,
    "report.three_d": "false",
}
"""What makes it cheap; the breast, its lesions, the model and both views are the file's own."""


@pytest.fixture(scope="module")
def quickstart(tmp_path_factory):
    """Folder of the run, and what the command printed."""
    folder = tmp_path_factory.mktemp("quickstart") / "run"
    changes = [word for key, value in COARSELY.items() for word in ("--set", f"{key}={value}")]
    result = invoke("run", CONFIGS / "quickstart.yaml", "--output", folder, *changes)
    assert result.exit_code == 0, result.output
    return folder, result.output


def test_it_ends_with_the_lesions_and_where_the_report_is(quickstart):
    folder, printed = quickstart
    lines = [line.split() for line in printed.splitlines()]
    for view in ("LCC", "LMLO"):
        for target in ("mass", "cluster", "nipple"):
            (row,) = [line for line in lines if line[:2] == [view, target]]
            assert row[-1] == "yes"
            assert 0.0 < float(row[2]) < 60.0
    assert str(folder / "report.html") in printed


def test_both_views_hold_what_readme_promises(quickstart):
    folder, _ = quickstart
    record = json.loads((folder / "run.json").read_text())
    assert record["status"] == "done"
    assert record["seed"] == 1
    assert sorted(record["views"]) == ["LCC", "LMLO"]
    assert record["views"]["LCC"]["muscle_standing"] < record["views"]["LMLO"]["muscle_standing"]
    assert "of that in oblique views (assumed)" in (folder / "report.html").read_text()
    for name in ("uncompressed.nii.gz", "report.html", "config.yaml"):
        assert (folder / name).stat().st_size > 0
    for view in record["views"]:
        of_view = folder / view
        for name in ("preview.png", "compressed.nii.gz", "displacement.nii.gz", "lesion_mask.dcm"):
            assert (of_view / name).stat().st_size > 0
        raw = pydicom.dcmread(of_view / "for_processing.dcm")
        shown = pydicom.dcmread(of_view / "for_presentation.dcm")
        assert (raw.ImageLaterality, raw.ViewPosition) == ("L", view[1:])
        assert (raw.PresentationIntentType, shown.PresentationIntentType) == (
            "FOR PROCESSING", "FOR PRESENTATION",
        )  # fmt: skip
        pixels = tifffile.imread(of_view / "mammogram.tif")
        np.testing.assert_array_equal(pixels, raw.pixel_array)
        assert np.ptp(pixels) > 100
        masked = np.unique(tifffile.imread(of_view / "lesion_mask.tif"))
        assert masked.size == 3  # nothing, the mass, the cluster


def test_the_lesions_table_has_the_files_own_lesions_in_both_views(quickstart):
    folder, _ = quickstart
    with (folder / "lesions.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["view"], row["name"], row["kind"]) for row in rows] == [
        (view, name, kind)
        for view in ("CC", "MLO")
        for name, kind in (("mass", "mass"), ("cluster", "calcification"), ("nipple", "nipple"))
    ]
    assert {row["in_field"] for row in rows} == {"true"}
    for row in rows:
        if row["name"] == "mass":
            place = [float(row[f"{axis}_mm"]) for axis in "xyz"]
            assert place == pytest.approx([36.0, -22.0, -8.0], abs=3.0)  # a voxel
            assert 0.3 < float(row["volume_mm3"]) / (np.pi / 6.0 * 14.0**3) <= 1.0  # lobulated
