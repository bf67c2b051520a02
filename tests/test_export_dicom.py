"""Mammograms as DICOM: a validator for what one checks, own tests for what none does."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess

import numpy as np
import pydicom
import pytest
import SimpleITK
from make_records import THICKNESS_MM, make_mammogram
from naive.hanging import hang

from mammosim.export import ExportSettings, PatientSettings, StudyIdentity, write_dicom
from mammosim.export.dicom import mammogram_dataset
from mammosim.export.orientation import patient_orientation, positioner_angle_deg
from mammosim.geometry import View

STUDY = StudyIdentity("0123456789abcdef" * 4)
SETTINGS = ExportSettings()
VIEWS = [View(name, side) for name in ("CC", "MLO", "ML") for side in "LR"]
INTENTS = ("processing", "presentation")

# Breast-frame direction of each letter of Patient Orientation: +x anterior, +y left, +z superior.
DIRECTION = {"A": (1, 0, 0), "P": (-1, 0, 0), "L": (0, 1, 0), "R": (0, -1, 0), "H": (0, 0, 1),
             "F": (0, 0, -1)}  # fmt: skip

needs_dciodvfy = pytest.mark.skipif(
    shutil.which("dciodvfy") is None,
    reason="dciodvfy (Debian package dicom3tools) is not installed",
)


def folder_of(view: View) -> str:
    return view.folder


@pytest.fixture
def written(tmp_path):
    def write(view: View, intent: str, **changes) -> pydicom.Dataset:
        mammogram = dataclasses.replace(make_mammogram(view), **changes)
        path = tmp_path / f"{view.folder}_{intent}.dcm"
        write_dicom(mammogram, intent, path, STUDY, SETTINGS)
        return pydicom.dcmread(path)

    return write


@needs_dciodvfy
@pytest.mark.parametrize("intent", INTENTS)
@pytest.mark.parametrize("view", VIEWS, ids=folder_of)
def test_the_validator_finds_no_error(written, view, intent):
    path = written(view, intent).filename
    result = subprocess.run(["dciodvfy", str(path)], capture_output=True, text=True, check=False)
    said = (result.stdout + result.stderr).splitlines()
    assert f"MammographyImageFor{intent.capitalize()}" in "".join(said)
    assert [line for line in said if "Error" in line] == []
    # View Position is not needed, and the validator knows the terms of general radiography only.
    assert [line for line in said if "Warning" in line and "View Position" not in line] == []


@needs_dciodvfy
def test_the_validator_sees_a_broken_file(written):
    dataset = written(VIEWS[0], "processing")
    del dataset.ImageLaterality
    dataset.save_as(dataset.filename)
    command = ["dciodvfy", str(dataset.filename)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "Error" in result.stdout + result.stderr


@pytest.mark.parametrize(
    ("name", "side", "angle_deg", "letters"),
    [
        ("CC", "L", 45.0, ["A", "R"]),
        ("CC", "R", 45.0, ["P", "L"]),
        ("MLO", "L", 45.0, ["A", "FR"]),
        ("MLO", "R", 45.0, ["P", "FL"]),
        ("MLO", "L", 55.0, ["A", "FR"]),
        ("MLO", "L", 35.0, ["A", "RF"]),
        ("MLO", "R", 35.0, ["P", "LF"]),
        ("ML", "L", 45.0, ["A", "F"]),
        ("ML", "R", 45.0, ["P", "F"]),
    ],
)
def test_orientation_letters_are_those_of_clinical_images(name, side, angle_deg, letters):
    assert patient_orientation(View(name, side, angle_deg)) == letters


@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 60.0])
@pytest.mark.parametrize("view", VIEWS, ids=folder_of)
def test_orientation_letters_agree_with_where_points_appear(view, angle_deg):
    """A step along the letters moves a point's pixel along the row, or down the column, only."""
    view = dataclasses.replace(view, mlo_angle_deg=angle_deg)
    gantry = dataclasses.replace(make_mammogram(view).gantry, view=view)
    centre = gantry.breast_from_gantry([20.0, 0.0, 25.0])
    for axis, letters in ((1, patient_orientation(view)[0]), (0, patient_orientation(view)[1])):
        for letter in letters:
            step = 5.0 * np.array(DIRECTION[letter])
            before, after = (
                gantry.project(gantry.gantry_from_breast(point))
                for point in (centre, centre + step)
            )
            assert after[axis] - before[axis] > 1.0  # pixels


