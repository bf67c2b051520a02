"""TIFF, PNG and NumPy files: pixels, spacing, and reruns."""

from __future__ import annotations

import contextlib
import dataclasses
import signal

import numpy as np
import pytest
import tifffile
from make_records import make_gantry, make_mammogram, make_paths, make_targets
from PIL import Image

from mammosim.errors import InputError
from mammosim.export import (
    write_density_tiff,
    write_full_picture,
    write_glandular_tiff,
    write_lesion_lengths_tiff,
    write_mammogram_tiff,
    write_path_lengths,
    write_preview,
)
from mammosim.export.pictures import through_window
from mammosim.geometry import View

resource = pytest.importorskip("resource", reason="limits of the operating system are needed")

VIEW = View("CC", "L")
MAMMOGRAM = make_mammogram(VIEW)


def test_the_tiff_holds_the_for_processing_pixels_and_their_pitch(tmp_path):
    write_mammogram_tiff(MAMMOGRAM, tmp_path / "mammogram.tif")
    with tifffile.TiffFile(tmp_path / "mammogram.tif") as file:
        page = file.pages[0]
        np.testing.assert_array_equal(page.asarray(), MAMMOGRAM.for_processing)
        assert page.dtype == np.uint16
        numerator, denominator = page.tags["XResolution"].value
        assert page.tags["ResolutionUnit"].value == 3  # centimetre
        assert 10.0 * denominator / numerator == pytest.approx(0.5, rel=1e-7)  # 32-bit ratio


def test_other_programs_read_the_tiff(tmp_path):
    write_mammogram_tiff(MAMMOGRAM, tmp_path / "mammogram.tif")
    with Image.open(tmp_path / "mammogram.tif") as image:
        np.testing.assert_array_equal(np.asarray(image), MAMMOGRAM.for_processing)
        assert image.info["dpi"][0] == pytest.approx(25.4 / 0.5, rel=1e-6)


def test_the_preview_is_the_picture_through_its_window(tmp_path):
    write_preview(MAMMOGRAM, tmp_path / "preview.png")
    with Image.open(tmp_path / "preview.png") as image:
        assert image.mode == "L"
        expected = through_window(MAMMOGRAM.for_presentation, 2200.0, 2400.0)
        np.testing.assert_array_equal(np.asarray(image), expected)
        # pHYs counts whole pixels a metre: 2000 here.
        assert image.info["dpi"][0] == pytest.approx(25.4 / 0.5, rel=1e-3)


def test_the_full_picture_has_16_bits_and_every_pixel(tmp_path):
    write_full_picture(MAMMOGRAM, tmp_path / "for_presentation.png")
    with Image.open(tmp_path / "for_presentation.png") as image:
        grey = np.asarray(image)
        assert image.info["dpi"][0] == pytest.approx(25.4 / 0.5, rel=1e-3)
    assert grey.dtype == np.uint16
    assert grey.shape == MAMMOGRAM.for_presentation.shape
    assert (grey.min(), grey.max()) == (0, 65535)
    eight = through_window(MAMMOGRAM.for_presentation, 2200.0, 2400.0)
    np.testing.assert_allclose(grey / 257.0, eight, atol=0.501)  # to half a level of 8 bits


def test_a_large_preview_is_halved_and_says_so(tmp_path):
    pixels = np.zeros((2001, 2000), np.uint16)
    pixels[0::2, 0::2] = 4000  # mean of each 2 x 2 block: 1000
    gantry = dataclasses.replace(make_gantry(VIEW, 0.1), rows=2001, columns=2000)
    large = dataclasses.replace(
        MAMMOGRAM, for_presentation=pixels, gantry=gantry, window_center=1000.5, window_width=2001
    )
    write_preview(large, tmp_path / "preview.png")
    with Image.open(tmp_path / "preview.png") as image:
        assert image.size == (1000, 1000)
        assert set(np.unique(np.asarray(image))) == {128}
        assert image.info["dpi"][0] == pytest.approx(25.4 / 0.2, rel=1e-3)


