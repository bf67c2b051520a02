"""Files that cannot be used: one battery over the formats, then each format's own ways to lie."""

from __future__ import annotations

import gzip
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from make_volumes import (
    FORMATS,
    ORIGIN,
    SERIES,
    save,
    save_victre,
    small_breast,
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


@pytest.mark.parametrize("suffix", [s for s in FORMATS if s != ".bin"])
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
@pytest.mark.parametrize("suffix", [s for s in FORMATS if s not in (".bin", ".vctx")])
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
    with pytest.raises(InputError, match="more than one value a voxel, expected a volume"):
        read_phantom(tmp_path / "b.mha")
    sitk.WriteImage(sitk.Image([4, 4, 4], sitk.sitkVectorUInt8, 3), str(tmp_path / "b.nrrd"))
    with pytest.raises(InputError, match="3 values a voxel, expected one volume"):
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