@pytest.mark.parametrize("intent", INTENTS)
@pytest.mark.parametrize("view", VIEWS, ids=folder_of)
def test_the_file_names_side_view_and_angle(written, view, intent):
    dataset = written(view, intent)
    code = dataset.ViewCodeSequence[0]
    assert dataset.ImageLaterality == view.laterality
    assert "Laterality" not in dataset
    assert list(dataset.PatientOrientation) == patient_orientation(view)
    assert (code.CodeValue, code.CodingSchemeDesignator) == {
        "CC": ("399162004", "SCT"), "MLO": ("399368009", "SCT"), "ML": ("399260004", "SCT"),
    }[view.name]  # fmt: skip
    assert len(code.ViewModifierCodeSequence) == 0
    assert dataset.AnatomicRegionSequence[0].CodeValue == "76752008"
    assert dataset.PositionerPrimaryAngleDirection == "CC"
    assert float(dataset.PositionerPrimaryAngle) == positioner_angle_deg(view)
    assert str(dataset.FieldOfViewRotation) == {"L": "0", "R": "180"}[view.laterality]


def test_the_positioner_angle_has_the_sign_of_the_side():
    assert positioner_angle_deg(View("CC", "L")) == 0.0
    assert positioner_angle_deg(View("MLO", "L", 50.0)) == -50.0
    assert positioner_angle_deg(View("MLO", "R", 50.0)) == 50.0
    assert positioner_angle_deg(View("ML", "R")) == 90.0


def test_pixels_come_back_as_they_were(written):
    view = VIEWS[2]
    mammogram = make_mammogram(view)
    np.testing.assert_array_equal(written(view, "processing").pixel_array, mammogram.for_processing)
    np.testing.assert_array_equal(
        written(view, "presentation").pixel_array, mammogram.for_presentation
    )


@pytest.mark.parametrize(("intent", "bits"), [("processing", 14), ("presentation", 12)])
def test_the_full_range_survives_and_bits_stored_is_its(written, intent, bits):
    top = 2**bits - 1
    extremes = np.array([[0, 1], [top - 1, top]], dtype=np.uint16)
    gantry = dataclasses.replace(make_mammogram(VIEWS[0]).gantry, rows=2, columns=2)
    dataset = written(VIEWS[0], intent, gantry=gantry, **{f"for_{intent}": extremes})
    assert (dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit) == (16, bits, bits - 1)
    np.testing.assert_array_equal(dataset.pixel_array, extremes)
    with pytest.raises(ValueError, match=f"found {top + 1}, expected at most {top}"):
        written(VIEWS[0], intent, gantry=gantry, **{f"for_{intent}": extremes + np.uint16(1)})


def test_itk_reads_the_pixels_as_it_turns_them(written):
    """ITK shows MONOCHROME1 as 2^BitsStored - 1 - v; with the exact bits nothing else happens."""
    view = VIEWS[0]
    mammogram = make_mammogram(view)
    raw = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(written(view, "processing").filename))
    np.testing.assert_array_equal(raw.squeeze(), 2**14 - 1 - mammogram.for_processing.astype(int))
    shown = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(written(view, "presentation").filename))
    np.testing.assert_array_equal(shown.squeeze(), mammogram.for_presentation)


def test_a_hanging_protocol_finds_each_view(written):
    """Both intents of four views: each slot shows its own view, for presentation."""
    views = [View(name, side) for name in ("MLO", "CC") for side in "LR"]
    exam = [written(view, intent) for view in views for intent in INTENTS]
    shown = hang(exam)
    for slot, dataset in shown.items():
        assert dataset.ImageLaterality + dataset.ViewPosition == slot
        assert dataset.PresentationIntentType == "FOR PRESENTATION"
    numbered = sorted(exam, key=lambda dataset: int(dataset.SeriesNumber))
    assert [dataset.SeriesDescription for dataset in numbered] == [
        "R CC", "L CC", "R MLO", "L MLO", "R CC for processing", "L CC for processing",
        "R MLO for processing", "L MLO for processing",
    ]  # fmt: skip


def test_views_with_a_name_of_their_own_hang_after_the_usual_ones(written):
    """A spot view of the right breast takes no slot, whatever is written first."""
    usual = [View(name, side) for name in ("CC", "MLO") for side in "RL"]
    spot = View("CC", "R", title="CC_spot", spot=True)
    exam = [written(view, intent) for view in [spot, *usual] for intent in INTENTS]
    shown = hang(exam)
    assert [slot for slot, dataset in shown.items() if "spot" in dataset.SeriesDescription] == []
    assert exam[0].SeriesDescription.startswith("R CC CC_spot")
    assert exam[0].SOPInstanceUID != exam[2].SOPInstanceUID


