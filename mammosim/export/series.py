"""A series of projections: a stack with its geometry, and where each lesion is on every one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Tomosynthesis
from mammosim.export.dicom_object import save_object
from mammosim.export.dicom_series import Intent
from mammosim.export.gantry_file import write_geometry
from mammosim.export.identity import StudyIdentity
from mammosim.export.path_lengths import write_path_lengths
from mammosim.export.pictures import (
    write_glandular_tiff,
    write_preview,
    write_stack_tiff,
)
from mammosim.export.projection_objects import write_projections
from mammosim.export.settings import ExportSettings
from mammosim.export.slice_masks import SliceMask, write_slice_masks
from mammosim.export.slice_objects import slice_dataset
from mammosim.export.synthetic_object import SYNTHETIC, write_synthetic
from mammosim.export.volumes import write_slices
from mammosim.geometry import Gantry
from mammosim.projection import PathLengths
from mammosim.reconstruction import METHOD, Reconstruction

INTENTS: tuple[Intent, Intent] = ("processing", "presentation")
PROJECTIONS = "projections.tif"
SLICES = "reconstruction.nii.gz"


def write_series(
    folder: str | PathLike[str],
    series: Tomosynthesis,
    middle: PathLengths,
    lesion_images: Sequence[NDArray[np.unsignedinteger]],
    settings: ExportSettings,
    study: StudyIdentity,
) -> None:
    """Write the pictures of a view taken as a series of projections.

    Parameters
    ----------
    folder : path
        The view's folder, as ``run/LCC_DBT``.
    series : Tomosynthesis
    middle : PathLengths
        Of the middle projection, for the files that are written on request.
    lesion_images : sequence of ndarray of uint8 or uint16, [row, column]
        Label image of each projection (see `label_image`); empty for none.
    settings : ExportSettings
    study : StudyIdentity

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    folder = Path(folder)
    pixel_mm = series.middle.gantry.pixel_mm
    write_geometry(series.middle.gantry, folder / "geometry.json")
    if settings.dicom:
        for intent in INTENTS:
            write_projections(
                series, intent, folder / f"projections_for_{intent}.dcm", study, settings
            )
    if settings.tiff:
        write_stack_tiff(series.projections, pixel_mm, folder / PROJECTIONS)
        if lesion_images:
            write_stack_tiff(lesion_images, pixel_mm, folder / "lesion_mask.tif", "zlib")
    if settings.png:
        write_preview(series.middle, folder / "preview.png")
    if settings.path_lengths:
        write_path_lengths(middle, folder / "path_lengths.npz")
    if settings.glandular_thickness:
        write_glandular_tiff(middle, folder / "glandular_thickness.tif")


def write_reconstruction(
    folder: str | PathLike[str],
    series: Tomosynthesis,
    volume: Reconstruction,
    masks: Sequence[SliceMask],
    settings: ExportSettings,
    study: StudyIdentity,
) -> None:
    """Write the slices of a view taken as a series of projections.

    Parameters
    ----------
    folder : path
        The view's folder, as ``run/LCC_DBT``.
    series : Tomosynthesis
    volume : Reconstruction
    masks : sequence of SliceMask
        Of its lesions (see `slice_masks`).
    settings : ExportSettings
    study : StudyIdentity

    Raises
    ------
    InputError
        If a file cannot be written.
    """
    folder = Path(folder)
    if settings.volumes:
        write_slices(volume, folder / SLICES)
    if settings.dicom:
        slices = slice_dataset(series, volume, study, settings)
        save_object(slices, folder / "reconstruction.dcm")
        if any(one.mask.any() for one in masks):
            path = folder / "reconstruction_lesions.dcm"
            write_slice_masks(masks, slices, volume, path, study, settings)
    write_synthetic(folder, series, volume, settings, study)


def series_geometry(series: Tomosynthesis) -> dict[str, Any]:
    """Where tube and pixels were, in plain values for run.json.

    Parameters
    ----------
    series : Tomosynthesis

    Returns
    -------
    dict
        Lengths in mm in the gantry frame: x from the detector's chest-wall edge, y along it, z up
        from the breast support. The centre of pixel [row, column] is at
        ``first_pixel_mm + row * row_step_mm + column * column_step_mm`` in every projection; where
        the detector turns, each projection has its own, and the first are those of the upright
        detector.
    """
    gantry = series.middle.gantry
    turns = any(turned.detector_angle_deg for turned in series.gantries)
    return {
        "frame": "gantry: x from the detector's edge, y along it, z above the support; mm",
        "pages": PROJECTIONS,
        "detector": "turning" if turns else "stationary",
        "rows": gantry.rows,
        "columns": gantry.columns,
        **_pixel_places(replace(gantry, detector_angle_deg=0.0)),
        "source_to_detector_mm": gantry.source_to_detector_mm,
        "pivot_mm": _rounded(
            [
                0.0,
                gantry.focal_spot_y_mm,
                gantry.pivot_to_detector_mm - gantry.support_to_detector_mm,
            ]
        ),
        "pivot_axis": [1.0, 0.0, 0.0],
        "thickness_mm": series.middle.thickness_mm,
        "counts_per_kev": series.counts_per_kev,
        "mas": series.mas,
        "dose_mgy": series.dose_mgy,
        "projections": [
            {
                "page": page,
                "angle_deg": round(turned.tube_angle_deg, 9),
                "focal_spot_mm": _rounded(turned.focal_spot_mm),
                **(_turned_detector(turned) if turns else {}),
                "mas": float(series.loads_mas[page]),
                "dose_factor": round(float(series.dose_factors[page]), 6),
                "scatter_to_primary_ratio": round(float(series.scatter_to_primary[page]), 6),
            }
            for page, turned in enumerate(series.gantries)
        ],
    }


def _turned_detector(gantry: Gantry) -> dict[str, Any]:
    return {"detector_angle_deg": round(gantry.detector_angle_deg, 9), **_pixel_places(gantry)}


def _pixel_places(gantry: Gantry) -> dict[str, list[float]]:
    """Place of the first pixel's centre, and the steps to the next row and column, mm."""
    first, down, right = (
        gantry.detector_mm(row, column) for row, column in ((0, 0), (1, 0), (0, 1))
    )
    return {
        "first_pixel_mm": _rounded(first),
        "row_step_mm": _rounded(down - first),
        "column_step_mm": _rounded(right - first),
    }


def reconstruction_geometry(volume: Reconstruction) -> dict[str, Any]:
    """Where the voxels of a reconstruction are, in plain values for run.json.

    Parameters
    ----------
    volume : Reconstruction

    Returns
    -------
    dict
        Lengths in mm in the gantry frame. The centre of voxel [slice, row, column] is at
        ``first_voxel_mm + slice * slice_step_mm + row * row_step_mm + column * column_step_mm``.
    """
    grid = volume.grid
    slices, rows, columns = grid.shape
    first, up, down, right = grid.gantry_from_voxel([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    made = {"file": f"{SYNTHETIC}.dcm", "method": METHOD, "by": "mammosim; no manufacturer's"}
    return {
        **volume.settings.model_dump(mode="json", exclude_none=True),
        "file": SLICES,
        "slices": slices,
        "rows": rows,
        "columns": columns,
        "first_voxel_mm": _rounded(first),
        "slice_step_mm": _rounded(up - first),
        "row_step_mm": _rounded(down - first),
        "column_step_mm": _rounded(right - first),
        **({"synthetic": made} if volume.synthetic is not None else {}),
    }


def _rounded(place_mm: Any) -> list[float]:
    """To a millionth of a millimetre; no negative zeros."""
    return [round(float(value), 6) + 0.0 for value in place_mm]
