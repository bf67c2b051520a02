"""What can be known before a breast is projected: pictures too large, detectors too small."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.projection.coarse_copy import check_coarse_size
from mammosim.projection.detector_field import formats_mm, pixels_of, place_detector, turned
from mammosim.projection.settings import ProjectionSettings, TomosynthesisSettings
from mammosim.projection.voxel_map import voxel_map

BYTES_PER_LENGTH = 4  # single precision
BYTES_PER_RECORD = 2  # 16 bits
MIN_CHANNELS = 3  # fat, gland and skin: hardly a phantom has fewer


def check_memory(
    settings: ProjectionSettings,
    shape: tuple[int, int] | None = None,
    channels: int = MIN_CHANNELS,
    projections: int = 0,
) -> None:
    """Refuse a picture whose path lengths this machine cannot hold.

    Parameters
    ----------
    settings : ProjectionSettings
    shape : tuple of int, optional
        Rows and columns; left out: those of the smallest allowed format.
    channels : int
        Materials and lesions, each traced apart.
    projections : int
        Projections of a series, which are kept together once they are recorded.

    Raises
    ------
    InputError
        With the memory that is needed and the memory that is there.
    """
    if shape is None:
        height, width = formats_mm(settings)[0]
        shape = pixels_of(height, settings.pixel_mm), pixels_of(width, settings.pixel_mm)
    images = channels * (2 if settings.conserve_mass else 1)
    needed = (BYTES_PER_LENGTH * images + BYTES_PER_RECORD * projections) * shape[0] * shape[1]
    installed = installed_memory()
    if needed > installed:
        series = f" and {projections} projections" if projections else ""
        raise InputError(
            f"projection.pixel_mm: found {settings.pixel_mm:g}, which needs {needed / 1e9:.1f} GB "
            f"for {images} images{series} of {shape[0]} x {shape[1]} pixels; this machine has "
            f"{installed / 1e9:.1f} GB: use larger pixels or a smaller detector"
        )


def installed_memory() -> float:
    """Memory that is built into this machine.

    Returns
    -------
    float
        Bytes, whether in use or not; infinite where the system does not tell.
    """
    if not hasattr(os, "sysconf"):
        return math.inf
    return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))


def check_arc(arc: TomosynthesisSettings, settings: ProjectionSettings) -> None:
    """Refuse an arc on which the tube would be at or below the breast support.

    Raises
    ------
    InputError
        With the height of the focal spot at the end of the arc.
    """
    if arc.pivot_to_detector_mm > settings.source_to_detector_mm:
        raise InputError(
            f"dbt.pivot_to_detector_mm: found {arc.pivot_to_detector_mm:g}, expected at most "
            f"projection.source_to_detector_mm, {settings.source_to_detector_mm:g}: the pivot "
            "cannot be above the focal spot"
        )
    arm = settings.source_to_detector_mm - arc.pivot_to_detector_mm
    end = max(abs(angle) for angle in arc.angles_deg)
    height = arc.pivot_to_detector_mm + arm * math.cos(math.radians(end))
    if height <= settings.support_to_detector_mm:
        raise InputError(
            f"dbt.angle_range_deg: found {arc.angle_range_deg:g}, which moves the focal spot down "
            f"to {height:.0f} mm above the detector, expected an arc that stays above the breast "
            f"support at {settings.support_to_detector_mm:g} mm"
        )


def check_gap(gantries: Sequence[Gantry]) -> None:
    """Refuse a detector that would turn into the breast support.

    Raises
    ------
    InputError
        With the angle, and what the detector would need.
    """
    for gantry in gantries:
        ends = gantry.detector_mm([-0.5, gantry.rows - 0.5], [0.0, 0.0])
        if ends[:, 2].max() >= 0.0:
            needed = float(ends[:, 2].max()) + gantry.support_to_detector_mm
            raise InputError(
                f"dbt.detector_angle_range_deg: found one that turns the detector by "
                f"{gantry.detector_angle_deg:g} degrees, whose edge then reaches the breast "
                f"support; expected less, or projection.support_to_detector_mm above {needed:.1f} "
                f"(found {gantry.support_to_detector_mm:g})"
            )


def check_shadow(
    compressed: CompressedBreast,
    settings: ProjectionSettings,
    arc: TomosynthesisSettings | None = None,
) -> tuple[Gantry, tuple[str, ...]]:
    """Where the detector would be, and by how much it is too small for a compressed breast.

    Parameters
    ----------
    compressed : CompressedBreast
        Perhaps on a coarse lattice.
    settings : ProjectionSettings
    arc : TomosynthesisSettings, optional
        Movement of the tube: it must be above the breast at all its angles.

    Returns
    -------
    gantry : Gantry
        With pixels of 1 mm and the tube upright.
    notes : tuple of str
        One sentence where the breast is cut off.

    Raises
    ------
    InputError
        If there would be no breast in the picture, the focal spot is not above it, or a detector
        that turns meets the breast support.
    """
    coarse = settings.model_copy(update={"pixel_mm": 1.0})
    upright, notes = place_detector(compressed, voxel_map(compressed), coarse, arc)
    if arc is not None:
        check_gap([turned(upright, angle, arc) for angle in arc.angles_deg])
    return upright, notes


def check_copy(compressed: CompressedBreast, settings: ProjectionSettings, voxel_mm: float) -> None:
    """Refuse a breast that is too large for a copy of coarse voxels (`coarse_breast`).

    Parameters
    ----------
    compressed : CompressedBreast
        Perhaps on a coarse lattice.
    settings : ProjectionSettings
    voxel_mm : float
        Edge of the copy's voxels, mm.

    Raises
    ------
    InputError
        With the voxels needed and allowed.
    """
    coarse = settings.model_copy(update={"pixel_mm": 1.0})
    gantry, _ = place_detector(compressed, voxel_map(compressed), coarse)
    check_coarse_size(compressed, gantry, voxel_mm)
