"""Slices of tomosynthesis on the page: a picture each, and targets in those that they reach."""

from dataclasses import replace

import numpy as np
import pytest
from make_records import make_compressed, make_mammogram, make_targets

from mammosim.geometry import View
from mammosim.reconstruction import Reconstruction, ReconstructionSettings, Synthetic, volume_grid
from mammosim.report import ReportedView, render_report, run_record
from mammosim.report.slices import slice_stacks
from mammosim.targets import in_volume

VIEW = View("CC", "L", tomosynthesis=True)


def reported(slices=5):
    mammogram = make_mammogram(VIEW)
    grid = volume_grid(mammogram.gantry, 52.0, 52.0 / slices)
    values = np.linspace(0.02, 0.06, grid.voxels, dtype=np.float32).reshape(grid.shape)
    settings = ReconstructionSettings(method="sart")
    volume = Reconstruction(values, grid, mammogram.gantry, settings)
    targets = [in_volume(target, grid) for target in make_targets(VIEW)]
    return ReportedView(make_compressed(VIEW), mammogram, volume), targets


def test_marks_are_where_the_table_says():
    view, targets = reported()
    (stack,) = slice_stacks([view], targets)
    assert len(stack["frames"]) == 5
    assert stack["heights"] == pytest.approx([5.2, 15.6, 26.0, 36.4, 46.8])
    (mass, row) = stack["marks"][0], targets[0]
    assert (mass["x"], mass["y"]) == pytest.approx(
        (row.volume_col_px + 0.5, row.volume_row_px + 0.5), abs=0.06
    )
    place = view.reconstruction.grid.gantry_from_voxel(
        [row.volume_slice, row.volume_row_px, row.volume_col_px]
    )
    expected = [row.compressed_x_mm, row.compressed_y_mm, row.compressed_z_mm]
    np.testing.assert_allclose(place, expected, atol=1e-9)


def test_many_slices_are_thinned_out():
    (stack,) = slice_stacks([reported(150)[0]], [])
    assert len(stack["frames"]) == 50
    assert "1 in 3 shown" in stack["text"]


def test_the_page_holds_the_slider_only_where_there_are_slices(tmp_path, monkeypatch):
    monkeypatch.setattr("mammosim.report.lesion_shift.plotly_gzip_base64", lambda: "")
    record = run_record(
        tmp_path, status="done", seed=3, settings={}, stage_seconds={}, warnings=[], run_hash="ab"
    )
    view, targets = reported()
    page = render_report([view], targets, record)
    assert 'id="slices"' in page
    assert page.count("data:image/jpeg;base64,") >= 5
    assert "Synthetic 2-D picture, computed by mammosim" not in page
    pixels = np.full(view.reconstruction.grid.shape[1:], 4095, np.uint16)
    made = replace(view.reconstruction, synthetic=Synthetic(pixels.astype(np.float32), pixels))
    page = render_report([replace(view, reconstruction=made)], targets, record)
    assert "Synthetic 2-D picture, computed by mammosim" in page
    assert "not a manufacturer" in page
    series = {"projections": 5.0, "dose_of_all_projections_mgy": 7.3}
    taken = replace(view.mammogram, measures={**view.mammogram.measures, **series})
    page = render_report([replace(view, mammogram=taken)], targets, record)
    assert "the middle one of 5 projections" in page
    assert page.count("7.30 mGy in all") == 2  # under the picture and among the first things said
    without = render_report([replace(view, reconstruction=None)], targets, record)
    assert 'id="slices"' not in without
