"""The detector field: its format, and where focal spot and rows lie along the chest wall."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import Gantry
from mammosim.projection.open_end import open_end_mm
from mammosim.projection.settings import ProjectionSettings, TomosynthesisSettings
from mammosim.projection.voxel_map import VoxelMap, voxel_map

# Height along the chest wall and width, mm: the two formats of full-field digital mammography
# units (18 x 24 and 24 x 30 cm, the sizes of the film cassettes before them).
STANDARD_FORMATS_MM = ((240.0, 180.0), (300.0, 240.0))


@dataclass(frozen=True)
class Shadow:
    """What the detector must hold: a rectangle of its plane, mm.

    Parameters
    ----------
    y_min_mm, y_max_mm : float
        Compression-frame y of its ends along the chest wall.
    width_mm : float
        How far it reaches from the detector's edge.
    """

    y_min_mm: float
    y_max_mm: float
    width_mm: float

    @property
    def height_mm(self) -> float:
        """Its length along the chest wall, mm."""
        return self.y_max_mm - self.y_min_mm


def place_detector(
    compressed: CompressedBreast,
    mapped: VoxelMap,
    settings: ProjectionSettings,
    arc: TomosynthesisSettings | None = None,
) -> tuple[Gantry, tuple[str, ...]]:
    """Choose format and place of the detector so that it holds the breast's shadow.

    The rows are centred on the focal spot; where the shadow does not fit centred, the field is
    shifted along the chest wall by whole pixels, no more than needed. Where the phantom ends but
    the body goes on, as to the axilla in an oblique view, the field ends too. A shadow that no
    allowed format holds is cut off at the largest one, as on a real unit: the field is centred on
    it along the chest wall.

    Parameters
    ----------
    compressed : CompressedBreast
    mapped : VoxelMap
        Its cells that hold tissue.
    settings : ProjectionSettings
    arc : TomosynthesisSettings, optional
        Movement of the tube. The field then holds the shadows of all its angles if an allowed
        format can, else that of the upright tube: the others are cut off, as on real systems.

    Returns
    -------
    gantry : Gantry
        With the tube upright.
    notes : tuple of str
        By how much the breast is cut off, one sentence; empty where the field holds its shadow.

    Raises
    ------
    InputError
        If the breast lies wholly behind the detector's edge, reaches up to the focal spot, or is
        cut off by a field that does not lie below the focal spot.

    Notes
    -----
    The shadow is that of the inverse map's cells that hold tissue: up to one cell wider than the
    tissue's own. What lies behind the detector's edge does not count.
    """
    gantry, shadow, end = _shadow_and_end(compressed, mapped, settings, arc)
    spot_y, pixel_mm = gantry.focal_spot_y_mm, settings.pixel_mm
    fitting = fitting_format(shadow, settings)
    height, width = fitting or formats_mm(settings)[-1]
    rows, columns = pixels_of(height, pixel_mm), pixels_of(width, pixel_mm)
    if end is not None:
        y_min = _edge_at(*end, spot_y, rows, pixel_mm)
    elif shadow.height_mm > height:
        middle = 0.5 * (shadow.y_min_mm + shadow.y_max_mm)
        y_min = spot_y - 0.5 * rows * pixel_mm + round((middle - spot_y) / pixel_mm) * pixel_mm
    else:
        y_min = _lower_edge(shadow, spot_y, rows, pixel_mm)
    placed = replace(gantry, rows=rows, columns=columns, y_min_mm=y_min)
    if shadow.height_mm > height and not y_min <= spot_y <= placed.y_max_mm:
        raise InputError(
            f"projection.focal_spot_y_mm: found {spot_y:g}, expected {y_min:.1f} to "
            f"{placed.y_max_mm:.1f}: the focal spot must be above the detector's field"
        )
    return placed, () if fitting else (_cut_off_note(compressed, shadow, height, width),)


def _cut_off_note(compressed: CompressedBreast, shadow: Shadow, height: float, width: float) -> str:
    """By how much a detector of a height and width, mm, is too small for the breast's shadow."""
    return (
        f"{compressed.view.folder}: the breast is cut off at the detector's edge: its shadow is "
        f"{shadow.height_mm:.1f} x {shadow.width_mm:.1f} mm (along the chest wall x from it), "
        f"projection.detector_mm is {height:g} x {width:g}; "
        f"{max(shadow.height_mm - height, 0.0):.1f} mm of its height and "
        f"{max(shadow.width_mm - width, 0.0):.1f} mm of its width are not in the image"
    )


def cast_shadow(
    compressed: CompressedBreast, settings: ProjectionSettings, arc: TomosynthesisSettings
) -> Shadow:
    """Shadow of a compressed breast over all angles of an arc, whatever the detector's size.

    Parameters
    ----------
    compressed : CompressedBreast
    settings : ProjectionSettings
        Its distances and support are used, its detector's size is not.
    arc : TomosynthesisSettings

    Returns
    -------
    Shadow
        What the rays through the tissue's box cover on the detector's plane, mm.

    Raises
    ------
    InputError
        As `place_detector`, except for the detector's format.
    """
    gantry, corners = _tissue_over(compressed, voxel_map(compressed), settings, arc)
    return _shadow(corners, gantry, arc)


