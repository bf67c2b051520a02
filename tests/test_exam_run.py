"""A bilateral exam: one run, four views and a repeat, and what viewers and archives make of it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pydicom
import pytest
from make_run import invoke, read_table, write
from naive.archive import Archive
from naive.hanging import hang
from PIL import Image

import mammosim
from mammosim.errors import InputError
from mammosim.phantom import make_phantom
from mammosim.pipeline import locate_in_run

EXAM = {
    "phantom": {
        "generate": {"volume_ml": 250, "voxel_mm": 3.0, "density": "fatty"},
        "lesions": [
            {"name": "mass", "kind": "mass", "diameter_mm": 16},
            {"name": "clip", "kind": "mass", "diameter_mm": 14, "laterality": "L"},
        ],
    },
    "compression": {"model": "springs", "resolution_mm": 6.0},
    "projection": {"pixel_mm": 1.0},
    "acquisition": {"scatter": False},
    "patient": {"id": "W-1", "birth_date": "19490301"},
    "laterality": ["R", "L"],
    "views": [
        "CC",
        "MLO",
        {"view": "CC", "name": "CC_again", "laterality": "R", "realisations": 2},
    ],
}
FOLDERS = ["LCC", "LMLO", "RCC", "RCC_again", "RMLO"]


@pytest.fixture(scope="module")
def exam(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exam")
    path = write(folder, "exam.yaml", **EXAM)
    result = invoke("run", path, "--output", folder / "out")
    assert result.exit_code == 0, result.output
    return folder


def objects_of(exam) -> list[pydicom.Dataset]:
    return [pydicom.dcmread(path) for path in sorted((exam / "out").rglob("*.dcm"))]


def test_four_views_and_a_repeat_are_one_study_of_one_patient(exam):
    assert sorted(path.parent.name for path in (exam / "out").glob("*/preview.png")) == FOLDERS
    datasets = objects_of(exam)
    assert {dataset.PatientID for dataset in datasets} == {"W-1"}
    assert {dataset.PatientAge for dataset in datasets} == {"050Y"}
    assert len({dataset.StudyInstanceUID for dataset in datasets}) == 1
    first = [dataset for dataset in datasets if not dataset.filename.endswith("_001.dcm")]
    assert len({dataset.SOPInstanceUID for dataset in first}) == len(first)


def test_each_target_has_its_own_number_and_its_side(exam):
    rows = read_table(exam / "out" / "lesions.csv")
    found = {(row["target_id"], row["name"], row["laterality"]) for row in rows}
    assert found == {
        ("1", "mass", "R"), ("2", "nipple", "R"), ("3", "clip", "L"), ("4", "nipple", "L"),
    }  # fmt: skip
    for side, label in (("R", 1), ("L", 3)):
        mask = pydicom.dcmread(exam / "out" / f"{side}CC" / "lesion_mask.dcm")
        assert mask.SegmentSequence[0].TrackingID.startswith(f"{label} ")


def test_the_second_breast_is_the_other_one_of_the_same_woman(exam):
    """As in a run of its own, but for lesions, which are drawn apart; related, not mirrored."""

    def breast(laterality, number=-1, **phantom):
        values = {**EXAM["phantom"], **phantom}
        whole = mammosim.RunConfig(phantom=values, laterality=laterality)
        one = whole.sides[number]
        return make_phantom(one.phantom, one.first_side, 1, breast_number=one.breast_number)

    left, right = breast(("R", "L"), lesions=()), breast(("R", "L"), 0, lesions=())
    np.testing.assert_array_equal(left.labels, breast("L", lesions=()).labels)
    volumes = [np.count_nonzero(one.labels) for one in (right, left)]
    assert volumes[0] == pytest.approx(volumes[1], rel=0.25)
    shape = np.minimum(right.labels.shape, left.labels.shape)
    part = tuple(slice(0, size) for size in shape)
    assert (right.labels[part] != left.labels[part][:, ::-1]).mean() > 0.02


def test_rules_are_judged_between_the_standard_views_alone(exam):
    """A view taken again is another picture of one of the two, not a third projection."""
    rows = read_table(exam / "out" / "view_rules.csv")
    names = {row[column] for row in rows for column in ("from_view", "to_view")}
    assert names == {"CC", "MLO"}


def test_an_interrupted_exam_goes_on_where_it_stopped(exam):
    """The stages of both breasts are kept: nothing is compressed again."""
    out = exam / "again"
    shutil.copytree(exam / "out", out)
    record = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**record, "status": "interrupted"}))
    shutil.rmtree(out / "LMLO")
    assert invoke("run", exam / "exam.yaml", "--output", out, "--resume").exit_code == 0
    again = json.loads((out / "run.json").read_text())
    assert set(again["stages_reused"]) == {
        "phantom", "L.phantom", *(f"{folder}.compression" for folder in FOLDERS)
    }  # fmt: skip
    assert again["files"] == record["files"]


def test_the_report_hangs_right_and_left_back_to_back(exam):
    page = (exam / "out" / "report.html").read_text()
    pictures = re.findall(r'<figure class="view (right|left)">.*?<text class="name"[^>]*>(\w+)<',
                          page, re.DOTALL)  # fmt: skip
    assert pictures == [
        ("right", "RCC"), ("left", "LCC"), ("right", "RMLO"), ("left", "LMLO"),
        ("right", "RCC_again"),
    ]  # fmt: skip
    assert "Both breasts" in page


def test_a_hanging_protocol_fills_its_four_slots(exam):
    """OHIF's own: as published, RMLO refuses right breasts; the other three slots are the same."""
    images = [d for d in objects_of(exam) if d.SOPClassUID.endswith((".1.2", ".1.2.1"))]
    shown, published = hang(images), hang(images, as_published=True)
    assert published["RMLO"].ImageLaterality == "L"
    assert {**published, "RMLO": shown["RMLO"]} == shown
    for slot, dataset in shown.items():
        assert dataset.ImageLaterality + dataset.ViewPosition == slot
        assert dataset.PresentationIntentType == "FOR PRESENTATION"
        assert "again" not in dataset.SeriesDescription


