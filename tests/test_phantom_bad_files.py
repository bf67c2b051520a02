"""Files that cannot be used: one battery over the formats, then each format's own ways to lie."""

from __future__ import annotations

import gzip
import struct
import tracemalloc
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
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
    save,
    save_series,
    save_vctx,
    save_victre,
    small_breast,
    vctx_description,
    victre_header,
)

from mammosim.errors import InputError
from mammosim.phantom import memory, read_phantom


def place(folder: Path, suffix: str) -> Path:
    return folder / f"b.{suffix.lstrip('.')}"


def voxel_file(path: Path) -> Path:
    """The file of a volume that holds its voxels."""
    if path.is_dir():
        return sorted(path.iterdir())[3]
    beside = [p for p in path.parent.iterdir() if p != path]
    return beside[0] if path.suffix in (".mhd", ".nhdr") else path


@pytest.mark.parametrize("part", [0.0, 0.02, 0.3, 0.67, 0.98])
@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("zipped", [True, False])
def test_every_format_refuses_a_truncated_file(tmp_path, suffix, zipped, part):
    path = save(place(tmp_path, suffix), small_breast(), zipped)
    cut = voxel_file(path)
    content = cut.read_bytes()
    cut.write_bytes(content[: int(len(content) * part)])
    with pytest.raises(InputError, match=r"b\.|\.dcm"):
        read_phantom(path, "thesis" if suffix == ".bin" else None)


@pytest.mark.parametrize("rubbish", [b"", bytes(range(256)) * 3, b"\0" * 5000, b"a: b\n\n" * 99])
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_refuses_rubbish(tmp_path, suffix, rubbish):
    path = place(tmp_path, suffix)
    if suffix == SERIES:
        path.mkdir()
        path = path / "a.dcm"
    path.write_bytes(rubbish)
    with pytest.raises(InputError, match=r"b\."):
        read_phantom(path.parent if suffix == SERIES else path)


@pytest.mark.parametrize("suffix", [s for s in FORMATS if s not in OWN_CODES])
def test_every_format_refuses_what_is_another_format(tmp_path, suffix):
    other = ".npz" if suffix != ".npz" else ".nrrd"
    path = place(tmp_path, suffix)
    if suffix == SERIES:
        path.mkdir()
        path = path / "a.dcm"
    path.write_bytes(save(tmp_path / f"other{other}", small_breast()).read_bytes())
    with pytest.raises(InputError, match=r"b\."):
        read_phantom(path.parent if suffix == SERIES else path)


@pytest.mark.parametrize(
    ("values", "message"),
    [(small_breast() * np.float32(0.5), r"holds the value 0\.5, expected whole-number labels"),
     # ITK reads NaN in NIfTI as 0.
     (np.full((6, 6, 6), np.nan, np.float32), "holds the value nan|holds no tissue"),
     (small_breast().astype(np.int16) - 1, "label -1 .* is not in the label map"),
     (np.arange(1000, dtype=np.int16).reshape(10, 10, 10), "over 255 different values")],
)  # fmt: skip
@pytest.mark.parametrize("suffix", [s for s in FORMATS if s not in (*OWN_CODES, ".vctx")])
def test_every_format_refuses_what_are_no_labels(tmp_path, suffix, values, message):
    if suffix == SERIES and values.dtype.kind == "f":
        pytest.skip("a DICOM picture holds whole numbers")
    if suffix.startswith(".tif") and values.dtype == np.int16:
        values = values.astype(np.int32)  # ImageJ has no signed words
    zipped = not suffix.startswith(".tif") or values.dtype.kind != "f"
    with pytest.raises(InputError, match=message):
        read_phantom(save(place(tmp_path, suffix), values, zipped))


def test_every_format_is_in_a_message_about_an_unknown_one(tmp_path):
    with pytest.raises(InputError, match=r"unknown format, expected a file ending in \.mhd, \.mha"):
        read_phantom(tmp_path / "b.stl")
    with pytest.raises(InputError, match="no such file"):
        read_phantom(tmp_path / "b.nrrd")
    (tmp_path / "b.dcm").write_bytes(b"")
    with pytest.raises(InputError, match="is one DICOM file, expected the folder of a series"):
        read_phantom(tmp_path / "b.dcm")


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_phantom_larger_than_memory_is_refused_before_it_is_read(tmp_path, suffix, monkeypatch):
    path = save(place(tmp_path, suffix), small_breast())
    monkeypatch.setattr(memory, "available_bytes", lambda: 100)
    with pytest.raises(InputError, match=r"million voxels take .* GB to read, 1e-07 GB are avail"):
        read_phantom(path)