def _shadow_and_end(
    compressed: CompressedBreast,
    mapped: VoxelMap,
    settings: ProjectionSettings,
    arc: TomosynthesisSettings | None,
) -> tuple[Gantry, Shadow, tuple[float, float] | None]:
    """A gantry without a detector's size, the shadow to hold, and where the body goes on."""
    gantry, corners = _tissue_over(compressed, mapped, settings, arc)
    shadow = _shadow(corners, gantry, arc)
    if arc and not fitting_format(shadow, settings):
        shadow = _shadow(corners, gantry)
    end = open_end_mm(compressed, gantry)
    if end is not None:
        shadow = _up_to(shadow, *end)
    return gantry, shadow, end


def _tissue_over(
    compressed: CompressedBreast,
    mapped: VoxelMap,
    settings: ProjectionSettings,
    arc: TomosynthesisSettings | None,
) -> tuple[Gantry, np.ndarray]:
    """A gantry without pixels, and the tissue in front of its detector's edge, (n, 3) in mm."""
    edge = settings.detector_edge_mm
    edge = compressed.plate_edge_mm if edge is None else edge
    x, y, z = _tissue_corners(mapped)
    kept = x > edge
    if not kept.any():
        raise InputError(
            f"projection.detector_edge_mm: found {edge:g}, which has no tissue in front of it; "
            f"the compressed breast extends to x = {x.max():.1f} mm"
        )
    spot_y = _focal_spot_y(y[kept], settings)
    gantry = Gantry(
        compressed.view, edge, compressed.support_z_mm, settings.source_to_detector_mm,
        settings.support_to_detector_mm, spot_y, settings.pixel_mm, rows=0, columns=0, y_min_mm=0.0,
        pivot_to_detector_mm=arc.pivot_to_detector_mm if arc else 0.0,
    )  # fmt: skip
    corners = np.stack([x[kept] - edge, y[kept], z[kept] - compressed.support_z_mm], axis=-1)
    return gantry, corners


def pixels_of(length_mm: float, pixel_mm: float) -> int:
    """Pixels that cover a length; a millionth more than a whole number is that number."""
    return math.ceil(length_mm / pixel_mm - 1e-6)


def formats_mm(settings: ProjectionSettings) -> tuple[tuple[float, float], ...]:
    """Height and width of the allowed formats, smallest first, mm."""
    return (settings.detector_mm,) if settings.detector_mm else STANDARD_FORMATS_MM


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


def turned(upright: Gantry, angle_deg: float, arc: TomosynthesisSettings) -> Gantry:
    """A gantry with its tube turned by an angle, and its detector as the arc's settings say."""
    behind = arc.detector_angle_deg(angle_deg)
    return replace(upright, tube_angle_deg=angle_deg, detector_angle_deg=behind)


def _shadow(
    corners_mm: np.ndarray, upright: Gantry, arc: TomosynthesisSettings | None = None
) -> Shadow:
    """Shadow of points (n, 3), gantry frame, over all the angles of the tube."""
    low, high, width = [], [], []
    for angle in arc.angles_deg if arc else (0.0,):
        gantry = turned(upright, angle, arc) if arc else upright
        points, spot = gantry.detector_from_gantry(corners_mm), gantry.focal_spot_above_detector_mm
        if points[:, 2].max() >= spot[2]:
            missing = float(points[:, 2].max() - spot[2])
            raise InputError(
                f"projection.source_to_detector_mm: found {gantry.source_to_detector_mm:g}, "
                f"expected more than {gantry.source_to_detector_mm + missing:.1f}: "
                f"the focal spot must be above the breast"
            )
        scale = gantry.focal_spot_height_mm / (spot[2] - points[:, 2])
        y = spot[1] + (points[:, 1] - spot[1]) * scale
        low.append(y.min())
        high.append(y.max())
        width.append((points[:, 0] * scale).max())
    return Shadow(float(min(low)), float(max(high)), float(max(width)))


def fitting_format(shadow: Shadow, settings: ProjectionSettings) -> tuple[float, float] | None:
    """The smallest allowed format that holds a shadow; None where none does."""
    for height, width in formats_mm(settings):
        if shadow.height_mm <= height and shadow.width_mm <= width:
            return height, width
    return None


def _lower_edge(shadow: Shadow, centre_mm: float, rows: int, pixel_mm: float) -> float:
    """y of the field's lower edge: centred, or shifted by as many pixels as the shadow needs."""
    y_min = centre_mm - 0.5 * rows * pixel_mm
    y_min -= max(0, math.ceil((y_min - shadow.y_min_mm) / pixel_mm)) * pixel_mm
    top = y_min + rows * pixel_mm
    return y_min + max(0, math.ceil((shadow.y_max_mm - top) / pixel_mm)) * pixel_mm


def _up_to(shadow: Shadow, end_mm: float, side: float) -> Shadow:
    """What is left of a shadow that is cut off at y on one side."""
    if side > 0.0:
        return replace(shadow, y_max_mm=min(end_mm, shadow.y_max_mm))
    return replace(shadow, y_min_mm=max(end_mm, shadow.y_min_mm))


def _edge_at(end_mm: float, side: float, centre_mm: float, rows: int, pixel_mm: float) -> float:
    """y of the lower edge of a field that ends, on one side, at y or up to a pixel before it."""
    pixels = math.floor((end_mm - centre_mm) * side / pixel_mm)
    edge = centre_mm + side * pixels * pixel_mm
    return edge - rows * pixel_mm if side > 0.0 else edge
