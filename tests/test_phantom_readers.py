"""Voxel files in: every format, the frame of each, and what the header says of it."""

from __future__ import annotations

import gzip
import itertools
import re
import zlib
from pathlib import Path

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
import tifffile
from make_volumes import (
    FORMATS,
    ORIGIN,
    OWN_CODES,
    SERIES,
    SPACING,
    save,
    save_itk,
    save_series,
    save_vctx,
    save_victre,
    small_breast,
    vctx_description,
    victre_header,
)

from mammosim.errors import InputError
from mammosim.phantom import PhantomSettings, make_phantom, phantom_summary, read_phantom
from mammosim.phantom.readers import open_voxels
from mammosim.phantom.readers.axes import AXIS_OF_LETTER
from mammosim.phantom.voxels import read_volume
from mammosim.tissues import load_label_map

VICTRE = Path(__file__).parents[2] / "shared" / "data" / "victre" / "p_1.mhd"
needs_victre = pytest.mark.skipif(
    not VICTRE.is_file(), reason=f"the FDA phantom {VICTRE.name} is not beside the repository"
)

NO_PLACE = (".npy", ".tif", ".tiff")
"""Formats that cannot say where the voxels are."""


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if suffix not in OWN_CODES])
def test_every_format_gives_the_same_breast(tmp_path, suffix, zipped):
    breast = read_phantom(save(tmp_path / f"b.{suffix.lstrip('.')}", small_breast(), zipped))
    assert breast.labels.dtype == np.uint8
    assert breast.labels.flags.c_contiguous
    np.testing.assert_array_equal(breast.labels, small_breast())
    if suffix in NO_PLACE:
        assert any("does not give its axis directions" in note for note in breast.notes)
        np.testing.assert_array_equal(breast.origin_mm, 0.0)
    elif suffix != ".vctx":
        # NIfTI keeps its numbers in single precision.
        np.testing.assert_allclose(breast.voxel_mm, SPACING, rtol=1e-6)
        np.testing.assert_allclose(breast.origin_mm, ORIGIN, rtol=1e-6)


@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if suffix not in OWN_CODES])
def test_the_header_alone_tells_the_size(tmp_path, suffix):
    opened = open_voxels(save(tmp_path / f"b.{suffix.lstrip('.')}", small_breast()))
    assert (opened.shape, opened.dtype) == ((7, 9, 11), np.uint8)
    assert all(file.is_file() for file in opened.files)


@pytest.mark.parametrize("step", [2, 3])
@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if suffix not in OWN_CODES])
def test_reduced_voxels_are_some_of_the_whole_at_their_place(tmp_path, suffix, step):
    path = save(tmp_path / f"b.{suffix.lstrip('.')}", small_breast())
    whole, part = read_phantom(path), read_phantom(path, reduce=step)
    start = step // 2
    np.testing.assert_array_equal(part.labels, whole.labels[start::step, start::step, start::step])
    np.testing.assert_allclose(part.voxel_mm, step * whole.voxel_mm)
    np.testing.assert_allclose(part.origin_mm, whole.frame.position_mm([start] * 3))
    assert any(f"one voxel of {step} was kept along each axis" in note for note in part.notes)


def test_reduction_keeps_places_of_axes_that_run_backwards(tmp_path):
    path = save_itk(tmp_path / "b.nrrd", small_breast(), axes="PRS")
    whole, part = read_phantom(path), read_phantom(path, reduce=2)
    index = np.argwhere(part.labels == 29)[0]
    place = whole.frame.index(part.frame.position_mm(index))
    np.testing.assert_allclose(place, np.rint(place), atol=1e-9)
    assert whole.labels[tuple(np.rint(place).astype(int))] == 29


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
def test_a_voxel_keeps_its_place_in_the_patient_whatever_the_files_axes(tmp_path, order, signs):
    direction = np.zeros((3, 3))
    direction[list(order), range(3)] = signs
    image = sitk.GetImageFromArray(small_breast().transpose(2, 1, 0))
    image.SetSpacing(SPACING.tolist())
    image.SetOrigin([4.0, 5.0, 6.0])
    image.SetDirection(direction.ravel().tolist())
    sitk.WriteImage(image, str(tmp_path / "b.nrrd"))
    breast = read_phantom(tmp_path / "b.nrrd")
    left, posterior, superior = image.TransformIndexToPhysicalPoint((0, 2, 8))
    index = np.argwhere(breast.labels == 88)[0]
    np.testing.assert_allclose(
        breast.frame.position_mm(index), [-posterior, left, superior], atol=1e-9
    )


