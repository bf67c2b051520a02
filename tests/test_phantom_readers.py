"""Voxel files in: every format, the frame of each, and everything that can be wrong with them."""

from __future__ import annotations

import gzip
import itertools
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from mammosim.errors import InputError
from mammosim.phantom import phantom_summary, read_phantom
from mammosim.phantom.readers import READERS, read_volume
from mammosim.phantom.readers.volume import BREAST_FROM_LPS

VICTRE = Path(__file__).parents[2] / "shared" / "data" / "victre" / "p_1.mhd"
needs_victre = pytest.mark.skipif(
    not VICTRE.is_file(), reason=f"the FDA phantom {VICTRE.name} is not beside the repository"
)

SPACING, ORIGIN = np.array([0.5, 0.75, 1.0]), np.array([3.0, -20.0, 12.5])


def small_breast() -> np.ndarray:
    """Uneven in every axis, so that any swap or flip shows."""
    labels = np.zeros((7, 9, 11), np.uint8)
    labels[0:6, 2:7, 1:9] = 1
    labels[1:3, 3:5, 2:4] = 29
    labels[0, 2, 8] = 88
    labels[5, 4, 3:5] = 33
    return labels


def save(path: Path, labels: np.ndarray, zipped: bool = True) -> Path:
    """Save [x, y, z] in the format of the ending; ITK's formats get patient axes."""
    if path.suffix == ".npy":
        np.save(path, labels)
    elif path.suffix == ".npz":
        np.savez_compressed(path, labels=labels, voxel_mm=SPACING, origin_mm=ORIGIN)
    elif path.suffix == ".bin":  # a cube of codes of its own: test_phantom_thesis.py
        np.full((7, 7, 7), 203, "<i2").tofile(path)
    else:
        image = sitk.GetImageFromArray(labels.transpose(2, 1, 0))
        image.SetSpacing(SPACING.tolist())
        image.SetOrigin((BREAST_FROM_LPS.T @ ORIGIN).tolist())
        image.SetDirection(BREAST_FROM_LPS.T.ravel().tolist())
        sitk.WriteImage(image, str(path), useCompression=zipped and path.suffix != ".mhd")
    return path


def victre_header(**changes: str) -> str:
    lines = {
        "ObjectType": "Image", "NDims": "3", "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False", "CompressedData": "False",
        "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "3 -20 12.5",
        "ElementSpacing": "0.5 0.75 1.0", "DimSize": "7 9 11", "AnatomicalOrientation": "???",
        "ElementType": "MET_UCHAR", "ElementDataFile": "b.raw",
    }  # fmt: skip
    lines.update(changes)
    return "".join(f"{key} = {value}\n" for key, value in lines.items()) + "ObjectType = Image\n"


def save_victre(folder: Path, raw: bytes | None = None, name: str = "b.raw.gz", **changes) -> Path:
    if raw is None:
        raw = gzip.compress(small_breast().tobytes(order="F"))
    (folder / name).write_bytes(raw)
    (folder / "b.mhd").write_text(victre_header(**changes))
    return folder / "b.mhd"