def test_realisations_and_the_full_picture_are_written(exam):
    folder = exam / "out" / "RCC_again"
    names = ["for_processing", "for_presentation"]
    for name in names:
        first = (folder / f"{name}.dcm").read_bytes()
        assert (folder / f"{name}_001.dcm").read_bytes() == first
        assert (folder / f"{name}_002.dcm").read_bytes() != first
        assert not (folder / f"{name}_003.dcm").exists()
    with Image.open(folder / "for_presentation_002.png") as picture:
        shape = pydicom.dcmread(folder / "for_presentation_002.dcm").pixel_array.shape
        assert picture.size == shape[::-1]


def test_a_pixel_is_located_in_the_breast_that_is_named(exam):
    with pytest.raises(InputError, match="found 'CC', which both breasts have; use LCC or RCC"):
        locate_in_run(exam / "out", ["CC"], [(150.0, 30.0)], height_mm=20.0)
    with pytest.raises(InputError, match="show two breasts"):
        locate_in_run(exam / "out", ["LCC", "RMLO"], [(150.0, 30.0), (150.0, 190.0)])


@pytest.mark.skipif(
    shutil.which("dciodvfy") is None,
    reason="dciodvfy (Debian package dicom3tools) is not installed",
)
def test_the_validator_finds_no_error_in_any_object(exam):
    paths = sorted((exam / "out").rglob("*.dcm"))
    assert len(paths) >= 24
    for path in paths:
        said = subprocess.run(["dciodvfy", str(path)], capture_output=True, text=True, check=False)
        lines = (said.stdout + said.stderr).splitlines()
        assert [line for line in lines if "Error" in line] == [], path


@pytest.mark.service
@pytest.mark.skipif(Archive.program() is None, reason="Orthanc (Debian: orthanc) is not installed")
def test_an_archive_receives_finds_and_returns_every_object(exam, tmp_path):
    sent = {str(dataset.SOPInstanceUID): dataset for dataset in objects_of(exam)}
    with Archive(tmp_path) as archive:
        for dataset in sent.values():
            archive.store(dataset.filename)
        (study,) = archive.find("Study", {"PatientID": "W-1"})
        assert study["MainDicomTags"]["StudyDescription"] == "Simulated mammography: exam"
        series = archive.find("Series", {"PatientID": "W-1", "Modality": "MG"})
        assert {one["MainDicomTags"]["SeriesDescription"] for one in series} >= {"R CC", "L MLO"}
        kept = archive.instances()
        assert set(kept) == set(sent)
        for uid, dataset in sent.items():
            returned = archive.retrieve(kept[uid])
            # Orthanc keeps the bytes that it received.
            assert returned == Path(dataset.filename).read_bytes()


@pytest.mark.service
@pytest.mark.skipif(
    Archive.program() is None or not Archive.speaks_dicom(),
    reason="Orthanc (Debian: orthanc) or dcmtk is not installed",
)
def test_an_archive_takes_and_gives_every_object_over_the_network(exam, tmp_path):
    """C-STORE, C-FIND of study and series, C-GET: each object comes back with what it held."""
    sent = {str(dataset.SOPInstanceUID): dataset for dataset in objects_of(exam)}
    with Archive(tmp_path) as archive:
        archive.c_store([dataset.filename for dataset in sent.values()])
        asked = {"PatientID": "W-1", "StudyInstanceUID": "", "NumberOfStudyRelatedInstances": ""}
        (study,) = archive.c_find("STUDY", **asked)
        assert int(study["NumberOfStudyRelatedInstances"]) == len(sent)
        series = archive.c_find("SERIES", PatientID="W-1", Modality="MG", SeriesDescription="")
        assert {one["SeriesDescription"] for one in series} >= {"R CC", "L CC", "R MLO", "L MLO"}
        returned = archive.c_get(study["StudyInstanceUID"], tmp_path / "returned")
        assert len(returned) == len(sent)
        for path in returned:
            dataset = pydicom.dcmread(path)
            assert dataset == sent[str(dataset.SOPInstanceUID)]