@pytest.mark.parametrize(
    ("spot", "support_mm", "codes"),
    [
        (False, 15.0, []),
        (True, 15.0, ["399055006"]),
        (False, 285.0, ["399163009"]),  # 650 / 365: 1.8 times
        (True, 285.0, ["399055006", "399163009"]),
    ],
)
def test_spot_and_magnified_views_are_coded(written, spot, support_mm, codes):
    view = View("CC", "L", spot=spot)
    gantry = dataclasses.replace(make_mammogram(view).gantry, support_to_detector_mm=support_mm)
    dataset = written(view, "presentation", gantry=gantry)
    modifiers = dataset.ViewCodeSequence[0].ViewModifierCodeSequence
    assert [item.CodeValue for item in modifiers] == codes
    assert {item.CodingSchemeDesignator for item in modifiers} <= {"SCT"}
    assert dataset.ViewPosition == "CC"
    magnification = float(dataset.EstimatedRadiographicMagnificationFactor)
    assert magnification == pytest.approx(650 / (650 - support_mm), rel=1e-5)


def test_draws_of_the_noise_are_instances_of_one_series(tmp_path):
    mammogram = make_mammogram(VIEWS[0])
    drawn = {}
    for draw in (1, 2):
        for intent in INTENTS:
            path = tmp_path / f"{intent}_{draw}.dcm"
            write_dicom(mammogram, intent, path, STUDY, SETTINGS, draw)
            drawn[intent, draw] = pydicom.dcmread(path)
    first, second = drawn["presentation", 1], drawn["presentation", 2]
    assert first.SeriesInstanceUID == second.SeriesInstanceUID
    assert (first.InstanceNumber, second.InstanceNumber) == (1, 2)
    assert first.SOPInstanceUID != second.SOPInstanceUID
    assert first.IrradiationEventUID != second.IrradiationEventUID
    for draw in (1, 2):
        source = drawn["presentation", draw].SourceImageSequence[0]
        assert source.ReferencedSOPInstanceUID == drawn["processing", draw].SOPInstanceUID


def test_the_patient_is_who_the_settings_say(tmp_path):
    patient = PatientSettings(
        id="A-17", name="Doe^Jane", birth_date="1949-03-01", sex="F", accession="ACC 9",
        study_description="Screening",
    )  # fmt: skip
    study = StudyIdentity(STUDY.run_hash, "run", patient)
    path = tmp_path / "a.dcm"
    write_dicom(make_mammogram(VIEWS[0]), "presentation", path, study, SETTINGS)
    dataset = pydicom.dcmread(path)
    assert (dataset.PatientID, str(dataset.PatientName)) == ("A-17", "Doe^Jane")
    assert (dataset.PatientBirthDate, dataset.PatientAge) == ("19490301", "050Y")
    assert (dataset.AccessionNumber, dataset.StudyDescription) == ("ACC 9", "Screening")
    assert "PatientAge" not in mammogram_dataset(
        make_mammogram(VIEWS[0]), "presentation", STUDY, SETTINGS
    )


def test_the_unit_is_described(written):
    measures = {"pressure_kpa": 11.24, "contact_area_mm2": 8123.4, "exposure_index": 412.3}
    dataset = written(
        VIEWS[0], "presentation", detector="CsI-100", focal_spot_mm=0.3, measures=measures,
        automatic_exposure=False,
    )  # fmt: skip
    assert dataset.DetectorType == "SCINTILLATOR"
    assert dataset.FocalSpots == 0.3
    assert dataset.ExposureControlMode == "MANUAL"
    assert dataset.RelativeXRayExposure == 412
    assert float(dataset.CompressionPressure) == 11.24
    assert float(dataset.CompressionContactArea) == 8123.4
    assert dataset.StationName == "MAMMOSIM"
    # Time and current give the tube load back, to the rounding of whole milliseconds.
    load_mas = dataset.ExposureTime * dataset.XRayTubeCurrent / 1e3
    assert load_mas == pytest.approx(90.123, abs=0.06)
    small = written(VIEWS[0], "presentation", focal_spot_mm=0.1)
    assert (dataset.XRayTubeCurrent, small.XRayTubeCurrent) == (100, 25)
    assert small.ExposureTime == pytest.approx(4.0 * dataset.ExposureTime, abs=2)
    assert "VOILUTFunction" not in dataset
    assert written(VIEWS[0], "processing", detector="a-Se-70").DetectorType == "DIRECT"


def test_gland_is_white_in_both_intents(written):
    """Raw pixels fall with tissue and are shown inverted; those for reading rise with it."""
    raw, shown = written(VIEWS[0], "processing"), written(VIEWS[0], "presentation")
    assert (raw.PhotometricInterpretation, raw.PresentationLUTShape) == ("MONOCHROME1", "INVERSE")
    assert (raw.PixelIntensityRelationship, raw.PixelIntensityRelationshipSign) == ("LIN", 1)
    assert "WindowCenter" not in raw
    assert (shown.PhotometricInterpretation, shown.PresentationLUTShape) == (
        "MONOCHROME2", "IDENTITY",
    )  # fmt: skip
    assert (shown.PixelIntensityRelationship, shown.PixelIntensityRelationshipSign) == ("LOG", -1)
    assert (shown.WindowCenter, shown.WindowWidth) == (2200, 2400)
    assert shown.SourceImageSequence[0].ReferencedSOPInstanceUID == raw.SOPInstanceUID


