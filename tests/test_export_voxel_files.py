"""Volumes out and in again: every voxel and every position as it was."""

from __future__ import annotations

import gzip
import resource
import signal

import numpy as np
import pytest
import SimpleITK as sitk
import tifffile
from make_volumes import (
    FORMATS,
    ORIGIN,
    OWN_CODES,
    SPACING,
    save,
    save_itk,
    save_series,
    small_breast,
)
from typer.testing import CliRunner

from mammosim import cli
from mammosim.errors import InputError
from mammosim.export import WRITERS, convert_volume
from mammosim.geometry import VoxelFrame
from mammosim.phantom import read_phantom
from mammosim.phantom.readers.axes import BREAST_FROM_LPS
from mammosim.phantom.voxels import read_volume

FRAME = VoxelFrame(ORIGIN, SPACING, (7, 9, 11))
NIFTI_RTOL = 1e-6  # NIfTI keeps its geometry in 32-bit floats


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.int32])
def test_every_writer_keeps_every_voxel_at_its_place(tmp_path, suffix, dtype):
    if suffix.startswith(".tif") and dtype in (np.int16, np.int32):
        pytest.skip("ImageJ has no signed labels")
    rng = np.random.default_rng(4)
    choice = np.linspace(0 if dtype == np.uint8 else 300, np.iinfo(dtype).max, 20).astype(dtype)
    values = rng.choice(choice, FRAME.shape)
    WRITERS[suffix](values, FRAME, tmp_path / f"b{suffix}")
    back = read_volume(tmp_path / f"b{suffix}")
    np.testing.assert_array_equal(back.values, values)
    np.testing.assert_allclose(back.voxel_mm, SPACING, rtol=NIFTI_RTOL)
    np.testing.assert_allclose(back.origin_mm, ORIGIN, rtol=NIFTI_RTOL)
    assert not back.notes


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_writer_gives_the_same_bytes_again(tmp_path, suffix):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        WRITERS[suffix](small_breast(), FRAME, tmp_path / folder / f"v{suffix}")
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


@pytest.mark.parametrize("suffix", [s for s in WRITERS if s not in (".npz", ".tif", ".tiff")])
def test_other_programs_find_the_voxels_where_they_are(tmp_path, suffix):
    """By SimpleITK: patient axes, but for VICTRE's own axes in MHD."""
    WRITERS[suffix](small_breast(), FRAME, tmp_path / f"b{suffix}")
    image = sitk.ReadImage(str(tmp_path / f"b{suffix}"))
    place = np.array(image.TransformIndexToPhysicalPoint((2, 3, 4)))
    expected = FRAME.position_mm([2, 3, 4])
    if suffix != ".mhd":
        place = BREAST_FROM_LPS @ place
    np.testing.assert_allclose(place, expected, rtol=1e-5)
    assert image.GetPixel(0, 2, 8) == 88


def test_imagej_finds_size_and_origin_in_a_tiff(tmp_path):
    WRITERS[".tif"](small_breast(), FRAME, tmp_path / "b.tif")
    with tifffile.TiffFile(tmp_path / "b.tif") as tiff:
        described = tiff.imagej_metadata
        width = tiff.pages[0].tags["XResolution"].value
        np.testing.assert_array_equal(tiff.asarray(), small_breast().transpose(2, 1, 0))
    assert (described["spacing"], described["unit"], described["slices"]) == (1.0, "mm", 11)
    assert width[0] / width[1] == 2.0
    # ImageJ: place = (index - origin) * size
    assert (0 - described["yorigin"]) * SPACING[1] == pytest.approx(ORIGIN[1])


def test_the_metaimage_header_tells_the_truth_in_victres_order(tmp_path):
    WRITERS[".mhd"](
        small_breast(), VoxelFrame(ORIGIN, np.full(3, 1e-5), FRAME.shape), tmp_path / "b.mhd"
    )
    lines = (tmp_path / "b.mhd").read_text().splitlines()
    # breastCompress.cxx reads the 7th, 9th and 10th line.
    assert lines[6] == "Offset = 3 -20 12.5"
    assert lines[8] == "ElementSpacing = 0.00001 0.00001 0.00001"
    assert lines[9] == "DimSize = 7 9 11"
    assert "CompressedData = True" in lines
    assert lines[-1] == "ElementDataFile = b.raw.gz"
    raw = gzip.decompress((tmp_path / "b.raw.gz").read_bytes())
    assert raw == small_breast().tobytes(order="F")


@pytest.mark.parametrize("target", WRITERS)
@pytest.mark.parametrize("source", [suffix for suffix in FORMATS if suffix not in OWN_CODES])
def test_from_every_format_to_every_format(tmp_path, source, target):
    path = save(tmp_path / f"in.{source.lstrip('.')}", small_breast())
    convert_volume(path, tmp_path / f"out{target}")
    before, after = read_volume(path), read_volume(tmp_path / f"out{target}")
    assert after.values.dtype == np.uint8
    np.testing.assert_array_equal(after.values, before.values)
    np.testing.assert_allclose(after.voxel_mm, before.voxel_mm, rtol=NIFTI_RTOL)
    np.testing.assert_allclose(after.origin_mm, before.origin_mm, rtol=NIFTI_RTOL, atol=1e-12)


