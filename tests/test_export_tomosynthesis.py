"""DICOM objects of tomosynthesis: frames, geometry of each, and where slices lie in the patient."""

import shutil
import subprocess

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from make_run import FEW_PHOTONS
from naive.projection import phantom

from mammosim.acquisition import expose_arc
from mammosim.compression import compress
from mammosim.export import (
    ExportSettings,
    StudyIdentity,
    reconstruction_geometry,
    series_geometry,
    slice_masks,
    write_reconstruction,
    write_series,
)
from mammosim.phantom import Lesion
from mammosim.projection import project_arc
from mammosim.reconstruction import Reconstruction, ReconstructionSettings, Synthetic, volume_grid
from mammosim.targets import find_targets, in_volume

ANGLES = 20.0
# Two by two voxels of 5 mm in the plane, one of 8 mm in height: x 15 to 25, y -5 to 5, z 16 to 24.
BLOCK = Lesion("block", "mass", 211, "mass", np.array([20.0, 0.0, 20.0]), 800.0, 1.0)


@pytest.fixture(scope="module")
def view(tmp_path_factory):
    """A slab of fat from three angles, and slices whose values count up."""
    labels = np.full((8, 14, 5), 1, np.uint8)
    labels[3:5, 6:8, 2] = BLOCK.label
    block = phantom(labels, [5.0, 5.0, 8.0], [2.5, -32.5, 4.0], lesions=(BLOCK,))
    breast = compress(block, model="none")
    arc = project_arc(
        breast,
        {"projections": 3, "angle_range_deg": ANGLES, "detector_angle_range_deg": 4.0,
         "shares": [1, 2, 1]},
        pixel_mm=2.0, detector_mm=[150.0, 60.0],
    )  # fmt: skip
    series = expose_arc(arc, mas=60.0, **FEW_PHOTONS)
    grid = volume_grid(series.middle.gantry, 40.0, 4.0)
    slices = np.linspace(0.01, 0.09, grid.voxels, dtype=np.float32).reshape(grid.shape)
    counting = np.arange(grid.shape[1] * grid.shape[2], dtype=np.uint16).reshape(grid.shape[1:])
    made = Synthetic(counting.astype(np.float32), counting % 4096)
    settings = ReconstructionSettings()
    volume = Reconstruction(slices, grid, series.middle.gantry, settings, made)
    targets = [in_volume(one, grid) for one in find_targets(breast, arc.paths(1))]
    masks = slice_masks(breast, volume, targets)
    folder, study = tmp_path_factory.mktemp("dbt"), StudyIdentity("a1")
    write_series(folder, series, arc.paths(1), (), ExportSettings(), study)
    write_reconstruction(folder, series, volume, masks, ExportSettings(), study)
    return folder, series, volume


def test_each_projection_is_a_frame_with_its_own_angle_and_load(view):
    folder, series, _ = view
    raw = pydicom.dcmread(folder / "projections_for_processing.dcm")
    np.testing.assert_array_equal(raw.pixel_array, series.projections)
    frames = raw.PerFrameFunctionalGroupsSequence
    angles = [float(f.PositionerPositionSequence[0].PositionerPrimaryAngle) for f in frames]
    assert angles == [10.0, 0.0, -10.0]  # the tube goes from the patient's right to her left
    loads = [f.XRayAcquisitionDoseSequence[0].ExposureInmAs for f in frames]
    assert loads == pytest.approx([15.0, 30.0, 15.0])
    dose = sum(float(f.XRayAcquisitionDoseSequence[0].OrganDose) for f in frames)
    assert dose == pytest.approx(series.dose_mgy / 100.0, rel=1e-4)  # dGy, six digits


