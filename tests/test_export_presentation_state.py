"""Outlines and names of lesions for viewers that show no masks."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pydicom
import pytest
from make_records import make_mammogram, make_paths, make_targets

from mammosim.export import ExportSettings, StudyIdentity
from mammosim.export.dicom import mammogram_dataset
from mammosim.export.lesion_masks import lesion_masks
from mammosim.export.presentation_state import outlines, write_presentation_state
from mammosim.geometry import View

STUDY, SETTINGS = StudyIdentity("0123456789abcdef" * 4), ExportSettings()
VIEWS = [View(name, side) for name in ("CC", "MLO") for side in "LR"]


def write(view, path):
    masks = lesion_masks(make_paths(view), make_targets(view))
    write_presentation_state(masks, make_mammogram(view), path, STUDY, SETTINGS)
    return masks, pydicom.dcmread(path)


def test_an_outline_encloses_its_mask():
    row, column = np.mgrid[:40, :50]
    mask = (row - 21.0) ** 2 + (column - 30.0) ** 2 <= 9.0**2
    mask[2:4, 5] = True
    lines = sorted(outlines(mask), key=len)
    assert [len(line) > 4 for line in lines] == [True, True]
    np.testing.assert_allclose(lines[0].mean(axis=0), [5.0, 2.5], atol=0.2)
    for line, (low, high) in zip(
        lines, [((4.5, 1.5), (5.5, 3.5)), ((20.5, 11.5), (39.5, 30.5))], strict=True
    ):
        np.testing.assert_allclose(line[0], line[-1])  # closed
        np.testing.assert_allclose([line.min(axis=0), line.max(axis=0)], [low, high], atol=0.01)


@pytest.mark.skipif(
    shutil.which("dciodvfy") is None, reason="dciodvfy (Debian package dicom3tools) is missing"
)
@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_the_validator_finds_no_error(tmp_path, view):
    write(view, tmp_path / "state.dcm")
    command = ["dciodvfy", str(tmp_path / "state.dcm")]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    said = (result.stdout + result.stderr).splitlines()
    assert "GrayscaleSoftcopyPresentationState" in "".join(said)
    assert [line for line in said if "Error" in line] == []


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_each_lesion_is_outlined_and_named_on_its_own_image(tmp_path, view):
    masks, state = write(view, tmp_path / "state.dcm")
    image = mammogram_dataset(make_mammogram(view), "presentation", STUDY, SETTINGS)
    named = {lesion.target.name: lesion for lesion in masks if lesion.mask.any()}
    assert len(state.GraphicAnnotationSequence) == len(named)
    for annotation in state.GraphicAnnotationSequence:
        referenced = annotation.ReferencedImageSequence[0]
        assert referenced.ReferencedSOPInstanceUID == image.SOPInstanceUID
        lesion = named.pop(annotation.TextObjectSequence[0].UnformattedTextValue)
        points = np.concatenate(
            [
                np.reshape(graphic.GraphicData, (-1, 2))
                for graphic in annotation.GraphicObjectSequence
            ]
        )
        rows, columns = np.nonzero(lesion.mask)
        # DICOM's pixels count from 1, and an outline runs half a pixel outside of them.
        low, high = points.min(axis=0), points.max(axis=0)
        np.testing.assert_allclose(low, [columns.min() + 0.5, rows.min() + 0.5], atol=0.01)
        np.testing.assert_allclose(high, [columns.max() + 1.5, rows.max() + 1.5], atol=0.01)
    assert named == {}
    assert state.SeriesDescription == f"{view.laterality} {view.name} lesion outlines"


def test_a_lesion_that_the_edge_of_the_image_cuts_is_outlined_up_to_it(tmp_path):
    view = VIEWS[0]
    masks = lesion_masks(make_paths(view), make_targets(view))
    lesion = next(lesion for lesion in masks if lesion.mask.any())
    everywhere = replace(lesion, mask=np.ones_like(lesion.mask))
    path = tmp_path / "state.dcm"
    write_presentation_state([everywhere], make_mammogram(view), path, STUDY, SETTINGS)
    (annotation,) = pydicom.dcmread(path).GraphicAnnotationSequence
    points = np.reshape(annotation.GraphicObjectSequence[0].GraphicData, (-1, 2))
    np.testing.assert_allclose(points.min(axis=0), [0.5, 0.5])
    np.testing.assert_allclose(points.max(axis=0), lesion.mask.shape[::-1])


def test_reruns_are_identical(tmp_path):
    write(VIEWS[0], tmp_path / "a.dcm")
    write(VIEWS[0], tmp_path / "b.dcm")
    assert (tmp_path / "a.dcm").read_bytes() == (tmp_path / "b.dcm").read_bytes()