def test_technique_is_in_dicoms_units(written):
    dataset = written(VIEWS[0], "processing")
    assert dataset.KVP == 28
    assert dataset.ExposureInuAs == 90123
    assert dataset.Exposure == 90
    assert (dataset.AnodeTargetMaterial, dataset.FilterMaterial) == ("TUNGSTEN", "RHODIUM")
    assert dataset.FilterThicknessMaximum == 0.05
    assert float(dataset.OrganDose) == pytest.approx(0.014567, abs=1e-9)  # dGy; six digits written
    assert dataset.EntranceDoseInmGy == 5.31
    assert dataset.HalfValueLayer == 0.525
    assert dataset.BodyPartThickness == THICKNESS_MM
    assert dataset.CompressionForce == 91.3
    assert list(dataset.Grid) == ["RECIPROCATING", "FOCUSED"]


def test_what_is_not_known_is_left_out(written):
    dataset = written(VIEWS[0], "processing", force_n=float("nan"), grid=False, filter="Xy")
    assert "CompressionForce" not in dataset
    assert dataset.Grid == "NONE"
    assert dataset.FilterMaterial == "XY"


def test_spacing_is_the_detectors_and_the_supports(written):
    dataset = written(VIEWS[0], "presentation")
    assert list(dataset.ImagerPixelSpacing) == [0.5, 0.5]
    assert dataset.DistanceSourceToDetector == 650
    assert dataset.DistanceSourceToPatient == 635
    magnification = float(dataset.EstimatedRadiographicMagnificationFactor)
    assert magnification == pytest.approx(650 / 635, rel=1e-5)  # written with six digits
    assert float(dataset.PixelSpacing[0]) == pytest.approx(0.5 / magnification, rel=2e-6)
    assert dataset.PixelSpacingCalibrationType == "GEOMETRY"
    assert list(dataset.FieldOfViewDimensions) == [120, 60]


def test_every_decimal_string_fits(written):
    awkward = {"mas": 90.0 / 7.0, "dose_mgy": 1e-5 / 3.0, "window_center": 1e5 / 7.0}
    dataset = written(VIEWS[2], "presentation", **awkward)
    decimals = [element for element in dataset.iterall() if element.VR == "DS"]
    assert len(decimals) > 15
    for element in decimals:
        values = element.value if element.VM > 1 else [element.value]
        assert all(len(str(value)) <= 16 for value in values), element


def test_the_file_says_that_no_patient_was_imaged(written):
    dataset = written(VIEWS[0], "presentation")
    assert "Simulated" in str(dataset.PatientName)
    assert dataset.PatientID.startswith("SIMULATED")
    assert "No patient was imaged" in dataset.DerivationDescription


def test_reruns_are_identical_and_other_runs_are_not(tmp_path):
    mammogram = make_mammogram(VIEWS[0])

    def bytes_of(study: StudyIdentity) -> bytes:
        write_dicom(mammogram, "processing", tmp_path / "image.dcm", study, SETTINGS)
        return (tmp_path / "image.dcm").read_bytes()

    assert bytes_of(STUDY) == bytes_of(StudyIdentity(STUDY.run_hash))
    assert bytes_of(STUDY) != bytes_of(StudyIdentity("another"))


def test_objects_of_a_run_share_the_study_and_nothing_more(written):
    datasets = [written(view, intent) for view in VIEWS[:4] for intent in INTENTS]
    assert len({dataset.StudyInstanceUID for dataset in datasets}) == 1
    assert len({dataset.PatientID for dataset in datasets}) == 1
    assert len({dataset.SeriesInstanceUID for dataset in datasets}) == len(datasets)
    assert len({dataset.SOPInstanceUID for dataset in datasets}) == len(datasets)
    assert all(dataset.SOPInstanceUID.is_valid for dataset in datasets)


def test_the_date_is_that_of_the_settings(tmp_path):
    settings = ExportSettings(date="20240229")
    write_dicom(make_mammogram(VIEWS[0]), "processing", tmp_path / "a.dcm", STUDY, settings)
    dataset = pydicom.dcmread(tmp_path / "a.dcm")
    dates = {str(element.value) for element in dataset.iterall() if element.VR == "DA"}
    assert dates == {"20240229", ""}  # the birth date is empty
