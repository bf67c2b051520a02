"""Slices from a series of projections: where clips are found, and how the volume is laid out."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.geometry import Gantry, View
from mammosim.reconstruction import (
    Box,
    ReconstructionSettings,
    synthetic_mammogram,
    volume_grid,
)
from mammosim.reconstruction.rtk import load_rtk, reconstruct_by_rtk

PIXEL_MM, THICKNESS_MM = 0.5, 50.0
CLIPS_MM = np.array([[30.0, -20.0, 9.3], [40.0, 5.0, 22.1], [25.0, 25.0, 34.0]])
WHOLE = Box(0, 160, 0, 120)
WIDTH_MM = 0.5
"""Standard deviation of a clip's picture, mm."""


def gantry_of(side):
    rows, columns = WHOLE.rows, WHOLE.columns
    return Gantry(
        View("CC", side, tomosynthesis=True), 3.0, -25.0, 650.0, 15.0, 0.0, PIXEL_MM, rows, columns,
        -0.5 * rows * PIXEL_MM, 0.0, 50.0,
    )  # fmt: skip


def arc_of(gantry, angle_range_deg, count, turn=0.0):
    """Tube positions of an arc; the detector turns by a part of the tube's angle."""
    half = 0.5 * angle_range_deg
    return [
        replace(gantry, tube_angle_deg=float(a), detector_angle_deg=turn * float(a))
        for a in np.linspace(-half, half, count)
    ]


def pictures(gantries):
    """[projection, column, row]: a round spot where each clip is seen."""
    stack = np.zeros((len(gantries), gantries[0].columns, gantries[0].rows), np.float32)
    column, row = np.mgrid[: gantries[0].columns, : gantries[0].rows]
    for picture, gantry in zip(stack, gantries, strict=True):
        for there_row, there_column in gantry.project(CLIPS_MM):
            squared = (row - there_row) ** 2 + (column - there_column) ** 2
            picture += np.exp(-0.5 * squared * (PIXEL_MM / WIDTH_MM) ** 2)
    return stack


@pytest.mark.parametrize("side", ["L", "R"])
def test_voxels_are_where_the_detector_sees_them(side):
    gantry = gantry_of(side)
    grid = volume_grid(gantry, THICKNESS_MM, 1.0, 0.7)
    assert grid.shape == (50, 115, 86)
    back = grid.gantry_from_voxel(grid.voxel_of(CLIPS_MM))
    np.testing.assert_allclose(back, CLIPS_MM, atol=1e-9)
    # On the detector itself a voxel's row and column are the picture's, but for the pixel size.
    flat = CLIPS_MM.copy()
    flat[:, 2] = -gantry.support_to_detector_mm
    edge = (gantry.project(flat) + 0.5) * gantry.pixel_mm
    np.testing.assert_allclose((grid.voxel_of(flat)[:, 1:] + 0.5) * 0.7, edge, atol=1e-9)


@pytest.mark.service
@pytest.mark.parametrize("method", ["fdk", "sart"])
@pytest.mark.parametrize(("side", "turn"), [("L", 0.0), ("R", 0.0), ("R", 0.28)])
def test_clips_are_found_at_their_height(method, side, turn):
    """With a detector that stays, and one that turns as Hologic's does."""
    _needs_rtk()
    gantries = arc_of(gantry_of(side), 50.0, 25, turn)
    grid = volume_grid(gantries[0], THICKNESS_MM, 1.0)
    volume = reconstruct_by_rtk(
        pictures(gantries), gantries, WHOLE, grid, ReconstructionSettings(method=method)
    ).transpose(0, 2, 1)
    for clip in CLIPS_MM:
        found = grid.gantry_from_voxel(_peak(volume, grid.voxel_of(clip)))
        # Half a slice in depth, and a fifth of a millimetre in the slice.
        assert abs(found[2] - clip[2]) <= 0.5
        assert np.hypot(*(found - clip)[:2]) <= 0.2


@pytest.mark.service
def test_the_chest_wall_is_no_line():
    """A slab of 0.05 per mm that begins at the detector's edge."""
    _needs_rtk()
    gantries = arc_of(gantry_of("L"), 20.0, 7)
    column, row = np.mgrid[: WHOLE.columns, : WHOLE.rows]
    stack = np.zeros((len(gantries), WHOLE.columns, WHOLE.rows), np.float32)
    for picture, gantry in zip(stack, gantries, strict=True):
        pixel = gantry.detector_mm(row, column)
        way = gantry.focal_spot_mm - pixel
        picture[:] = 0.05 * THICKNESS_MM * np.linalg.norm(way, axis=-1) / way[..., 2]
    grid = volume_grid(gantries[0], THICKNESS_MM, 1.0)
    volume = reconstruct_by_rtk(
        stack, gantries, WHOLE, grid, ReconstructionSettings(method="sart")
    ).transpose(0, 2, 1)
    middle = volume[10:40, 70:90].mean(axis=(0, 1))
    np.testing.assert_allclose(middle[:20], 0.05, rtol=0.1)


def _needs_rtk():
    try:
        load_rtk()
    except InputError as missing:
        pytest.skip(str(missing))


def test_the_synthetic_picture_keeps_the_sum_and_shows_a_speck_of_one_slice():
    """A speck that a sum of slices dilutes keeps the contrast of its own slice."""
    rng = np.random.default_rng(4)
    slices = np.zeros((40, 120, 100), np.float32)
    slices[:, 10:110, :80] = 0.05
    slices[:, 60:110, :80] += 0.02
    slices[17, 30, 40] += 0.08
    slices += rng.normal(0.0, 0.003, slices.shape).astype(np.float32)
    made = synthetic_mammogram(slices, 1.0, 0.5)
    around = np.s_[24:37, 34:47]
    plain = slices.sum(axis=0)

    def contrast(picture):
        part = picture[around]
        ring = np.abs(np.arange(13) - 6) > 2
        return (part[6, 6] - part[ring].mean()) / part[ring].std()

    assert contrast(made.attenuation) > 2.0 * contrast(plain) > 0.0
    # Away from edges it is the sum of the slices: the noise of many adds up to nothing.
    for part in (np.s_[20:28, 10:30], np.s_[80:100, 20:60]):
        assert made.attenuation[part].mean() == pytest.approx(plain[part].mean(), rel=0.01)
    assert made.pixels.shape == plain.shape
    assert made.pixels[80:100, 20:60].mean() > made.pixels[25:45, 10:30].mean() > 100
    assert (made.pixels[:8] == 0).mean() > 0.95  # air, but for the grain of single pixels
    assert made.pixels.max() <= 4095


def test_without_the_library_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "itk", None)
    with pytest.raises(InputError, match=r"itk-rtk cannot be imported.*pip install itk-rtk"):
        load_rtk()


def _peak(volume, voxel, reach=6):
    """Centre of the upper half of the peak nearest to a voxel, along each axis."""
    start = np.round(voxel).astype(int) - [8, reach, reach]
    stop = start + np.array([17, 2 * reach + 1, 2 * reach + 1])
    start, stop = np.maximum(start, 0), np.minimum(stop, volume.shape)
    box = volume[tuple(slice(a, b) for a, b in zip(start, stop, strict=True))]
    top = np.clip(box - 0.5 * box.max(), 0.0, None)
    return start + [
        np.average(np.arange(box.shape[axis]), weights=top.sum(tuple({0, 1, 2} - {axis})))
        for axis in range(3)
    ]
