"""The uncompressed breast in a run's folder, and a compressed one carried back onto it."""

from __future__ import annotations

import numpy as np
import pytest
import SimpleITK as sitk
from make_phantom import half_ellipsoid_breast

from mammosim.compression import compress
from mammosim.export import ExportSettings, write_compressed, write_phantom
from mammosim.geometry import View
from mammosim.phantom import LesionSettings, insert_lesions, read_phantom
from mammosim.projection import compressed_labels


def carried_back(folder, view_folder) -> tuple[sitk.Image, sitk.Image]:
    """The uncompressed labels, and the compressed ones resampled onto them as a user does it."""
    before = sitk.ReadImage(str(folder / "uncompressed.nii.gz"))
    compressed = sitk.ReadImage(str(view_folder / "compressed.nii.gz"))
    field = sitk.ReadImage(str(view_folder / "displacement.nii.gz"), sitk.sitkVectorFloat64)
    transform = sitk.DisplacementFieldTransform(field)
    return before, sitk.Resample(compressed, before, transform, sitk.sitkNearestNeighbor)


def dice(before: sitk.Image, after: sitk.Image, label: int) -> float:
    overlap = sitk.LabelOverlapMeasuresImageFilter()
    overlap.Execute(before == label, after == label)
    return overlap.GetDiceCoefficient()


@pytest.mark.parametrize("view", [View("CC", "L"), View("MLO", "L")], ids=lambda view: view.folder)
def test_a_mass_is_carried_back_onto_itself(tmp_path, view):
    """By nearest neighbours twice, so that the last per cent is the size of the voxels."""
    breast = half_ellipsoid_breast(view.laterality, voxel_mm=0.5)
    mass = LesionSettings(
        name="mass", kind="mass", diameter_mm=14, position_mm=(13, 9, 9), margin="smooth"
    )
    breast = insert_lesions(breast, [mass], np.random.default_rng(1))
    compressed = compress(breast, view, model="springs", thickness_mm=36, resolution_mm=3)
    labels, frame = compressed_labels(compressed)
    write_phantom(breast, tmp_path)
    write_compressed(tmp_path / "view", compressed, ExportSettings(), labels, frame)
    before, after = carried_back(tmp_path, tmp_path / "view")
    label = breast.lesions[0].label
    assert dice(before, after, label) > 0.97
    unmoved = sitk.Resample(
        sitk.ReadImage(str(tmp_path / "view" / "compressed.nii.gz")), before, sitk.Transform(),
        sitk.sitkNearestNeighbor,
    )  # fmt: skip
    assert dice(before, unmoved, label) < 0.95


def test_the_volume_is_read_again_with_side_and_names(tmp_path):
    breast = half_ellipsoid_breast("R", voxel_mm=2.0, origin_mm=(-3.0, 5.0, 7.0))
    clip = LesionSettings(name="a clip", kind="clip", position_mm=(15, 30, 30))
    breast = insert_lesions(breast, [clip], np.random.default_rng(1))
    write_phantom(breast, tmp_path)
    again = read_phantom(tmp_path / "uncompressed.nii.gz")
    np.testing.assert_array_equal(again.labels, breast.labels)
    np.testing.assert_allclose(again.origin_mm, breast.origin_mm, atol=1e-4)
    assert (again.laterality, again.compressed) == ("R", None)
    assert [(lesion.name, lesion.fill) for lesion in again.lesions] == [
        ("a clip", pytest.approx(breast.lesions[0].fill))
    ]
    assert "\n151 a_clip " in (tmp_path / "labels.ctbl").read_text()
