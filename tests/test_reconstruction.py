"""Slices from a series of projections: where clips are found, and how the volume is laid out."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.geometry import Gantry, View
from mammosim.reconstruction import Box, ReconstructionSettings, volume_grid
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


def arc_of(gantry, angle_range_deg, count):
    half = 0.5 * angle_range_deg
    return [replace(gantry, tube_angle_deg=float(a)) for a in np.linspace(-half, half, count)]


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
@pytest.mark.parametrize("side", ["L", "R"])
def test_clips_are_found_at_their_height(method, side):
    _needs_rtk()
    gantries = arc_of(gantry_of(side), 50.0, 25)
    grid = volume_grid(gantries[0], THICKNESS_MM, 1.0)
    volume = reconstruct_by_rtk(
        pictures(gantries), gantries, WHOLE, grid, ReconstructionSettings(method=method)
    ).transpose(0, 2, 1)
    for clip in CLIPS_MM:
        found = grid.gantry_from_voxel(_peak(volume, grid.voxel_of(clip)))
        # Half a slice in depth, and a fifth of a millimetre in the slice.
        assert abs(found[2] - clip[2]) <= 0.5
        assert np.hypot(*(found - clip)[:2]) <= 0.2


def _needs_rtk():
    try:
        load_rtk()
    except InputError as missing:
        pytest.skip(str(missing))


def test_without_the_library_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "itk", None)
    with pytest.raises(InputError, match=r"itk-rtk cannot be imported.*mammosim\[dbt\]"):
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