def test_what_to_do_with_a_phantom_larger_than_memory(tmp_path, monkeypatch):
    path = save_victre(tmp_path)
    # 7 x 9 x 11 voxels, two bytes each while they are read.
    monkeypatch.setattr(memory, "available_bytes", lambda: 2 * 693 // 8)
    with pytest.raises(InputError, match=r"phantom.reduce: 2 gives voxels of 1 x 1.5 x 2 mm"):
        read_phantom(path)
    assert read_phantom(path, reduce=2).labels.shape == (3, 4, 5)


def test_a_sparse_file_of_terabytes_is_refused_by_its_numbers(tmp_path):
    with (tmp_path / "b.raw").open("wb") as stream:
        stream.truncate(8 << 40)
    (tmp_path / "b.mhd").write_text(victre_header(DimSize="16384 16384 32768"))
    with pytest.raises(InputError, match=r"8.796e\+06 million voxels take 1.76e\+04 GB to read"):
        read_phantom(tmp_path / "b.mhd")


@pytest.mark.parametrize("reduce", [0, 8, 17, -1])
def test_a_reduction_that_leaves_nothing(tmp_path, reduce):
    with pytest.raises(InputError, match=rf"phantom.reduce: found {reduce}, expected 1 to 7 for b"):
        read_phantom(save(tmp_path / "b.npz", small_breast()), reduce=reduce)


def test_memory_is_what_the_system_and_the_group_allow(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemTotal: 9 kB\nMemAvailable:   2000 kB\n")
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    assert memory.available_bytes() == 2000 * 1024
    (tmp_path / "memory.max").write_text("5000\n")
    (tmp_path / "memory.current").write_text("1000\n")
    assert memory.available_bytes() == 4000
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available_bytes() == 2000 * 1024
    monkeypatch.setattr(memory, "MEMINFO", tmp_path / "missing")
    assert memory.available_bytes() > 1 << 20


def test_oblique_axes_are_refused(tmp_path):
    image = sitk.GetImageFromArray(small_breast().transpose(2, 1, 0))
    c, s = np.cos(0.1), np.sin(0.1)
    image.SetDirection([c, -s, 0, s, c, 0, 0, 0, 1])
    sitk.WriteImage(image, str(tmp_path / "b.mha"))
    with pytest.raises(InputError, match="oblique"):
        read_phantom(tmp_path / "b.mha")


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
     ({"Offset": "1 inf 1"}, r"expected three numbers from -1e\+06 to 1e\+06"),
     ({"Offset": "1 1 1e300"}, "origin is"),
     ({"TransformMatrix": "1 0 0"}, "expected nine numbers"),
     ({"ElementType": "MET_STRING"}, "ElementType is 'MET_STRING', expected one of MET_UCHAR"),
     ({"ElementNumberOfChannels": "3"}, "more than one value per voxel"),
     ({"ElementDataFile": "../b.raw"}, "expected a file beside the header"),
     ({"HeaderSize": "a"}, "HeaderSize is 'a', expected a whole number from -1"),
     ({"HeaderSize": "99999"}, "holds 0 bytes of voxels, expected 693"),
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
    with pytest.raises(InputError, match="more than one value per voxel, expected a volume"):
        read_phantom(tmp_path / "b.mha")
    sitk.WriteImage(sitk.Image([4, 4, 4], sitk.sitkVectorUInt8, 3), str(tmp_path / "b.nrrd"))
    with pytest.raises(InputError, match="3 values per voxel, expected one volume"):
        read_phantom(tmp_path / "b.nrrd")


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
    with pytest.raises(
        InputError, match=r"size is \[0, 3, 3\] voxels, expected three sides of 1 or more"
    ):
        read_phantom(path)
    np.save(path, np.arange(8000).reshape(20, 20, 20))
    with pytest.raises(InputError, match="over 255 different values"):
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
    labels[0, 0, 0], labels[1, 3, 3] = 7, 97
    np.save(tmp_path / "b.npy", labels)
    with pytest.raises(InputError) as caught:
        read_phantom(tmp_path / "b.npy")
    first, second, known = caught.value.problems
    assert "label 7 (0.001 mL) is not in the label map" in first
    assert "label 97 (0.001 mL)" in second
    assert "29 gland" in known


def test_many_unknown_labels_are_counted(tmp_path):
    np.save(tmp_path / "b.npy", np.arange(3000, 3125).reshape(5, 5, 5))
    with pytest.raises(InputError, match="and 105 more labels"):
        read_phantom(tmp_path / "b.npy")


@pytest.mark.parametrize(
    ("changes", "message"),
    [(("sizes: 7 9 11", "sizes: 7000 9000 11000"), r"bytes cannot hold the 693000000000 bytes"),
     (("sizes: 7 9 11", "sizes: 7 9 12"), "bytes cannot hold the 756 bytes|truncated or damaged"),
     (("sizes: 7 9 11", "sizes: 7 9"), "cannot be read, truncated or not its format"),
     (("type: unsigned char", "type: block"), "cannot be read, truncated or not its format"),
     (("encoding: gzip", "encoding: zip"), "encoding is 'zip', expected one of raw, gzip"),
     (("(0.5,0,0)", "(nan,0,0)"), "cannot be read|voxel size is|oblique"),
     (("encoding: gzip", "encoding: gzip\nbyte skip: 2x"), "byte skip is '2x', expected a who"),
     (("encoding: gzip", "encoding: gzip\ndata file: ../b.raw"), "expected one file beside the he"),
     (("encoding: gzip", "encoding: gzip\ndata file: /etc/passwd"), "expected one file beside the"),
     (("encoding: gzip", "encoding: gzip\ndata file: LIST"), "expected one file beside the header"),
     (("encoding: gzip", "encoding: gzip\ndata file: x%03d.raw 1 5 1"), "expected one file beside"),
     (("encoding: gzip", "encoding: gzip\ndata file: no.raw"), "no.raw does not exist"),
     (("NRRD000", "NRRX000"), "its first line is not 'NRRD000' and a number")],
)  # fmt: skip
def test_nrrd_headers_that_lie(tmp_path, changes, message):
    path = save(tmp_path / "b.nrrd", small_breast())
    header, _, voxels = path.read_bytes().partition(b"\n\n")
    # ITK writes x from right to left: the breast's x axis is posterior reversed.
    text = header.decode().replace("(0,-0.5,0)", "(0.5,0,0)").replace("(0.75,0,0)", "(0,0.75,0)")
    changed = text.replace(*changes)
    assert changed != text
    path.write_bytes(changed.encode() + b"\n\n" + voxels)
    with pytest.raises(InputError, match=message):
        read_phantom(path)


@pytest.mark.parametrize(
    ("at", "form", "value", "message"),
    [(40, "8h", (3, 7, 9, 12, 1, 1, 1, 1), "1045 bytes cannot hold the 1108 bytes"),
     (40, "8h", (3, 30000, 30000, 30000, 1, 1, 1, 1), r"bytes cannot hold the 270000+352 bytes"),
     (40, "8h", (3, -7, 9, 11, 1, 1, 1, 1), "its header cannot be used"),
     (40, "8h", (5, 7, 9, 11, 1, 3, 1, 1), "cannot hold|values per voxel|holds 1045 bytes"),
     (72, "h", (0,), "its header cannot be used"),
     (76, "8f", (1, 0.5, float("nan"), 1, 0, 0, 0, 0), r"voxel size is \[0.5, nan, 1.0\] mm"),
     (76, "8f", (1, 0.5, -0.75, 1, 0, 0, 0, 0), "expected three positive numbers"),
     (108, "f", (-4.0,), "its header cannot be used"),
     (108, "f", (float("nan"),), "its header cannot be used"),
     (0, "i", (349,), "not a whole NIfTI file, its header cannot be used")],
)  # fmt: skip
def test_nifti_headers_that_lie(tmp_path, at, form, value, message):
    path = save(tmp_path / "b.nii", small_breast())
    content = bytearray(path.read_bytes())
    struct.pack_into("<" + form, content, at, *value)
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_phantom(path)


def test_nifti_without_qform_and_sform_does_not_say_its_axes(tmp_path):
    path = save(tmp_path / "b.nii", small_breast())
    content = bytearray(path.read_bytes())
    struct.pack_into("<2h", content, 252, 0, 0)
    path.write_bytes(content)
    assert any("does not give its axis directions" in note for note in read_phantom(path).notes)


@pytest.mark.parametrize("shape", ["(700, 900, 1100)", "(7, 9, 12)", "(10000000000, 7, 9)"])
@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_numpy_headers_that_lie(tmp_path, suffix, shape):
    path = save(tmp_path / f"b{suffix}", small_breast())
    if suffix == ".npz":
        with zipfile.ZipFile(path) as archive:
            content = {name: archive.read(name) for name in archive.namelist()}
        content["labels.npy"] = _with_shape(content["labels.npy"], shape)
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, part in content.items():
                archive.writestr(name, part)
    else:
        path.write_bytes(_with_shape(path.read_bytes(), shape))
    with _no_more_than(4 << 20), pytest.raises(InputError, match=r"b\.np"):
        read_phantom(path)


def _with_shape(npy: bytes, shape: str) -> bytes:
    start = npy.index(b"(7, 9, 11)")
    line_end = npy.index(b"\n")
    header = npy[:line_end].replace(b"(7, 9, 11)", shape.encode())
    assert npy[start] == ord("(")
    return header.rstrip(b" ").ljust(line_end) + npy[line_end:]


@contextmanager
def _no_more_than(most_bytes: int) -> Iterator[None]:
    """Nothing beyond the file's honest size is allocated."""
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < most_bytes


def test_npz_with_pickled_objects_or_large_companions(tmp_path):
    path = tmp_path / "b.npz"
    np.savez(path, labels=np.array([[[{}]]], dtype=object), voxel_mm=1.0, origin_mm=ORIGIN)
    with pytest.raises(InputError, match="holds object voxels, expected whole numbers"):
        read_phantom(path)
    np.savez(path, labels=small_breast(), voxel_mm=np.ones(5000), origin_mm=ORIGIN)
    with pytest.raises(InputError, match="voxel_mm holds more than three numbers"):
        read_phantom(path)


# --- OpenVCT


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"X": "70000", "Y": "90000"}, r"holds 693 bytes of voxels, expected 69300000000 from Ph"),
     ({"Z": "12"}, "holds 693 bytes of voxels, expected 756 from Phantom.xml"),
     ({"X": "-7"}, "Voxel_Array/VOXEL_NUM/X is '-7', expected a whole number"),
     ({"X": "7.5"}, "is '7.5', expected a whole number"),
     ({"Y": "0"}, r"its size is \[7, 0, 11\] voxels"),
     ({"SX": "nan"}, r"voxel size is \[nan, 0.75, 1.0\] mm, expected three positive"),
     ({"SY": "thin"}, "Voxel_Array/VOXEL_SIZE_MM/Y is 'thin', expected a number"),
     ({"order": "Z | Y | X"}, "VOXEL_ARRAY_ORDER is 'Z | Y | X', expected 'X | Y | Z'"),
     ({"bits": "16"}, "of 16 bits, expected one byte per voxel"),
     ({"type": "V_INT16"}, "its voxels are V_INT16 of 8 bits")],
)  # fmt: skip
def test_openvct_descriptions_that_lie(tmp_path, changes, message):
    description = vctx_description((7, 9, 11), **changes)
    path = save_vctx(tmp_path / "b.vctx", small_breast(), description)
    with _no_more_than(4 << 20), pytest.raises(InputError, match=message):
        read_phantom(path)


