"""Tables, scalars, and a view's whole folder."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import json

import numpy as np
import pytest
import tifffile
from make_records import HISTORY, make_compressed, make_mammogram, make_paths, make_targets

from mammosim.export import (
    ExportSettings,
    StudyIdentity,
    write_compressed,
    write_compression,
    write_convergence,
    write_images,
    write_lesions,
)
from mammosim.geometry import View

VIEW = View("MLO", "R")

# The contract's own list, so that a renamed field is noticed.
COLUMNS = [
    "target_id",
    "name",
    "kind",
    "view",
    "volume_mm3",
    "x_mm",
    "y_mm",
    "z_mm",
    "clock_position",
    "nipple_distance_mm",
    "skin_depth_mm",
    "compressed_x_mm",
    "compressed_y_mm",
    "compressed_z_mm",
    "shift_x_mm",
    "shift_y_mm",
    "shift_z_mm",
    "shift_mm",
    "volume_ratio",
    "stretch_max",
    "stretch_min",
    "image_row_px",
    "image_col_px",
    "image_nipple_distance_mm",
    "in_field",
    # What the contract promises ends here.
    "moved_x_mm",
    "moved_y_mm",
    "moved_z_mm",
    "gantry_x_mm",
    "gantry_y_mm",
    "gantry_z_mm",
    "shift_along_mm",
    "shift_across_mm",
    "stretch_middle",
    "contrast",
    "sdnr",
    "ellipsoid_long_mm",
    "ellipsoid_middle_mm",
    "ellipsoid_short_mm",
    "extent_mm",
    "laterality",
    "volume_slice",
    "volume_row_px",
    "volume_col_px",
]


def read(path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_lesions_csv_has_the_promised_columns_and_fixed_numbers(tmp_path):
    write_lesions(make_targets(VIEW), tmp_path / "lesions.csv")
    rows = read(tmp_path / "lesions.csv")
    assert list(rows[0]) == COLUMNS
    assert len(rows) == 5
    assert rows[0]["x_mm"] == "20.0000"
    assert rows[0]["clock_position"] == "1:30"
    assert [row["in_field"] for row in rows] == ["true", "true", "true", "false", "true"]
    assert rows[3]["volume_mm3"] == ""  # a landmark has none
    assert b"\r" not in (tmp_path / "lesions.csv").read_bytes()


def test_zero_has_no_sign_and_names_may_hold_commas(tmp_path):
    target = dataclasses.replace(make_targets(VIEW)[0], x_mm=-1e-9, name='upper, "outer"')
    write_lesions([target], tmp_path / "lesions.csv")
    (row,) = read(tmp_path / "lesions.csv")
    assert row["x_mm"] == "0.0000"
    assert row["name"] == 'upper, "outer"'


def test_without_targets_there_is_the_header(tmp_path):
    write_lesions([], tmp_path / "lesions.csv")
    assert (tmp_path / "lesions.csv").read_text() == ",".join(COLUMNS) + "\n"


def test_the_history_comes_back(tmp_path):
    write_convergence(HISTORY, tmp_path / "convergence.csv")
    rows = read(tmp_path / "convergence.csv")
    assert [int(row["iteration"]) for row in rows] == list(range(10))
    np.testing.assert_allclose(
        [float(row["residual"]) for row in rows], HISTORY["residual"], rtol=1e-8
    )  # nine digits are written
    assert rows[0]["settled"] == "false"
    assert rows[9]["settled"] == "true"


def test_compression_json_holds_plates_and_measures(tmp_path):
    compressed = make_compressed(VIEW, converged=False, notes=("It stopped early.",))
    write_compression(compressed, tmp_path / "compression.json")
    values = json.loads((tmp_path / "compression.json").read_text())
    assert values["thickness_mm"] == 52.0
    assert values["converged"] is False
    assert values["angle_deg"] == 45.0
    assert values["notes"] == ["It stopped early."]
    assert {key: values[key] for key in compressed.measures} == dict(compressed.measures)


def write_folder(folder, settings) -> dict[str, str]:
    compressed = make_compressed(VIEW)
    write_compressed(
        folder, compressed, settings, compressed.phantom.labels, compressed.phantom.frame
    )
    study = StudyIdentity("77" * 32)
    write_images(
        folder, make_paths(VIEW), make_mammogram(VIEW), make_targets(VIEW), settings, study
    )
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def test_a_views_folder_holds_the_promised_files_and_reruns_are_identical(tmp_path):
    files = write_folder(tmp_path / "RMLO", ExportSettings())
    assert set(files) == {
        "for_processing.dcm", "for_presentation.dcm", "for_presentation.png",
        "mammogram.tif", "preview.png",
        "lesion_mask.dcm", "lesion_mask.tif", "lesion_measurements.dcm", "lesion_outlines.dcm",
        "compressed.nii.gz",
        "displacement.nii.gz", "lattice.nii.gz", "convergence.csv", "compression.json",
        "geometry.json", "labels.json", "labels.ctbl",
    }  # fmt: skip
    assert files == write_folder(tmp_path / "again", ExportSettings())


def test_files_can_be_left_out_and_asked_for(tmp_path):
    off = ExportSettings(dicom=False, tiff=False, png=False, volumes=False)
    least = {"convergence.csv", "compression.json", "geometry.json"}
    assert set(write_folder(tmp_path / "a", off)) == least
    truth = ("path_lengths", "glandular_thickness", "volumetric_density", "lesion_lengths")
    more = off.model_copy(update=dict.fromkeys(truth, True))
    asked = set(write_folder(tmp_path / "b", more)) - set(write_folder(tmp_path / "a", off))
    assert asked == {
        "path_lengths.npz", "glandular_thickness.tif", "volumetric_density.tif",
        "lesion_lengths.tif",
    }  # fmt: skip


def test_a_breast_without_lesions_has_no_segmentation(tmp_path):
    paths = make_paths(VIEW)
    plain = dataclasses.replace(
        paths, tissues=paths.tissues[:2], materials=paths.materials[:2], lesion_labels=(0, 0),
        length_mm=paths.length_mm[:2], attenuating_mm=paths.attenuating_mm[:2],
    )  # fmt: skip
    write_images(
        tmp_path, plain, make_mammogram(VIEW), [], ExportSettings(), StudyIdentity("77" * 32)
    )
    assert not (tmp_path / "lesion_mask.dcm").exists()
    assert (tmp_path / "lesion_mask.tif").exists()


@pytest.mark.parametrize("name", ["MLO", "RMLO"])
def test_targets_of_other_views_are_passed_over(tmp_path, name):
    here = [dataclasses.replace(target, view=name) for target in make_targets(VIEW)]
    elsewhere = [dataclasses.replace(target, view="CC", target_id=90) for target in here]
    write_images(
        tmp_path, make_paths(VIEW), make_mammogram(VIEW), here + elsewhere,
        ExportSettings(dicom=False, png=False), StudyIdentity("77" * 32),
    )  # fmt: skip
    assert set(np.unique(tifffile.imread(tmp_path / "lesion_mask.tif"))) == {0, 1, 2, 3}
