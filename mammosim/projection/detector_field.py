"""The detector field: its format, and where focal spot and rows lie along the chest wall."""

from __future__ import annotations

import math

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.projection.settings import ProjectionSettings
from mammosim.projection.voxel_map import VoxelMap

# Height along the chest wall and width, mm: the two formats of full-field digital mammography
# units (18 x 24 and 24 x 30 cm, the sizes of the film cassettes before them).
STANDARD_FORMATS_MM = ((240.0, 180.0), (300.0, 240.0))


def place_detector(
    squeezed: CompressedBreast, mapped: VoxelMap, settings: ProjectionSettings
) -> Gantry:
    """Choose format and place of the detector so that it holds the breast's shadow.

    The rows are centred on the focal spot; where the shadow does not fit centred, the field is
    shifted along the chest wall by whole pixels, no more than needed.

    Parameters
    ----------
    squeezed : CompressedBreast
    mapped : VoxelMap
        Its cells that hold tissue.
    settings : ProjectionSettings

    Returns
    -------
    Gantry

    Raises
    ------
    InputError
        If the breast lies wholly behind the detector's edge, reaches up to the focal spot, or
        throws a shadow that no allowed format holds; the message says by how much.

    Notes
    -----
    The shadow is that of the inverse map's cells that hold tissue: up to one cell wider than the
    tissue's own. What lies behind the detector's edge does not count.
    """
    edge = settings.detector_edge_mm
    edge = squeezed.plate_edge_mm if edge is None else edge
    x, y, z = _tissue_corners(mapped)
    kept = x > edge
    if not kept.any():
        raise InputError(
            f"projection.detector_edge_mm: found {edge:g}, which has no tissue in front of it; "
            f"the compressed breast reaches to x = {x.max():.1f} mm"
        )
    x, y, z = x[kept] - edge, y[kept], z[kept]
    spot_z = squeezed.support_z_mm - settings.support_to_detector_mm
    spot_z += settings.source_to_detector_mm
    if z.max() >= spot_z:
        raise InputError(
            f"projection.source_to_detector_mm: found {settings.source_to_detector_mm:g}, "
            f"expected more than {settings.source_to_detector_mm + z.max() - spot_z:.1f}: "
            f"the focal spot must be above the breast"
        )
    spot_y = _focal_spot_y(y, settings)
    scale = settings.source_to_detector_mm / (spot_z - z)
    shadow_x = float((x * scale).max())
    shadow_y = spot_y + (y - spot_y) * scale
    low, high = float(shadow_y.min()), float(shadow_y.max())
    pixel = settings.pixel_mm
    rows, columns = _format(high - low, shadow_x, settings)
    y_min = spot_y - 0.5 * rows * pixel
    y_min -= max(0, math.ceil((y_min - low) / pixel)) * pixel
    y_min += max(0, math.ceil((high - y_min - rows * pixel) / pixel)) * pixel
    return Gantry(
        squeezed.view, edge, squeezed.support_z_mm, settings.source_to_detector_mm,
        settings.support_to_detector_mm, spot_y, pixel, rows, columns, y_min,
    )  # fmt: skip


def _tissue_corners(mapped: VoxelMap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, z in mm of the outermost nodes of cells that hold tissue, for each column of cells.

    Of a column of cells along z only its lowest and highest tissue matters to the shadow.
    """
    frame, tissue = mapped.frame, mapped.tissue
    i, j = np.nonzero(tissue.any(axis=2))
    lowest = tissue[i, j].argmax(axis=1)
    highest = tissue.shape[2] - tissue[i, j, ::-1].argmax(axis=1)
    corners = [
        frame.position_mm(np.stack([i + a, j + b, k], axis=-1))
        for a in (0, 1)
        for b in (0, 1)
        for k in (lowest, highest)
    ]
    x, y, z = np.concatenate(corners).T
    return x, y, z


def _focal_spot_y(y_mm: np.ndarray, settings: ProjectionSettings) -> float:
    if settings.focal_spot_y_mm is not None:
        return settings.focal_spot_y_mm
    low, high = float(y_mm.min()), float(y_mm.max())
    return 0.0 if low <= 0.0 <= high else 0.5 * (low + high)


def _format(height_mm: float, width_mm: float, settings: ProjectionSettings) -> tuple[int, int]:
    """Rows and columns of the smallest allowed format that holds a shadow."""
    formats = (settings.detector_mm,) if settings.detector_mm else STANDARD_FORMATS_MM
    for height, width in formats:
        if height_mm <= height and width_mm <= width:
            pixel = settings.pixel_mm
            return math.ceil(height / pixel - 1e-6), math.ceil(width / pixel - 1e-6)
    height, width = formats[-1]
    raise InputError(
        f"projection.detector_mm: found {height:g} x {width:g} (height along the chest wall x "
        f"width), expected at least {height_mm:.1f} x {width_mm:.1f}: the breast's shadow is "
        f"{max(height_mm - height, 0.0):.1f} mm too high and "
        f"{max(width_mm - width, 0.0):.1f} mm too wide"
    )
