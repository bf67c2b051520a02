"""What can be refused before a breast is compressed: pictures too large, detectors too small."""

from __future__ import annotations

import math
import os

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.errors import InputError
from mammosim.geometry import View
from mammosim.phantom import BreastPhantom
from mammosim.projection.channels import planes_with_labels
from mammosim.projection.detector_field import (
    Shadow,
    fitting_format,
    formats_mm,
    pixels_of,
    place_detector,
    refuse_format,
)
from mammosim.projection.settings import ProjectionSettings, TomosynthesisSettings
from mammosim.projection.voxel_map import voxel_map

BYTES_A_LENGTH = 4  # single precision
BYTES_A_RECORD = 2  # 16 bits
FEWEST_CHANNELS = 3  # fat, gland and skin: hardly a phantom has fewer
NOT_BREAST = ("air", "muscle")
MOST_PLANES = 100  # sampled of a phantom: neighbouring planes have nearly the same outline


def check_memory(
    settings: ProjectionSettings,
    shape: tuple[int, int] | None = None,
    channels: int = FEWEST_CHANNELS,
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
    needed = (BYTES_A_LENGTH * images + BYTES_A_RECORD * projections) * shape[0] * shape[1]
    installed = installed_memory()
    if needed > installed:
        series = f" and {projections} projections" if projections else ""
        raise InputError(
            f"projection.pixel_mm: found {settings.pixel_mm:g}, which needs {needed / 1e9:.1f} GB "
            f"for {images} images{series} of {shape[0]} x {shape[1]} pixels; this machine has "
            f"{installed / 1e9:.1f} GB: take larger pixels or a smaller detector"
        )


def installed_memory() -> float:
    """Bytes of memory of this machine; infinite where the system does not tell."""
    if not hasattr(os, "sysconf"):
        return math.inf
    return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))


def check_field(
    breast: BreastPhantom, view: View, edge_mm: float, settings: ProjectionSettings
) -> None:
    """Refuse a detector that cannot hold the breast, before the breast is compressed.

    Parameters
    ----------
    breast : BreastPhantom
        Uncompressed.
    view : View
    edge_mm : float
        Breast-frame x of the detector's edge, mm.
    settings : ProjectionSettings

    Raises
    ------
    InputError
        If even the uncompressed breast, flat on the support, throws a shadow that no allowed
        format holds; the message says by how much at least.

    Notes
    -----
    Compression makes a breast wider and longer, so that what does not fit before does not fit
    after. Muscle, and what lies behind the edge, does not count.
    """
    wanted = np.ones(256, dtype=np.bool_)
    wanted[[label for label, name in breast.tissue_of_label.items() if name in NOT_BREAST]] = False
    x_mm = breast.origin_mm[0] + np.arange(breast.labels.shape[0]) * breast.voxel_mm[0]
    holds = planes_with_labels(breast.labels)[:, wanted].any(axis=1) & (x_mm > edge_mm)
    planes = np.flatnonzero(holds)
    if planes.size == 0:
        return  # said once it is known where tissue comes to lie
    outline = np.zeros(breast.labels.shape[1:], dtype=np.bool_)
    for plane in planes[:: -(-planes.size // MOST_PLANES)]:
        outline |= wanted[breast.labels[plane]]
    place = breast.origin_mm[1:] + np.argwhere(outline) * breast.voxel_mm[1:]
    across = place @ view.rotation[1, 1:]
    height = settings.source_to_detector_mm - settings.support_to_detector_mm
    scale = settings.source_to_detector_mm / height
    shadow = Shadow(
        scale * float(across.min()),
        scale * float(across.max()),
        scale * float(x_mm[planes[-1]] - edge_mm),
    )
    if fitting_format(shadow, settings) is None:
        refuse_format(shadow, settings)


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
            f"dbt.angle_range_deg: found {arc.angle_range_deg:g}, which turns the focal spot down "
            f"to {height:.0f} mm above the detector, expected an arc that stays above the breast "
            f"support at {settings.support_to_detector_mm:g} mm"
        )


def check_shadow(
    compressed: CompressedBreast,
    settings: ProjectionSettings,
    room: float = 1.0,
    arc: TomosynthesisSettings | None = None,
) -> None:
    """Refuse a detector that cannot hold the shadow of a compressed breast.

    Parameters
    ----------
    compressed : CompressedBreast
        Perhaps on a coarse lattice.
    settings : ProjectionSettings
    room : float
        Sides that the shadow may have, of the largest allowed format's.
    arc : TomosynthesisSettings, optional
        Movement of the tube: it must be above the breast at all its angles.

    Raises
    ------
    InputError
        With the size that the shadow needs.
    """
    height, width = formats_mm(settings)[-1]
    roomy = {"detector_mm": (height * room, width * room), "pixel_mm": 1.0}
    try:
        place_detector(compressed, voxel_map(compressed), settings.model_copy(update=roomy), arc)
    except InputError as error:
        grown, own = f"{height * room:g} x {width * room:g}", f"{height:g} x {width:g}"
        raise InputError(line.replace(grown, own) for line in error.problems) from None