def test_each_frame_has_the_detector_where_it_was(view):
    """Isocentre's axes: the patient's right (CC), away from the chest wall, up."""
    folder, series, _ = view
    raw = pydicom.dcmread(folder / "projections_for_processing.dcm")
    assert (raw.PositionerMotion, raw.TypeOfDetectorMotion) == ("ROTATION_STEP", "ROTATION_STEP")
    for groups, gantry, angle in zip(
        raw.PerFrameFunctionalGroupsSequence, series.gantries, (2.0, 0.0, -2.0), strict=True
    ):
        beam = groups.DetectorPositionSequence[0]
        # The tube at the patient's right, to which rows count up: the beam goes to lower rows.
        assert float(beam.DetectorSecondaryAngle) == pytest.approx(4.0 * angle, abs=1e-6)
        place = groups.IsocenterReferenceSystemSequence[0]
        assert place.DetectorIsocenterPrimaryAngle == pytest.approx(angle)
        corner = np.array(place.DetectorActiveAreaTLHCPosition)
        along = np.array(place.DetectorActiveAreaOrientation).reshape(2, 3)
        np.testing.assert_allclose(along @ along.T, np.eye(2), atol=1e-6)
        foot = np.array([place[f"Detector{axis}PositionToIsocenter"].value for axis in "XYZ"])
        # The foot of the isocentre lies on the detector, straight below it.
        normal = np.cross(*along)
        assert (foot - corner) @ normal == pytest.approx(0.0, abs=1e-4)
        assert np.linalg.norm(foot) == pytest.approx(50.0, abs=1e-4)
        pixel = corner + 2.0 * (3.5 * along[0] + 10.5 * along[1])  # of 2 mm
        x, y, z = gantry.detector_mm(10, 3)
        expected = [gantry.focal_spot_y_mm - y, x, z - (50.0 - 15.0)]
        np.testing.assert_allclose(pixel, expected, atol=1e-4)


def test_the_record_has_the_pixels_of_every_projection(view):
    series = view[1]
    known = series_geometry(series)
    assert known["detector"] == "turning"
    for taken, gantry in zip(known["projections"], series.gantries, strict=True):
        assert taken["detector_angle_deg"] == pytest.approx(gantry.detector_angle_deg)
        first, down, right = (
            np.array(taken[key]) for key in ("first_pixel_mm", "row_step_mm", "column_step_mm")
        )
        np.testing.assert_allclose(
            first + 7 * down + 9 * right, gantry.detector_mm(7, 9), atol=2e-5
        )


def test_projections_for_reading_show_attenuation_with_one_scale(view):
    folder, series, _ = view
    shown = pydicom.dcmread(folder / "projections_for_presentation.dcm")
    pixels = shown.pixel_array.astype(float)
    slope = [
        np.polyfit(np.maximum(series.attenuation(k), 0.0).ravel(), pixels[k].ravel(), 1)[0]
        for k in range(3)
    ]
    assert slope == pytest.approx([slope[0]] * 3, rel=1e-3)
    source = shown.SharedFunctionalGroupsSequence[0].DerivationImageSequence[0]
    raw = pydicom.dcmread(folder / "projections_for_processing.dcm")
    assert source.SourceImageSequence[0].ReferencedSOPInstanceUID == raw.SOPInstanceUID


def test_slices_lie_in_the_patient_as_the_nifti_volume_does(view):
    folder, _, volume = view
    stored = pydicom.dcmread(folder / "reconstruction.dcm")
    image = sitk.ReadImage(str(folder / "reconstruction.nii.gz"))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), volume.slices)
    shared = stored.SharedFunctionalGroupsSequence[0]
    along = np.array(shared.PlaneOrientationSequence[0].ImageOrientationPatient, float)
    spacing = np.array(shared.PixelMeasuresSequence[0].PixelSpacing, float)
    for frame in (0, 3):
        groups = stored.PerFrameFunctionalGroupsSequence[frame]
        corner = np.array(groups.PlanePositionSequence[0].ImagePositionPatient, float)
        place = corner + 7 * spacing[1] * along[:3] + 5 * spacing[0] * along[3:]
        expected = image.TransformIndexToPhysicalPoint((7, 5, frame))
        np.testing.assert_allclose(place, expected, atol=1e-4)
    # A left CC picture: rows run to the nipple, which is anterior; columns to the patient's right.
    np.testing.assert_allclose(along, [0, -1, 0, -1, 0, 0], atol=1e-9)