@pytest.mark.parametrize("encoding", ["ascii", "raw"])
def test_nrrd_without_a_space_does_not_say_its_axes(tmp_path, encoding):
    raw = small_breast().tobytes(order="F")
    voxels = {"raw": raw, "ascii": " ".join(map(str, raw)).encode()}
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 7 9 11\nspacings: 0.5 0.75 1\n"
        f"encoding: {encoding}\n\n"
    )
    (tmp_path / "b.nrrd").write_bytes(header.encode() + voxels[encoding])
    breast = read_phantom(tmp_path / "b.nrrd", axes="ALS")
    np.testing.assert_array_equal(breast.labels, small_breast())
    np.testing.assert_allclose(breast.voxel_mm, SPACING)
    notes = read_phantom(tmp_path / "b.nrrd").notes
    assert any("does not give its axis directions" in note for note in notes)


@pytest.mark.parametrize("axes", ["ALS", "LSA", "SAL", "PRS", "ARI", "RSP"])
def test_a_dicom_series_of_any_direction_is_turned(tmp_path, axes):
    where = [AXIS_OF_LETTER[letter] for letter in axes]
    values = small_breast().transpose([axis for axis, _ in where])
    values = values[tuple(slice(None, None, sense) for _, sense in where)]
    breast = read_phantom(save_series(tmp_path / SERIES, values, axes))
    np.testing.assert_array_equal(breast.labels, small_breast())
    # The file's first voxel lies at ORIGIN, whichever corner of the breast it is.
    corner = [
        0 if sense > 0 else side - 1 for (_, sense), side in zip(where, values.shape, strict=True)
    ]
    index = np.empty(3, int)
    index[[axis for axis, _ in where]] = corner
    np.testing.assert_allclose(breast.frame.position_mm(index), ORIGIN, atol=1e-9)


def test_a_dicom_series_without_positions_goes_by_its_numbers(tmp_path):
    folder = save_series(
        tmp_path / SERIES, small_breast(), ImagePositionPatient=None, ImageOrientationPatient=None
    )
    breast = read_phantom(folder)
    np.testing.assert_array_equal(breast.labels, small_breast())
    np.testing.assert_allclose(breast.voxel_mm, SPACING)
    assert any("slices were ordered by InstanceNumber" in note for note in breast.notes)


def test_a_dicom_series_among_other_files(tmp_path):
    folder = save_series(tmp_path / SERIES, small_breast(), Laterality="R")
    (folder / "readme.txt").write_text("a breast")
    (folder / ".hidden").write_text("")
    breast = read_phantom(folder)
    assert breast.laterality == "R"
    assert any("1 files of series are not DICOM images" in note for note in breast.notes)
    assert read_phantom(folder, laterality="L").laterality == "L"


def test_a_dicom_series_with_rescaled_and_signed_values(tmp_path):
    values = small_breast().astype(np.int16) - 5
    folder = save_series(tmp_path / SERIES, values, RescaleIntercept=5, RescaleSlope=1)
    np.testing.assert_array_equal(read_phantom(folder).labels, small_breast())


def test_a_compressed_dicom_series(tmp_path):
    folder = save_series(tmp_path / SERIES, small_breast())
    for file in folder.iterdir():
        dataset = pydicom.dcmread(file)
        dataset.compress(pydicom.uid.RLELossless, generate_instance_uid=False)
        dataset.save_as(file)
    np.testing.assert_array_equal(read_phantom(folder).labels, small_breast())


