"""Volumes in patient space: every voxel and vector is where it was in the breast."""

from __future__ import annotations

import resource
import signal

import numpy as np
import pytest
import SimpleITK as sitk
from make_records import make_compressed

from mammosim.errors import InputError
from mammosim.export import write_displacement, write_labels
from mammosim.export.volumes import _place, x_fastest
from mammosim.geometry import View, VoxelFrame

VIEWS = [View(name, side) for name in ("CC", "MLO", "ML") for side in "LR"]
FRAME = VoxelFrame(np.array([3.0, -7.5, 11.0]), np.array([0.5, 1.0, 2.0]), (4, 5, 6))
TOLERANCE_MM = 1e-4  # NIfTI keeps its geometry in 32-bit floats


def lps(breast_point) -> np.ndarray:
    """Breast frame to left-posterior-superior, written out once more by hand."""
    x_anterior, y_left, z_superior = breast_point
    return np.array([y_left, -x_anterior, z_superior])


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_labels_lie_at_their_place_in_the_patient(tmp_path, view):
    labels = np.arange(120, dtype=np.uint8).reshape(4, 5, 6)
    write_labels(labels, FRAME, view.rotation, tmp_path / "compressed.nii.gz")
    image = sitk.ReadImage(str(tmp_path / "compressed.nii.gz"))
    assert image.GetPixelID() == sitk.sitkUInt8
    assert image.GetSize() == (4, 5, 6)
    for index in [(0, 0, 0), (3, 0, 0), (0, 4, 0), (0, 0, 5), (2, 3, 4)]:
        in_breast = view.rotation.T @ FRAME.position_mm(index)
        found = image.TransformIndexToPhysicalPoint(index)
        np.testing.assert_allclose(found, lps(in_breast), atol=TOLERANCE_MM)
        assert image.GetPixel(index) == labels[index]


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_axes_are_right_handed_and_the_nipple_is_anterior(tmp_path, view):
    write_labels(np.zeros((4, 5, 6), np.uint8), FRAME, view.rotation, tmp_path / "c.nii.gz")
    direction = np.reshape(sitk.ReadImage(str(tmp_path / "c.nii.gz")).GetDirection(), (3, 3))
    assert np.linalg.det(direction) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(direction[:, 0], [0.0, -1.0, 0.0], atol=1e-6)  # x to anterior


def test_the_plates_normal_points_superiorly_and_medially(tmp_path):
    """At 45 degrees: towards the patient's right from a left breast, and the other way round."""
    for side, medial in (("L", -1.0), ("R", 1.0)):
        path = tmp_path / "c.nii.gz"
        write_labels(np.zeros((4, 5, 6), np.uint8), FRAME, View("MLO", side).rotation, path)
        direction = np.reshape(sitk.ReadImage(str(path)).GetDirection(), (3, 3))
        half = np.sqrt(0.5)
        np.testing.assert_allclose(direction[:, 2], [medial * half, 0.0, half], atol=1e-6)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.folder)
def test_a_vector_leads_from_the_uncompressed_to_the_compressed_point(tmp_path, view):
    field = make_compressed(view).field
    write_displacement(field, tmp_path / "displacement.nii.gz")
    image = sitk.ReadImage(str(tmp_path / "displacement.nii.gz"), sitk.sitkVectorFloat64)
    transform = sitk.DisplacementFieldTransform(image)
    for index in [(2, 9, 14), (7, 12, 8), (9, 11, 11)]:
        before = field.frame.position_mm(index)
        after = before + field.displacement_mm[index]
        moved = transform.TransformPoint(lps(view.rotation.T @ before))
        np.testing.assert_allclose(moved, lps(view.rotation.T @ after), atol=TOLERANCE_MM)


def test_vectors_are_32_bit_with_three_components(tmp_path):
    write_displacement(make_compressed(VIEWS[0]).field, tmp_path / "d.nii.gz")
    image = sitk.ReadImage(str(tmp_path / "d.nii.gz"))
    assert image.GetPixelID() == sitk.sitkVectorFloat32
    assert image.GetNumberOfComponentsPerPixel() == 3


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.float32])
def test_layer_by_layer_is_what_itk_writes_at_once(tmp_path, monkeypatch, kind):
    monkeypatch.setattr("mammosim.export.volumes._BYTES_AT_ONCE", 1 << 14)
    values = np.random.default_rng(5).integers(0, 90, (70, 66, 9)).astype(kind)
    frame, rotation = VoxelFrame(FRAME.origin_mm, FRAME.spacing_mm, values.shape), VIEWS[2].rotation
    write_labels(values, frame, rotation, tmp_path / "c.nii")
    image = sitk.GetImageFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)))
    _place(image, frame, rotation)
    sitk.WriteImage(image, str(tmp_path / "itk.nii"))
    assert (tmp_path / "c.nii").read_bytes() == (tmp_path / "itk.nii").read_bytes()
    np.testing.assert_array_equal(x_fastest(values), values.transpose(2, 1, 0))


def test_reruns_are_identical_and_the_archive_has_no_time(tmp_path):
    for name in ("a", "b"):
        write_displacement(make_compressed(VIEWS[0]).field, tmp_path / f"{name}.nii.gz")
    content = (tmp_path / "a.nii.gz").read_bytes()
    assert content == (tmp_path / "b.nii.gz").read_bytes()
    assert content[4:8] == bytes(4)  # MTIME of RFC 1952


def test_a_file_that_breaks_off_is_an_error_and_leaves_nothing(tmp_path):
    labels = np.random.default_rng(1).integers(0, 255, (40, 40, 40)).astype(np.uint8)
    frame = VoxelFrame(np.zeros(3), np.ones(3), (40, 40, 40))
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    old_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, old_limit[1]))
    try:
        with pytest.raises(InputError, match=r"c\.nii\.gz: cannot be written \(.+\)"):
            write_labels(labels, frame, np.eye(3), tmp_path / "c.nii.gz")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old_limit)
        signal.signal(signal.SIGXFSZ, old_handler)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file_is_an_error(tmp_path):
    (tmp_path / "LCC").write_text("")
    with pytest.raises(InputError, match=r"LCC/c\.nii\.gz: cannot be written"):
        write_labels(np.zeros((4, 5, 6), np.uint8), FRAME, np.eye(3), tmp_path / "LCC/c.nii.gz")