def test_the_segmentation_marks_the_voxels_of_the_lesion(view):
    """Their places, by the file's own geometry, are in the block, and all of it is marked."""
    folder, _, volume = view
    stored = pydicom.dcmread(folder / "reconstruction_lesions.dcm")
    (segment,) = stored.SegmentSequence
    assert segment.SegmentLabel == "block"
    shared = stored.SharedFunctionalGroupsSequence[0]
    along = np.array(shared.PlaneOrientationSequence[0].ImageOrientationPatient, float)
    spacing = np.array(shared.PixelMeasuresSequence[0].PixelSpacing, float)
    places = []
    frames = np.atleast_3d(stored.pixel_array).reshape(-1, stored.Rows, stored.Columns)
    for groups, mask in zip(stored.PerFrameFunctionalGroupsSequence, frames, strict=True):
        corner = np.array(groups.PlanePositionSequence[0].ImagePositionPatient, float)
        for row, column in np.argwhere(mask):
            step = column * spacing[1] * along[:3] + row * spacing[0] * along[3:]
            places.append(corner + step)
    left, posterior, superior = np.array(places).T  # LPS
    x, y, z = -posterior, left, superior
    for axis, low, high in ((x, 15.0, 25.0), (y, -5.0, 5.0), (z, 16.0, 24.0)):
        assert axis.min() >= low - 1e-6
        assert axis.max() <= high + 1e-6
    voxel_mm3 = volume.grid.slice_mm * volume.grid.pixel_mm**2
    assert len(places) * voxel_mm3 == pytest.approx(800.0, rel=0.25)  # whole voxels of 2 x 2 x 4 mm


def test_a_comment_says_what_a_pixel_value_is(view):
    folder, _, volume = view
    stored = pydicom.dcmread(folder / "reconstruction.dcm")
    words = stored.ImageComments.split(": ")[1].split()
    low, step = float(words[0]), float(words[2])
    inside = (volume.slices > low) & (volume.slices < low + 4095 * step)
    assert inside.mean() > 0.4
    found = low + step * stored.pixel_array
    np.testing.assert_allclose(found[inside], volume.slices[inside], atol=0.51 * step + 1e-6)


def test_the_synthetic_picture_says_what_it_is_and_whose(view):
    folder, series, volume = view
    stored = pydicom.dcmread(folder / "synthetic_2d.dcm")
    assert list(stored.ImageType) == ["DERIVED", "PRIMARY", "", "GENERATED_2D"]
    assert "not a manufacturer's method" in stored.ImageComments
    np.testing.assert_array_equal(stored.pixel_array, volume.synthetic.pixels)
    assert [float(step) for step in stored.PixelSpacing] == [volume.grid.pixel_mm] * 2
    raw = pydicom.dcmread(folder / "projections_for_processing.dcm")
    (source,) = stored.SourceImageSequence
    assert source.ReferencedSOPInstanceUID == raw.SOPInstanceUID
    assert source.ReferencedSOPClassUID == raw.SOPClassUID
    # Load and dose are those of all projections.
    assert float(stored.OrganDose) == pytest.approx(series.dose_mgy / 100.0, rel=1e-4)
    assert int(stored.Exposure) == round(series.mas)
    assert (folder / "synthetic_2d.png").exists()
    assert reconstruction_geometry(volume)["synthetic"]["by"] == "mammosim; no manufacturer's"


@pytest.mark.skipif(shutil.which("dciodvfy") is None, reason="dciodvfy is not installed")
@pytest.mark.parametrize(
    "name",
    [
        "projections_for_processing",
        "projections_for_presentation",
        "reconstruction",
        "reconstruction_lesions",
        "synthetic_2d",
    ],
)
def test_the_objects_have_no_errors(view, name):
    checked = subprocess.run(
        ["dciodvfy", view[0] / f"{name}.dcm"], capture_output=True, text=True, check=False
    )
    said = checked.stdout + checked.stderr
    assert said.split()[0] in (
        "BreastProjectionXRayImage",
        "BreastTomosynthesisImage",
        "MammographyImageForPresentation",
        "Segmentation",
    )
    assert [line for line in said.splitlines() if line.startswith("Error")] == []