def test_openvct_says_what_its_values_are(tmp_path):
    materials = {7: [("Air", 1, 0.001)], 9: [("Glandular", 0.4, 1.04), ("Adipose", 0.6, 0.93)],
                 4: [("Calcium", 0.99, 1.55), ("Glandular", 0.01, 1.02)]}  # fmt: skip
    values = np.full((5, 6, 7), 7, np.uint8)
    values[:3, 1:5, 1:6] = 9
    values[1, 2, 3] = 4
    description = vctx_description(values.shape, materials, "Left")
    path = save_vctx(tmp_path / "b.vctx", values, description, ("x/Phantom.dat", "x/Phantom.xml"))
    breast = read_phantom(path)
    np.testing.assert_array_equal(breast.labels == 1, values == 9)
    assert [lesion.kind for lesion in breast.lesions] == ["calcification"]
    assert breast.laterality == "L"
    assert any("9 as adipose, 4 as calcification" in note for note in breast.notes)
    # The chest wall at x = 0, the middle at y = z = 0.
    np.testing.assert_allclose(breast.origin_mm - 0.5 * SPACING, [0.0, -2.25, -3.5])


def test_openvct_by_a_label_map_of_ones_own(tmp_path):
    (tmp_path / "map.yaml").write_text("0: air\n1: gland\n29: adipose\n33: nipple\n88: skin\n")
    path = save_vctx(tmp_path / "b.vctx", small_breast())
    breast = read_phantom(path, str(tmp_path / "map.yaml"))
    np.testing.assert_array_equal(breast.labels == 1, small_breast() == 29)


def test_openvct_that_is_compressed_already_is_noted(tmp_path):
    text = vctx_description((7, 9, 11)).replace(
        "</VCT_Phantom>",
        "<Deformation><Deformation_Mode>DEFORM_CC</Deformation_Mode></Deformation></VCT_Phantom>",
    )
    breast = read_phantom(save_vctx(tmp_path / "b.vctx", small_breast(), text))
    assert any("already compressed (DEFORM_CC)" in note for note in breast.notes)