@pytest.mark.parametrize(
    ("materials", "message"),
    [({0: [("Kryptonite", 1, 1)]}, r"index 0 is 'Kryptonite', expected one of air, adipose"),
     ({0: []}, "index 0 has no material"),
     ({0: [("Air", "nan", 1)]}, "a weight or density that is not finite"),
     ({"a": [("Air", 1, 1)]}, "Index_ID is 'a', expected a whole number"),
     ({0: [("Air", 1, 1)], 1: [("Adipose", 1, 1)]}, "label 29 .* is not in the label map"),
     ({}, "has no Index_Table that says what each value is")],
)  # fmt: skip
def test_openvct_tables_that_cannot_be_used(tmp_path, materials, message):
    description = vctx_description((7, 9, 11), materials)
    with pytest.raises(InputError, match=message):
        read_phantom(save_vctx(tmp_path / "b.vctx", small_breast(), description))


@pytest.mark.parametrize(
    ("text", "message"),
    [("<VCT_Phantom>", "its Phantom.xml cannot be read"),
     ("<VCT_Phantom/>", "Phantom.xml has no Voxel_Array/VOXEL_NUM/X"),
     ("\x00\xff", "its Phantom.xml cannot be read"),
     ('<!DOCTYPE a [<!ENTITY b "c">]><VCT_Phantom>&b;</VCT_Phantom>', "it holds declarations")],
)  # fmt: skip
def test_openvct_descriptions_that_are_none(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_phantom(save_vctx(tmp_path / "b.vctx", small_breast(), text))


@pytest.mark.parametrize("name", ["../Phantom.dat", "/Phantom.dat", "..\\..\\b/Phantom.dat"])
def test_openvct_path_tricks_lead_nowhere(tmp_path, name):
    """Entries are read in place: where their names point to is not touched."""
    (tmp_path / "in").mkdir()
    path = save_vctx(tmp_path / "in" / "b.vctx", small_breast(), names=(name, "b/Phantom.xml"))
    np.testing.assert_array_equal(read_phantom(path).labels, small_breast())
    assert [item.name for item in tmp_path.rglob("*")] == ["in", "b.vctx"]


@pytest.mark.parametrize(
    "names", [("b/Phantom.dat", "b/x.xml"), ("b/x", "b/Phantom.xml"), ("a", "b")]
)
def test_openvct_without_a_part(tmp_path, names):
    with pytest.raises(InputError, match=r"holds 0 entries Phantom\.(dat|xml) among"):
        read_phantom(save_vctx(tmp_path / "b.vctx", small_breast(), names=names))


def test_openvct_with_two_of_a_part(tmp_path):
    path = save_vctx(tmp_path / "b.vctx", small_breast())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("c/Phantom.dat", b"")
    with pytest.raises(InputError, match=r"holds 2 entries Phantom\.dat"):
        read_phantom(path)


def test_an_openvct_bomb_is_not_unpacked(tmp_path):
    path = tmp_path / "b.vctx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("b/Phantom.dat", bytes(64 << 20))
        archive.writestr("b/Phantom.xml", vctx_description((7, 9, 11)))
    with _no_more_than(4 << 20), pytest.raises(InputError, match="holds 67108864 bytes of voxels"):
        read_phantom(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("b/Phantom.dat", bytes(693))
        archive.writestr("b/Phantom.xml", b" " * (20 << 20))
    with _no_more_than(48 << 20), pytest.raises(InputError, match="longer than 16777216 bytes"):
        read_phantom(path)


def test_an_openvct_archive_whose_directory_lies(tmp_path):
    """The zip directory says 693 bytes, the stream holds 64 MB."""
    path = tmp_path / "b.vctx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("b/Phantom.dat", bytes(64 << 20))
        archive.writestr("b/Phantom.xml", vctx_description((7, 9, 11)))
    content = path.read_bytes().replace(struct.pack("<I", 64 << 20), struct.pack("<I", 693))
    path.write_bytes(content)
    with _no_more_than(4 << 20), pytest.raises(InputError, match=r"b\.vctx"):
        read_phantom(path)


# --- DICOM series


def files_of(folder: Path) -> list[Path]:
    return sorted(folder.iterdir(), key=lambda p: pydicom.dcmread(p).InstanceNumber)


def test_a_missing_slice_is_seen_from_the_gap(tmp_path):
    folder = save_series(tmp_path / SERIES, small_breast())
    files_of(folder)[4].unlink()
    with pytest.raises(InputError, match=r"lie 2 mm apart, others 1 mm: 1 missing between them"):
        read_phantom(folder)


def test_a_double_slice_is_seen_from_the_gap(tmp_path):
    folder = save_series(tmp_path / SERIES, small_breast())
    (folder / "copy.dcm").write_bytes(files_of(folder)[4].read_bytes())
    with pytest.raises(InputError, match=r"lie 0 mm apart, others 1 mm: a slice is there twice"):
        read_phantom(folder)


@pytest.mark.parametrize("number", [0, 5, None])
def test_missing_and_double_slices_by_their_numbers(tmp_path, number):
    folder = save_series(tmp_path / SERIES, small_breast(), ImagePositionPatient=None)
    file = files_of(folder)[6]
    dataset = pydicom.dcmread(file)
    if number is None:
        del dataset.InstanceNumber
    else:
        dataset.InstanceNumber = number
    dataset.save_as(file)
    message = {0: "6 is followed by 8: 1 missing between them", 5: "both have InstanceNumber 5",
               None: "has neither ImagePositionPatient nor InstanceNumber"}[number]  # fmt: skip
    with pytest.raises(InputError, match=message):
        read_phantom(folder)


@pytest.mark.parametrize(
    ("tag", "value", "message"),
    [("SeriesInstanceUID", "9.9", r"holds 2 series \(10 of 1.2.3, 1 of 9.9\), expected one"),
     ("ImagePositionPatient", [-20, -3, 14.9], "its slices lie .* apart, expected equal distances"),
     ("ImagePositionPatient", [-20, -3, "nan"], "numbers that are not finite|damaged DICOM header"),
     ("PixelSpacing", [0.75, 0.6], "PixelSpacing is .0.75, 0.6., but .0.75, 0.5."),
     ("ImageOrientationPatient", [1, 0, 0, 0, 1, 0], "ImageOrientationPatient is"),
     ("Rows", 5, "size is .7, 5., but .7, 9."),
     ("RescaleIntercept", 3, "rescaling is .1.0, 3.0., but .1.0, 0.0."),
     ("NumberOfFrames", 3, "holds 3 frames with 1 values per pixel, expected one slice"),
     ("SamplesPerPixel", 3, "holds 1 frames with 3 values per pixel")],
)  # fmt: skip
def test_a_slice_that_does_not_belong(tmp_path, tag, value, message):
    folder = save_series(tmp_path / SERIES, small_breast())
    file = files_of(folder)[2]
    dataset = pydicom.dcmread(file)
    setattr(dataset, tag, value)
    dataset.save_as(file)
    with pytest.raises(InputError, match=message):
        read_phantom(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"PixelSpacing": [0.0, 0.5]}, "expected three positive numbers"),
     ({"PixelSpacing": ["nan", 0.5]}, "expected three positive numbers|damaged DICOM header"),
     ({"ImageOrientationPatient": [1, 0, 0, 1, 0, 0]}, "expected two unit vectors at right angles"),
     ({"ImageOrientationPatient": [0, 0.6, 0.8, 1, 0, 0]}, "relative to each other|oblique"),
     ({"BitsAllocated": 64}, "its pixels have 64 bits, expected whole numbers of 8, 16 or 32"),
     ({"Rows": 60000, "Columns": 60000}, "bytes cannot hold the 3600000000 bytes")],
)  # fmt: skip
def test_series_that_cannot_be_used(tmp_path, changes, message):
    folder = save_series(tmp_path / SERIES, small_breast(), **changes)
    with _no_more_than(8 << 20), pytest.raises(InputError, match=message):
        read_phantom(folder)