@pytest.mark.parametrize("suffix", [suffix for suffix in READERS if suffix != ".bin"])
def test_every_format_gives_the_same_breast(tmp_path, suffix):
    breast = read_phantom(save(tmp_path / f"b{suffix}", small_breast()))
    assert breast.labels.dtype == np.uint8
    assert breast.labels.flags.c_contiguous
    np.testing.assert_array_equal(breast.labels, small_breast())
    if suffix == ".npy":
        assert "1 mm and the origin were taken" in breast.notes[0]
    else:
        # NIfTI keeps its numbers in single precision.
        np.testing.assert_allclose(breast.voxel_mm, SPACING, rtol=1e-6)
        np.testing.assert_allclose(breast.origin_mm, ORIGIN, rtol=1e-6)


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("zipped", [True, False])
def test_every_format_refuses_a_truncated_file(tmp_path, suffix, zipped):
    path = save(tmp_path / f"b{suffix}", small_breast(), zipped)
    voxels = next((p for p in tmp_path.iterdir() if p.suffix in {".raw", ".zraw"}), path)
    if suffix == ".nhdr":
        voxels = next(p for p in tmp_path.iterdir() if p != path)
    content = voxels.read_bytes()
    voxels.write_bytes(content[: len(content) * 2 // 3])
    with pytest.raises(InputError, match=r"b\."):
        read_phantom(path)


@pytest.mark.parametrize("suffix", READERS)
def test_every_format_refuses_rubbish(tmp_path, suffix):
    path = tmp_path / f"b{suffix}"
    path.write_bytes(bytes(range(256)) * 3)
    with pytest.raises(InputError, match=r"b\."):
        read_phantom(path)


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


def test_oblique_axes_are_refused(tmp_path):
    image = sitk.GetImageFromArray(small_breast().transpose(2, 1, 0))
    c, s = np.cos(0.1), np.sin(0.1)
    image.SetDirection([c, -s, 0, s, c, 0, 0, 0, 1])
    sitk.WriteImage(image, str(tmp_path / "b.mha"))
    with pytest.raises(InputError, match="oblique"):
        read_phantom(tmp_path / "b.mha")


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"DimSize": "7 9"}, "DimSize is '7 9', expected three whole numbers"),
     ({"DimSize": "7 9 0"}, "sides of 1 or more"),
     ({"DimSize": "7 9 12"}, r"truncated|holds 693 bytes of voxels, expected 756 from b.mhd"),
     ({"DimSize": "7 9 10"}, "holds more than 630 bytes of voxels, expected 630 from b.mhd"),
     ({"DimSize": "70000 90000 110000"}, "cannot hold"),
     ({"ElementSpacing": "0.5 0 1"}, r"voxel size is \[0.5, 0.0, 1.0\] mm, expected three pos"),
     ({"ElementSpacing": "0.5 nan 1"}, "expected three positive numbers"),
     ({"ElementSpacing": "0.5 a 1"}, "ElementSpacing is '0.5 a 1', expected numbers"),
     ({"Offset": "1 inf 1"}, "expected three finite numbers"),
     ({"TransformMatrix": "1 0 0"}, "expected nine numbers"),
     ({"ElementType": "MET_STRING"}, "ElementType is 'MET_STRING', expected one of MET_UCHAR"),
     ({"ElementNumberOfChannels": "3"}, "more than one value a voxel"),
     ({"ElementDataFile": "../b.raw"}, "expected a file beside the header"),
     ({"ElementDataFile": "c.raw"}, "does not exist, nor does c.raw.gz")],
)  # fmt: skip
def test_metaimage_headers_that_cannot_be_used(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        read_phantom(save_victre(tmp_path, **changes), "victre")


def test_metaimage_header_without_spacing_or_size(tmp_path):
    path = tmp_path / "b.mhd"
    path.write_text("NDims = 3\n")
    with pytest.raises(InputError, match="DimSize, ElementType, ElementDataFile missing"):
        read_phantom(path)
    path.write_text(victre_header().replace("ElementSpacing", "Spaces"))
    with pytest.raises(InputError, match="ElementSpacing is missing"):
        read_phantom(path)


def test_turning_matrix_without_orientation_is_noted_and_not_used(tmp_path):
    breast = read_phantom(save_victre(tmp_path, TransformMatrix="0 1 0 1 0 0 0 0 1"))
    np.testing.assert_array_equal(breast.labels, small_breast())
    assert any("says no orientation: not turned" in note for note in breast.notes)


def test_a_zip_bomb_is_not_unpacked(tmp_path):
    bomb = gzip.compress(bytes(64 << 20))
    path = save_victre(tmp_path, bomb)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="holds more than 693 bytes"):
            read_phantom(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The bomb holds 64 MB; the reader's own buffers are some hundred kilobytes.
    assert peak < 4 << 20


@pytest.mark.parametrize("cut", [5, 30, -4])
def test_damaged_gzip(tmp_path, cut):
    content = bytearray(gzip.compress(small_breast().tobytes(order="F")))
    with pytest.raises(InputError, match="truncated or damaged"):
        read_phantom(save_victre(tmp_path, bytes(content[:cut])))
    content[len(content) // 2] ^= 0xFF
    with pytest.raises(InputError, match=r"damaged|holds"):
        read_phantom(save_victre(tmp_path, bytes(content)))


def test_unknown_format_and_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"unknown format, expected a file ending in \.mhd, \.mha"):
        read_volume(tmp_path / "b.stl")
    with pytest.raises(InputError, match="no such file"):
        read_volume(tmp_path / "b.nrrd")


def test_npz_without_its_arrays(tmp_path):
    np.savez(tmp_path / "b.npz", volume=small_breast())
    with pytest.raises(InputError, match="holds volume, expected arrays labels, voxel_mm"):
        read_phantom(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", labels=small_breast(), voxel_mm="a", origin_mm=ORIGIN)
    with pytest.raises(InputError, match="must be numbers"):
        read_phantom(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", labels=small_breast()[0], voxel_mm=1.0, origin_mm=ORIGIN)
    with pytest.raises(InputError, match=r"shape \(9, 11\), expected \[x, y, z\]"):
        read_phantom(tmp_path / "b.npz")


def test_more_than_one_value_a_voxel(tmp_path):
    sitk.WriteImage(sitk.Image([4, 4, 4], sitk.sitkVectorUInt8, 3), str(tmp_path / "b.mha"))
    with pytest.raises(InputError, match="3 values a voxel, expected one volume"):
        read_phantom(tmp_path / "b.mha")


def test_values_that_are_not_labels(tmp_path):
    path = tmp_path / "b.npy"
    np.save(path, small_breast() * 0.5)
    with pytest.raises(InputError, match=r"holds the value 0\.5, expected whole-number labels"):
        read_phantom(path)
    np.save(path, np.full((3, 3, 3), np.nan))
    with pytest.raises(InputError, match="holds the value nan"):
        read_phantom(path)
    np.save(path, np.full((3, 3, 3), "a"))
    with pytest.raises(InputError, match="expected whole numbers"):
        read_phantom(path)
    np.save(path, np.zeros((0, 3, 3), np.uint8))
    with pytest.raises(InputError, match="expected at least one voxel"):
        read_phantom(path)
    np.save(path, np.arange(8000).reshape(20, 20, 20))
    with pytest.raises(InputError, match="over 4096 different values"):
        read_phantom(path)


def test_no_tissue_and_wrong_side(tmp_path):
    np.save(tmp_path / "b.npy", np.full((4, 4, 4), 50, np.uint8))
    with pytest.raises(InputError, match=r"holds no tissue, only labels \[50\]"):
        read_phantom(tmp_path / "b.npy", "victre")
    with pytest.raises(InputError, match="laterality: found 'left', expected L or R"):
        read_phantom(tmp_path / "b.npy", laterality="left")


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int64, np.float32])
def test_unknown_labels_are_all_listed_with_their_volume(tmp_path, dtype):
    labels = small_breast().astype(dtype)
    labels[0, 0, 0], labels[1, 3, 3] = 7, 99
    np.save(tmp_path / "b.npy", labels)
    with pytest.raises(InputError) as caught:
        read_phantom(tmp_path / "b.npy")
    first, second, known = caught.value.problems
    assert "label 7 (0.001 mL) is not in the label map" in first
    assert "label 99 (0.001 mL)" in second
    assert "29 gland" in known


def test_many_unknown_labels_are_counted(tmp_path):
    np.save(tmp_path / "b.npy", np.arange(3000, 3125).reshape(5, 5, 5))
    with pytest.raises(InputError, match="and 105 more labels"):
        read_phantom(tmp_path / "b.npy")


def test_labels_by_a_map_of_ones_own_beyond_a_byte(tmp_path):
    (tmp_path / "map.yaml").write_text("-1: air\n1000: adipose\n2000: gland\n")
    values = np.full((5, 6, 7), -1, np.int32)
    values[:3] = 1000
    values[1, 2:4, 3] = 2000
    np.save(tmp_path / "b.npy", values)
    breast = read_phantom(tmp_path / "b.npy", str(tmp_path / "map.yaml"))
    np.testing.assert_array_equal(breast.labels == 29, values == 2000)
    np.testing.assert_array_equal(breast.labels == 1, values == 1000)


@needs_victre
def test_the_fda_phantom():
    breast = read_phantom(VICTRE, "victre")
    assert breast.labels.shape == (374, 448, 449)
    np.testing.assert_allclose(breast.origin_mm, [-9.4, -36.0534, -45.1184])
    assert breast.laterality == "R"
    assert "60 specks (286 voxels) lie apart from the main body; they were kept" in breast.notes
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
    assert any("looks like R: taken as given" in note for note in breast.notes)