def test_labels_are_translated_on_request(tmp_path):
    values = small_breast()
    values[values == 29] = 2  # gland in segmented breast CT
    values[values > 2] = 3
    folder = save_series(tmp_path / "series", values)
    done = convert_volume(folder, tmp_path / "b.nrrd", labels="breast-ct")
    assert set(done.counts) == {0, 1, 2, 29}
    breast = read_phantom(tmp_path / "b.nrrd")
    np.testing.assert_array_equal(breast.labels == 29, values == 2)
    (tmp_path / "map.yaml").write_text("0: air\n1: adipose\n2: gland\n")
    with pytest.raises(InputError, match=r"label 3 \(.* mL\) is not in the label map"):
        convert_volume(folder, tmp_path / "b.nrrd", labels=str(tmp_path / "map.yaml"))


def test_whole_numbers_in_floats_become_the_smallest_type(tmp_path):
    path = save_itk(tmp_path / "b.nrrd", small_breast().astype(np.float64) - 1)
    convert_volume(path, tmp_path / "b.mha")
    assert sitk.ReadImage(str(tmp_path / "b.mha")).GetPixelID() == sitk.sitkInt8
    with pytest.raises(InputError, match=r"a TIFF holds labels from 0 to 65535.*found int8"):
        convert_volume(path, tmp_path / "b.tif")


def test_labels_beyond_32_bits(tmp_path):
    np.save(tmp_path / "b.npy", small_breast().astype(np.int64) << 40)
    with pytest.raises(InputError, match="do not fit into 32 bits"):
        convert_volume(tmp_path / "b.npy", tmp_path / "b.nrrd")


def test_the_source_is_not_written_over(tmp_path):
    path = save(tmp_path / "b.mha", small_breast())
    with pytest.raises(InputError, match=r"b\.mha: is the source itself"):
        convert_volume(path, tmp_path / "x" / ".." / "b.mha")
    WRITERS[".mhd"](small_breast(), FRAME, tmp_path / "c.mhd")
    (tmp_path / "d.mhd").write_text((tmp_path / "c.mhd").read_text())
    with pytest.raises(InputError, match=r"c\.mhd: is the source itself"):
        convert_volume(tmp_path / "d.mhd", tmp_path / "c.mhd")


def test_unknown_targets(tmp_path):
    path = save(tmp_path / "b.mha", small_breast())
    for name in ("b.stl", "b.npy", "b.vctx", "b"):
        with pytest.raises(InputError, match=r"expected a name ending in \.mhd, \.mha, \.nrrd"):
            convert_volume(path, tmp_path / name)


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path, suffix):
    values = np.random.default_rng(1).integers(0, 255, (40, 40, 40)).astype(np.uint8)
    frame = VoxelFrame(np.zeros(3), np.ones(3), (40, 40, 40))
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limit[1]))
    try:
        with pytest.raises(InputError, match=r"c\..*: cannot be written \(.+\)"):
            WRITERS[suffix](values, frame, tmp_path / f"c{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []


def invoke(*arguments: object):
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


def test_convert_on_the_command_line(tmp_path):
    path = save(tmp_path / "b.npy", small_breast())
    result = invoke(
        "convert", path, tmp_path / "b.nrrd", "--voxel-mm", "0.5,0.75,1", "--axes", "ALS"
    )
    assert result.exit_code == 0, result.output
    assert "b.nrrd: 7 x 9 x 11 voxels of 0.5 x 0.75 x 1 mm" in result.output
    assert "labels: 0, 1, 29, 33, 88" in result.output
    np.testing.assert_array_equal(read_volume(tmp_path / "b.nrrd").values, small_breast())
    result = invoke("info", tmp_path / "b.nrrd", "--reduce", 2)
    assert "3 x 4 x 5 voxels of 1 x 1.5 x 2 mm" in result.output
    assert (
        "orientation: axes run ALS by its header; say otherwise with phantom.axes" in result.output
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("--voxel-mm", "a"), "--voxel-mm: found 'a', expected one number or three"),
     (("--voxel-mm", "1,2"), "--voxel-mm: found '1,2'"),
     (("--voxel-mm", "0"), "voxel size is [0.0, 0.0, 0.0] mm, expected three positive"),
     (("--axes", "XYZ"), "phantom.axes: found 'XYZ', expected three letters such as ALS"),
     (("--reduce", "9"), "phantom.reduce: found 9, expected 1 to 7"),
     (("--labels", "nowhere"), "phantom.labels: found 'nowhere'")],
)  # fmt: skip
@pytest.mark.parametrize("command", ["info", "convert"])
def test_bad_options_exit_2_with_a_plain_line(tmp_path, command, arguments, message):
    path = save(tmp_path / "b.npz", small_breast())
    target = [tmp_path / "out.mha"] if command == "convert" else []
    result = invoke(command, path, *target, *arguments)
    assert result.exit_code == 2
    assert message in result.output
    assert "Traceback" not in result.output
    assert not (tmp_path / "out.mha").exists()


def test_convert_from_a_missing_file(tmp_path):
    result = invoke("convert", tmp_path / "no.mhd", tmp_path / "b.mha")
    assert result.exit_code == 2
    assert "no.mhd: no such file" in result.output
