"""The structured report: valid, readable by others, one with the segmentation and the table."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pydicom
import pytest
from make_records import PIXEL_MM, make_mammogram, make_paths, make_targets

from mammosim.export import (
    ExportSettings,
    LesionMask,
    StudyIdentity,
    lesion_masks,
    write_dicom,
    write_measurements,
    write_segmentation,
)
from mammosim.geometry import View

STUDY = StudyIdentity("0f1e2d3c4b5a6978" * 4)
SETTINGS = ExportSettings()
VIEWS = [View(name, side) for name in ("CC", "MLO") for side in "LR"]


def write(view: View, folder, masks=None):
    masks = lesion_masks(make_paths(view), make_targets(view)) if masks is None else masks
    path = folder / "lesion_measurements.dcm"
    write_measurements(masks, make_mammogram(view), path, STUDY, SETTINGS)
    return masks, pydicom.dcmread(path)


def items(container, meaning):
    """Content items below a container whose concept has this meaning, in order."""
    found = []
    for item in container.ContentSequence:
        if item.ConceptNameCodeSequence[0].CodeMeaning == meaning:
            found.append(item)
        if "ContentSequence" in item:
            found += items(item, meaning)
    return found


@pytest.mark.skipif(
    shutil.which("dciodvfy") is None,
    reason="dciodvfy and dcsrdump (Debian package dicom3tools) are not installed",
)
@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_the_validator_finds_nothing_and_a_reader_the_template(tmp_path, view):
    write(view, tmp_path)
    path = str(tmp_path / "lesion_measurements.dcm")
    said = subprocess.run(["dciodvfy", path], capture_output=True, text=True, check=False)
    lines = (said.stdout + said.stderr).splitlines()
    assert "ComprehensiveSR" in lines[0]
    assert [line for line in lines if "Error" in line or "Warning" in line] == []
    shown = subprocess.run(["dcsrdump", path], capture_output=True, text=True, check=False)
    text = shown.stdout + shown.stderr
    assert '(126000,DCM,"Imaging Measurement Report")' in text
    assert "(DCMR,1500)" in text
    assert text.count("(DCMR,1410)") == 3


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_numbers_and_ids_are_those_of_masks_and_table(tmp_path, view):
    masks, report = write(view, tmp_path)
    *groups, density = items(report, "Measurement Group")
    share = items(density, "Percent Fibroglandular Tissue")[0].MeasuredValueSequence[0]
    assert float(share.NumericValue) == 17.3
    gantry = make_mammogram(view).gantry
    spacing_mm = PIXEL_MM * (1.0 - gantry.support_to_detector_mm / gantry.source_to_detector_mm)
    for lesion, group in zip(masks, groups, strict=True):
        identifier = items(group, "Tracking Identifier")[0].TextValue
        assert identifier == f"{lesion.target.target_id} {lesion.target.name}"
        area = items(group, "Area")[0].MeasuredValueSequence[0]
        # Written with four decimals, in the scale of the image's Pixel Spacing.
        expected = lesion.mask.sum() * spacing_mm**2
        assert float(area.NumericValue) == pytest.approx(expected, abs=5e-5)
        assert area.MeasurementUnitsCodeSequence[0].CodeValue == "mm2"
        volume = items(group, "Volume")[0].MeasuredValueSequence[0]
        # Written with four decimals.
        assert float(volume.NumericValue) == pytest.approx(lesion.target.volume_mm3, abs=5e-5)


def test_it_refers_to_the_segmentations_frames_and_the_image(tmp_path):
    view = VIEWS[2]
    masks, report = write(view, tmp_path)
    write_segmentation(masks, make_mammogram(view), tmp_path / "seg.dcm", STUDY, SETTINGS)
    write_dicom(make_mammogram(view), "presentation", tmp_path / "i.dcm", STUDY, SETTINGS)
    segmentation = pydicom.dcmread(tmp_path / "seg.dcm")
    image = pydicom.dcmread(tmp_path / "i.dcm")
    for number, group in enumerate(items(report, "Measurement Group")[:-1]):  # then the density
        frame = items(group, "Referenced Segmentation Frame")[0].ReferencedSOPSequence[0]
        assert frame.ReferencedSOPInstanceUID == segmentation.SOPInstanceUID
        shown = segmentation.pixel_array[frame.ReferencedFrameNumber - 1]
        np.testing.assert_array_equal(shown == 1, masks[number].mask)
        source = items(group, "Source Image for Segmentation")[0].ReferencedSOPSequence[0]
        assert source.ReferencedSOPInstanceUID == image.SOPInstanceUID
        tracked = items(group, "Tracking Unique Identifier")[0].UID
        assert tracked == segmentation.SegmentSequence[number].TrackingUID
    assert report.StudyInstanceUID == image.StudyInstanceUID
    assert "Simulated" in str(report.PatientName)


def test_lesions_outside_the_image_are_left_out(tmp_path):
    view = VIEWS[0]
    masks = lesion_masks(make_paths(view), make_targets(view))
    masks[0] = LesionMask(masks[0].target, np.zeros_like(masks[0].mask))
    _, report = write(view, tmp_path, masks)
    groups = items(report, "Measurement Group")[:-1]  # the last is the density's
    assert [items(g, "Tracking Identifier")[0].TextValue[0] for g in groups] == ["2", "3"]


def test_reruns_are_identical(tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    for folder in (first, second):
        folder.mkdir()
        write(VIEWS[0], folder)
    contents = [(folder / "lesion_measurements.dcm").read_bytes() for folder in (first, second)]
    assert contents[0] == contents[1]