def test_the_window_clips_and_is_linear_between():
    grey = through_window(np.array([0, 99, 100, 150, 200, 201, 65535]), 150.5, 101.0)
    assert grey.tolist() == [0, 0, 0, 128, 255, 255, 255]


def test_glandular_thickness_is_the_glands_length_alone(tmp_path):
    paths = make_paths(VIEW)
    write_glandular_tiff(paths, tmp_path / "gland.tif")
    thickness = tifffile.imread(tmp_path / "gland.tif")
    assert thickness.dtype == np.float32
    np.testing.assert_array_equal(thickness, paths.length_mm[1])


def test_channels_of_glandular_material_are_added(tmp_path):
    paths = dataclasses.replace(
        make_paths(VIEW), materials=("gland", "gland", "mass", "calcification", "titanium")
    )
    write_glandular_tiff(paths, tmp_path / "gland.tif")
    expected = paths.length_mm[0] + paths.length_mm[1]
    np.testing.assert_allclose(tifffile.imread(tmp_path / "gland.tif"), expected, rtol=1e-6)


def test_density_is_gland_over_all_but_muscle(tmp_path):
    plain = make_paths(VIEW)
    paths = dataclasses.replace(
        plain, materials=("adipose", "gland", "muscle", "calcification", "titanium")
    )
    write_density_tiff(paths, tmp_path / "density.tif")
    density = tifffile.imread(tmp_path / "density.tif")
    breast = paths.length_mm.sum(axis=0) - paths.length_mm[2]
    assert np.isnan(density[breast == 0.0]).all()
    expected = 100.0 * paths.length_mm[1][breast > 0.0] / breast[breast > 0.0]
    np.testing.assert_allclose(density[breast > 0.0], expected, rtol=1e-6)
    assert density[breast > 0.0].max() > 10.0


def test_lesion_lengths_are_pages_that_name_their_lesion(tmp_path):
    paths = make_paths(VIEW)
    write_lesion_lengths_tiff(paths, make_targets(VIEW), tmp_path / "lengths.tif")
    with tifffile.TiffFile(tmp_path / "lengths.tif") as file:
        named = [page.description for page in file.pages]
        assert named == ["target_id 1: mass 1", "target_id 2: calcs", "target_id 3: clip A"]
        for page, channel in zip(file.pages, (2, 3, 4), strict=True):
            np.testing.assert_array_equal(page.asarray(), paths.length_mm[channel])


def test_path_lengths_come_back_without_pickles(tmp_path):
    paths = make_paths(VIEW)
    write_path_lengths(paths, tmp_path / "path_lengths.npz")
    with np.load(tmp_path / "path_lengths.npz", allow_pickle=False) as archive:
        assert tuple(archive["tissues"]) == paths.tissues
        assert tuple(archive["lesion_labels"]) == paths.lesion_labels
        np.testing.assert_array_equal(archive["length_mm"], paths.length_mm)
        assert archive["pixel_mm"] == paths.pixel_mm


@pytest.mark.parametrize(
    "write",
    [
        lambda path: write_mammogram_tiff(MAMMOGRAM, path.with_suffix(".tif")),
        lambda path: write_preview(MAMMOGRAM, path.with_suffix(".png")),
        lambda path: write_path_lengths(make_paths(VIEW), path.with_suffix(".npz")),
    ],
)
def test_reruns_are_identical_and_a_full_disk_leaves_nothing(tmp_path, write, limited_files):
    write(tmp_path / "a")
    write(tmp_path / "b")
    first, second = sorted(tmp_path.iterdir())
    assert first.read_bytes() == second.read_bytes()
    with limited_files(2000), pytest.raises(InputError, match=r"c\.\w+: cannot be written \(.+\)"):
        write(tmp_path / "c")
    assert sorted(tmp_path.iterdir()) == [first, second]


@pytest.fixture
def limited_files():
    """A context in which no file can grow beyond a number of bytes, as on a full disk."""

    @contextlib.contextmanager
    def limit(size: int):
        old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        old_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, old_limit[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old_limit)
            signal.signal(signal.SIGXFSZ, old_handler)

    return limit