def test_a_folder_without_pictures(tmp_path):
    (tmp_path / "readme.txt").write_text("nothing")
    with pytest.raises(InputError, match="the folder contains no DICOM images"):
        read_phantom(tmp_path)


# --- TIFF


def test_tiff_pages_that_are_no_volume(tmp_path):
    path = tmp_path / "b.tif"
    tifffile.imwrite(path, np.zeros((5, 6), np.uint8))
    with pytest.raises(InputError, match="expected one value per pixel on two or more pages"):
        read_phantom(path)
    tifffile.imwrite(path, np.zeros((4, 5, 6, 3), np.uint8), photometric="rgb")
    with pytest.raises(InputError, match="expected one value per pixel on two or more pages"):
        read_phantom(path)
    with tifffile.TiffWriter(path) as writer:
        writer.write(np.zeros((5, 6), np.uint8), metadata=None)
        writer.write(np.zeros((7, 8), np.uint8), metadata=None)
    with pytest.raises(InputError, match="holds 2 images of different sizes"):
        read_phantom(path)


@pytest.mark.parametrize("zipped", [True, False])
def test_tiff_whose_pages_promise_gigabytes(tmp_path, zipped):
    path = save(tmp_path / "b.tif", small_breast(), zipped)
    with tifffile.TiffFile(path, mode="r+") as tiff:
        for page in tiff.pages:
            page.tags["ImageWidth"].overwrite(60000)
            page.tags["ImageLength"].overwrite(60000)
            page.tags["RowsPerStrip"].overwrite(60000)
    with _no_more_than(8 << 20), pytest.raises(InputError, match=r"b\.tif"):
        read_phantom(path)


@pytest.mark.parametrize("spacing", [0, -1.0, float("nan"), "wide"])
def test_tiff_with_a_spacing_that_is_none(tmp_path, spacing):
    path = tmp_path / "b.tif"
    described = {"spacing": spacing, "unit": "mm", "axes": "ZYX"}
    tifffile.imwrite(
        path, small_breast().transpose(2, 1, 0), imagej=True, resolution=(2, 2), metadata=described
    )
    if spacing == "wide":
        assert any("does not give its voxel size" in note for note in read_phantom(path).notes)
        return
    with pytest.raises(InputError, match="expected three positive numbers"):
        read_phantom(path)
