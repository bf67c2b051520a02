"""The slices of tomosynthesis on the page: one small picture each, and the targets on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mammosim._wording import counted
from mammosim.reconstruction import Reconstruction, Synthetic
from mammosim.report.figures import block_means, jpeg_data_uri
from mammosim.report.hanging import ReportedView, targets_of
from mammosim.targets import Target

MAX_ROWS = 520
"""Rows of a picture; slices are reduced to them by whole factors."""

MAX_SLICES = 60
"""Pictures of one view; of more slices, every second, third ... is shown."""

MIN_RADIUS_MM = 3.0
"""Radius of a target's circle, mm, so that a clip can be seen in it."""


def slice_stacks(views: Sequence[ReportedView], targets: Sequence[Target]) -> list[dict[str, Any]]:
    """What the page's slider shows of each view whose slices were reconstructed.

    Parameters
    ----------
    views : sequence of ReportedView
    targets : sequence of Target
        Rows of lesions.csv.

    Returns
    -------
    list of dict
        Plain values: name, text, size in pixels of the slices, pictures, heights in mm and marks;
        the synthetic picture, empty where there is none.
    """
    stacks = []
    for view in views:
        if view.reconstruction is not None:
            seen = view.compressed.view
            stacks.append(_stack(view.reconstruction, seen.folder, targets_of(seen, targets)))
    return stacks


def _stack(volume: Reconstruction, name: str, rows_of_view: Sequence[Target]) -> dict[str, Any]:
    slices, rows, columns = volume.grid.shape
    factor, step = max(1, math.ceil(rows / MAX_ROWS)), max(1, math.ceil(slices / MAX_SLICES))
    low, high = volume.shown_range
    shown = range(0, slices, step)
    frames = []
    for number in shown:
        pixels = block_means(volume.slices[number], factor)
        grey = np.rint(np.interp(pixels, [low, high], [0.0, 255.0]))
        frames.append(jpeg_data_uri(grey.astype(np.uint8)))
    method, made = volume.settings.method.upper(), volume.synthetic
    return {
        "name": name,
        "text": f"{counted(slices, 'slice')} of {volume.grid.slice_mm:g} mm by {method}"
        + (f", 1 in {step} shown" if step > 1 else ""),
        "synthetic": "" if made is None else _synthetic_uri(made, factor),
        "columns": columns,
        "rows": rows,
        "frames": frames,
        "heights": [
            round(float(volume.grid.gantry_from_voxel([number, 0, 0])[2]), 2) for number in shown
        ],
        "marks": [
            _mark(target, volume)
            for target in rows_of_view
            if target.kind != "nipple" and math.isfinite(target.volume_slice)
        ],
    }


def _synthetic_uri(made: Synthetic, factor: int) -> str:
    grey = np.rint(block_means(made.pixels, factor) * (255.0 / 4095.0))
    return jpeg_data_uri(grey.astype(np.uint8))


def _mark(target: Target, volume: Reconstruction) -> dict[str, Any]:
    """Where a target is, in pixels of the slices and in mm of height."""
    reach_mm = 0.5 * target.extent_mm if math.isfinite(target.extent_mm) else 0.0
    return {
        "number": str(target.target_id),
        "name": target.name,
        "kind": target.kind,
        "x": round(target.volume_col_px + 0.5, 1),  # the middle of the first pixel is at 0.5
        "y": round(target.volume_row_px + 0.5, 1),
        "radius": round(max(reach_mm, MIN_RADIUS_MM) / volume.grid.pixel_mm, 1),
        "height": round(target.compressed_z_mm, 1),
        "reach": round(max(reach_mm, volume.grid.slice_mm), 1),
    }