@pytest.mark.parametrize("unit", ["micron", r"\u00B5m"])
def test_tiff_by_ome_and_by_imagej(tmp_path, unit):
    pages = small_breast().transpose(2, 1, 0)
    sizes = {f"PhysicalSize{axis}": size for axis, size in zip("XYZ", SPACING, strict=True)}
    units = {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(tmp_path / "b.ome.tif", pages, metadata={"axes": "ZYX", **sizes, **units})
    np.testing.assert_allclose(read_phantom(tmp_path / "b.ome.tif").voxel_mm, SPACING)
    microns = {"spacing": 1000 * SPACING[2], "unit": unit, "axes": "ZYX"}
    tifffile.imwrite(
        tmp_path / "b.tif", pages, imagej=True, metadata=microns,
        resolution=(1e-3 / SPACING[0], 1e-3 / SPACING[1]),
    )  # fmt: skip
    np.testing.assert_allclose(read_phantom(tmp_path / "b.tif").voxel_mm, SPACING)


@pytest.mark.parametrize("suffix", [".npy", ".tif"])
def test_axes_and_voxel_size_as_given(tmp_path, suffix):
    values = np.ascontiguousarray(np.flip(small_breast(), 0).transpose(2, 0, 1))  # S, P, L
    path = save(tmp_path / f"b{suffix}", values)
    breast = read_phantom(path, axes="SPL", voxel_mm=[1.0, 0.5, 0.75])
    np.testing.assert_array_equal(breast.labels, small_breast())
    np.testing.assert_allclose(breast.voxel_mm, [0.5, 0.75, 1.0])
    assert breast.orientation.startswith("axes run SPL, as given")
    assert not any("voxel size" in note for note in breast.notes)


def test_axes_against_the_header_lose_the_place(tmp_path):
    path = save(tmp_path / "b.nrrd", small_breast())
    same, other = read_phantom(path, axes="ALS"), read_phantom(path, axes="LSA")
    np.testing.assert_allclose(same.origin_mm, ORIGIN)
    np.testing.assert_array_equal(other.labels, small_breast().transpose(2, 0, 1))
    assert "its corner voxel is at 0" in other.orientation


@pytest.mark.parametrize(("voxel_mm", "length"), [(2e-4, "0.0022"), (200.0, "2.2e+03")])
def test_a_voxel_size_in_another_unit_is_noted(tmp_path, voxel_mm, length):
    path = save(tmp_path / "b.npy", small_breast())
    notes = read_phantom(path, voxel_mm=voxel_mm).notes
    assert any(f"b.npy is {length} mm long: if its voxel size is in" in note for note in notes)


@pytest.mark.parametrize(("voxel_mm", "length"), [(1e-3, "0.011"), (1000.0, "1.1e+04")])
def test_a_run_refuses_a_breast_in_another_unit(tmp_path, voxel_mm, length):
    np.savez(
        tmp_path / "b.npz", labels=small_breast(), voxel_mm=np.full(3, voxel_mm),
        origin_mm=np.zeros(3),
    )  # fmt: skip
    with pytest.raises(InputError, match=f"is {re.escape(length)} mm long, expected 5 to 1000 mm"):
        make_phantom(PhantomSettings(file="b.npz"), folder=tmp_path)


@pytest.mark.parametrize("axes", ["als", "AL", "ALL", "AP S", "LRS"])
def test_axes_that_are_none(tmp_path, axes):
    path = save(tmp_path / "b.npy", small_breast())
    with pytest.raises(InputError, match=rf"phantom.axes: found '{axes}', expected three letters"):
        read_phantom(path, axes=axes)


def test_victre_files_that_lie_are_read_and_noted(tmp_path):
    breast = read_phantom(save_victre(tmp_path), "victre")
    np.testing.assert_array_equal(breast.labels, small_breast())
    np.testing.assert_allclose(breast.origin_mm, ORIGIN)
    np.testing.assert_allclose(breast.voxel_mm, SPACING)
    assert any("CompressedData = False, but b.raw.gz is compressed" in n for n in breast.notes)
    assert any("names b.raw; b.raw.gz was read" in n for n in breast.notes)


@pytest.mark.parametrize(
    ("element", "dtype", "big"),
    [("MET_UCHAR", "u1", "False"), ("MET_SHORT", "<i2", "False"), ("MET_USHORT", ">u2", "True"),
     ("MET_FLOAT", "<f4", "False"), ("MET_INT", ">i4", "True")],
)  # fmt: skip
def test_element_types_and_byte_orders(tmp_path, element, dtype, big):
    raw = small_breast().astype(dtype).tobytes(order="F")
    for content in (raw, gzip.compress(raw), zlib.compress(raw)):
        path = save_victre(
            tmp_path, content, "b.raw", ElementType=element, BinaryDataByteOrderMSB=big
        )
        np.testing.assert_array_equal(read_phantom(path).labels, small_breast())


def test_an_mha_without_orientation_is_victres_too(tmp_path):
    raw = small_breast().tobytes(order="F")
    header = victre_header(ElementDataFile="LOCAL")
    (tmp_path / "b.mha").write_bytes(header.encode() + raw)
    breast = read_phantom(tmp_path / "b.mha", "victre")
    np.testing.assert_array_equal(breast.labels, small_breast())
    np.testing.assert_allclose(breast.origin_mm, ORIGIN)


@pytest.mark.parametrize("said", ["True", "False"])
def test_voxels_whose_first_bytes_look_compressed(tmp_path, said):
    """Labels 31 and 139 in the corner are gzip's magic number; zlib's first byte is 120."""
    (tmp_path / "map.yaml").write_text("0: air\n1: adipose\n31: gland\n139: skin\n120: muscle\n")
    for corner in ([31, 139], [120, 1]):
        labels = np.ones((7, 9, 11), np.uint8)
        labels[:2, 0, 0] = corner
        raw = labels.tobytes(order="F")
        packed = zlib.compress(raw) if said == "True" else raw
        path = save_victre(tmp_path, packed, "b.raw", CompressedData=said)
        read = read_volume(path, label_map=load_label_map(str(tmp_path / "map.yaml")))
        np.testing.assert_array_equal(read.values, labels)


@pytest.mark.parametrize("size", ["5", "-1"])
def test_voxels_after_a_header_of_another_kind(tmp_path, size):
    raw = bytes(5) + small_breast().tobytes(order="F")
    path = save_victre(tmp_path, raw, "b.raw", HeaderSize=size)
    np.testing.assert_array_equal(read_phantom(path).labels, small_breast())


def test_compressed_voxels_as_long_as_their_content(tmp_path):
    """Of noise, zlib's stream can be just as long as what it stands for."""
    for seed in range(400):
        raw = np.random.default_rng(seed).integers(0, 90, 30).astype("<i2")
        packed = zlib.compress(raw.tobytes(), 6)
        if len(packed) == raw.nbytes:
            break
    assert len(packed) == raw.nbytes
    path = save_victre(
        tmp_path, packed, "b.raw", CompressedData="True", ElementType="MET_SHORT", DimSize="1 5 6"
    )
    np.testing.assert_array_equal(read_volume(path).values.ravel(order="F"), raw)


def test_gzip_of_several_members(tmp_path):
    raw = small_breast().tobytes(order="F")
    path = save_victre(tmp_path, gzip.compress(raw[:100]) + gzip.compress(raw[100:]))
    np.testing.assert_array_equal(read_phantom(path).labels, small_breast())


def test_turning_matrix_without_orientation_is_noted_and_not_used(tmp_path):
    breast = read_phantom(save_victre(tmp_path, TransformMatrix="0 1 0 1 0 0 0 0 1"))
    np.testing.assert_array_equal(breast.labels, small_breast())
    assert any("gives no orientation: not rotated" in note for note in breast.notes)


def test_labels_by_a_map_of_ones_own_beyond_a_byte(tmp_path):
    (tmp_path / "map.yaml").write_text("-1: air\n1000: adipose\n2000: gland\n")
    values = np.full((5, 6, 7), -1, np.int32)
    values[:3] = 1000
    values[1, 2:4, 3] = 2000
    np.save(tmp_path / "b.npy", values)
    breast = read_phantom(tmp_path / "b.npy", str(tmp_path / "map.yaml"))
    np.testing.assert_array_equal(breast.labels == 29, values == 2000)
    np.testing.assert_array_equal(breast.labels == 1, values == 1000)


def test_lesions_and_paddles_of_the_default_map(tmp_path):
    labels = small_breast()
    labels[6, :, 0] = 50  # a paddle is not breast
    np.save(tmp_path / "b.npy", labels)
    assert read_phantom(tmp_path / "b.npy").labels[6].max() == 0


def test_both_breasts_in_one_file_are_noted(tmp_path):
    labels = np.zeros((12, 40, 16), np.uint8)
    labels[1:10, 3:17, 2:14] = labels[1:10, 23:37, 3:14] = 1
    np.save(tmp_path / "b.npy", labels)
    notes = read_phantom(tmp_path / "b.npy", laterality="L", voxel_mm=2.0).notes
    assert any(
        "92 % of the other's volume, possibly both breasts in one file" in one for one in notes
    )
    assert not any("specks" in one for one in notes)


@needs_victre
def test_the_fda_phantom():
    breast = read_phantom(VICTRE, "victre")
    assert breast.labels.shape == (374, 448, 449)
    np.testing.assert_allclose(breast.origin_mm, [-9.4, -36.0534, -45.1184])
    assert breast.laterality == "R"
    assert "60 specks (286 voxels) are separate from the main body; they were kept" in breast.notes
    summary = phantom_summary(breast)
    # The data's own description: 218.7 mL of breast without muscle.
    assert summary.breast_ml == pytest.approx(218.7, abs=0.05)
    assert summary.volume_ml["muscle"] == pytest.approx(4861758 * 0.008e-3, rel=1e-9)
    assert summary.extent_mm[0] == pytest.approx((-9.5, 63.3), abs=0.5)
    assert breast.nipple_mm[0] == pytest.approx(63.2)


@needs_victre
def test_the_fda_phantom_taken_as_left_is_left_and_warned():
    breast = read_phantom(VICTRE, "victre", laterality="L")
    assert breast.laterality == "L"
    assert any("looks like R: used as given" in note for note in breast.notes)
