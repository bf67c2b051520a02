"""Where lesions appear: masks, label image, DICOM Segmentation."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess

import highdicom as hd
import numpy as np
import pydicom
import pytest
import tifffile
from make_records import LESIONS, make_mammogram, make_paths, make_targets

from mammosim.errors import InputError
from mammosim.export import (
    ExportSettings,
    LesionMask,
    StudyIdentity,
    label_image,
    lesion_masks,
    write_dicom,
    write_lesion_tiff,
    write_segmentation,
)
from mammosim.geometry import View

STUDY = StudyIdentity("fedcba9876543210" * 4)
SETTINGS = ExportSettings()
VIEWS = [View(name, side) for name in ("CC", "MLO") for side in "LR"]
LETTERS = {"A": (1, 0, 0), "P": (-1, 0, 0), "L": (0, 1, 0), "R": (0, -1, 0), "F": (0, 0, -1)}


def masks_of(view: View) -> list[LesionMask]:
    return lesion_masks(make_paths(view), make_targets(view))


def write(view: View, path, masks=None) -> pydicom.Dataset:
    masks = masks_of(view) if masks is None else masks
    write_segmentation(masks, make_mammogram(view), path, STUDY, SETTINGS)
    return pydicom.dcmread(path)


def test_a_mask_is_where_the_lesions_path_length_is():
    paths = make_paths(VIEWS[0])
    for number, lesion in enumerate(masks_of(VIEWS[0])):
        assert lesion.target.name == LESIONS[number][0]
        np.testing.assert_array_equal(lesion.mask, paths.length_mm[number + 2] > 0)
        assert lesion.mask.any()


def test_masks_are_found_by_name_not_by_order():
    shuffled = make_targets(VIEWS[0])[::-1]
    by_id = [lesion.target.target_id for lesion in lesion_masks(make_paths(VIEWS[0]), shuffled)]
    assert by_id == [1, 2, 3]


def test_a_lesion_without_target_is_refused():
    targets = [target for target in make_targets(VIEWS[0]) if target.name != "calcs"]
    with pytest.raises(InputError, match="lesion 'calcs' has no row among the targets"):
        lesion_masks(make_paths(VIEWS[0]), targets)


def test_lesions_of_one_name_are_told_apart_by_label_and_id():
    paths = dataclasses.replace(
        make_paths(VIEWS[0]),
        tissues=("adipose", "gland", "mass", "mass", "mass"),
        lesion_labels=(0, 0, 152, 151, 153),
    )
    targets = [dataclasses.replace(target, name="mass") for target in make_targets(VIEWS[0])]
    masks = lesion_masks(paths, targets)
    assert [lesion.target.target_id for lesion in masks] == [1, 2, 3]
    for lesion, channel in zip(masks, (3, 2, 4), strict=True):
        np.testing.assert_array_equal(lesion.mask, paths.length_mm[channel] > 0)


def test_the_backgrounds_value_is_no_target_id():
    targets = [
        dataclasses.replace(target, target_id=target.target_id - 1)
        for target in make_targets(VIEWS[0])
    ]
    with pytest.raises(InputError, match="lesion 'mass 1': found target_id 0, expected 1 or more"):
        lesion_masks(make_paths(VIEWS[0]), targets)


def test_the_smaller_lesion_lies_on_top_in_the_label_image():
    view = VIEWS[0]
    masks = masks_of(view)
    image = label_image(masks, masks[0].mask.shape)
    both = masks[0].mask & masks[2].mask  # the clip lies in the mass
    assert both.any()
    assert np.all(image[both] == 3)
    np.testing.assert_array_equal(image == 2, masks[1].mask)
    assert image.dtype == np.uint8


def test_ids_beyond_255_need_16_bits():
    lesion = masks_of(VIEWS[0])[0]
    high = LesionMask(dataclasses.replace(lesion.target, target_id=300), lesion.mask)
    image = label_image([high], lesion.mask.shape)
    assert image.dtype == np.uint16
    assert image.max() == 300


def test_without_lesions_the_label_image_is_empty(tmp_path):
    mammogram = make_mammogram(VIEWS[0])
    write_lesion_tiff([], mammogram, tmp_path / "lesion_mask.tif")
    image = tifffile.imread(tmp_path / "lesion_mask.tif")
    assert image.shape == mammogram.for_processing.shape
    assert not image.any()


def test_the_label_image_comes_back(tmp_path):
    masks, mammogram = masks_of(VIEWS[1]), make_mammogram(VIEWS[1])
    write_lesion_tiff(masks, mammogram, tmp_path / "lesion_mask.tif")
    expected = label_image(masks, mammogram.for_processing.shape)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "lesion_mask.tif"), expected)


@pytest.mark.skipif(
    shutil.which("dciodvfy") is None,
    reason="dciodvfy (Debian package dicom3tools) is not installed",
)
@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_the_validator_finds_nothing(tmp_path, view):
    write(view, tmp_path / "lesion_mask.dcm")
    command = ["dciodvfy", str(tmp_path / "lesion_mask.dcm")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    said = (result.stdout + result.stderr).splitlines()
    assert "Segmentation" in said[0]
    assert [line for line in said if "Error" in line or "Warning" in line] == []


def test_masks_come_back_through_an_independent_reader(tmp_path):
    write(VIEWS[3], tmp_path / "lesion_mask.dcm")
    segmentation = hd.seg.segread(tmp_path / "lesion_mask.dcm")
    image = make_mammogram(VIEWS[3])
    write_dicom(image, "presentation", tmp_path / "image.dcm", STUDY, SETTINGS)
    source = pydicom.dcmread(tmp_path / "image.dcm")
    pixels = segmentation.get_pixels_by_source_instance([source.SOPInstanceUID])[0]
    for number, lesion in enumerate(masks_of(VIEWS[3])):
        np.testing.assert_array_equal(pixels[..., number] == 1, lesion.mask)


def test_segments_are_numbered_named_and_coded(tmp_path):
    segments = write(VIEWS[0], tmp_path / "lesion_mask.dcm").SegmentSequence
    assert [item.SegmentNumber for item in segments] == [1, 2, 3]
    assert [item.SegmentLabel for item in segments] == [name for name, *_ in LESIONS]
    assert [item.TrackingID for item in segments] == ["1 mass 1", "2 calcs", "3 clip A"]
    codes = [item.SegmentedPropertyTypeCodeSequence[0].CodeMeaning for item in segments]
    assert codes == ["Mass", "Calcification Cluster", "Clip"]
    assert {item.SegmentAlgorithmType for item in segments} == {"AUTOMATIC"}


def test_any_name_fits_into_a_segment(tmp_path):
    name = "upper\\outer\nMäuse " + "x" * 100
    masks = [
        LesionMask(dataclasses.replace(lesion.target, name=name), lesion.mask)
        for lesion in masks_of(VIEWS[0])
    ]
    label = write(VIEWS[0], tmp_path / "a.dcm", masks).SegmentSequence[0].SegmentLabel
    assert label.startswith("upper/outer Mäuse xxx")
    assert len(label.encode("utf-8")) == 64


def test_a_lesion_is_the_same_one_in_both_views(tmp_path):
    tracked = [
        [item.TrackingUID for item in write(view, tmp_path / f"{view.folder}.dcm").SegmentSequence]
        for view in (View("CC", "L"), View("MLO", "L"))
    ]
    assert tracked[0] == tracked[1]
    assert len(set(tracked[0])) == len(LESIONS)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_orientation_letters_agree_with_the_masks_in_the_file(tmp_path, view):
    """From the second lesion to the first, rows and columns change as the letters say."""
    dataset = write(view, tmp_path / "lesion_mask.dcm")
    first, second = (np.argwhere(frame).mean(axis=0) for frame in dataset.pixel_array[:2])
    step_mm = np.array(LESIONS[0][4]) - np.array(LESIONS[1][4])
    for axis, letters in ((1, dataset.PatientOrientation[0]), (0, dataset.PatientOrientation[1])):
        along = sum(np.dot(step_mm, LETTERS[letter]) for letter in letters)
        assert np.sign(first[axis] - second[axis]) == np.sign(along)


def test_lesions_outside_the_image_keep_their_segment(tmp_path):
    masks = masks_of(VIEWS[0])
    empty = [LesionMask(lesion.target, np.zeros_like(lesion.mask)) for lesion in masks]
    some = write(VIEWS[0], tmp_path / "some.dcm", [empty[0], *masks[1:]])
    assert len(some.SegmentSequence) == 3
    assert some.NumberOfFrames == 2
    none = write(VIEWS[0], tmp_path / "none.dcm", empty)
    assert len(none.SegmentSequence) == 3
    assert not none.pixel_array.any()


def test_reruns_are_identical(tmp_path, monkeypatch):
    write(VIEWS[0], tmp_path / "a.dcm")
    monkeypatch.setattr("highdicom.base.datetime", _Tomorrow)
    write(VIEWS[0], tmp_path / "b.dcm")
    assert (tmp_path / "a.dcm").read_bytes() == (tmp_path / "b.dcm").read_bytes()


class _Tomorrow:
    """Stands in for the module `datetime`, with a clock that is a day ahead."""

    import datetime as _real

    timedelta, timezone = _real.timedelta, _real.timezone

    class datetime(_real.datetime):
        @classmethod
        def now(cls, tz=None):
            return super().now(tz) + _Tomorrow.timedelta(days=1)
