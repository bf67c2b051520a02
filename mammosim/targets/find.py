"""Targets of one view: where each was, where it went, and where it appears."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition import Visibility
from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.projection import PathLengths
from mammosim.targets.anatomy import clock_position, skin_depth_mm
from mammosim.targets.origins import UncompressedTarget, mean_shift_mm, target_origins
from mammosim.targets.target import Target


def find_targets(
    compressed: CompressedBreast,
    paths: PathLengths,
    visible: Mapping[int, Visibility] | None = None,
    first_id: int = 1,
) -> list[Target]:
    """Lesions, then landmarks, then the nipple, in one view.

    Parameters
    ----------
    compressed : CompressedBreast
    paths : PathLengths
        Its projection.
    visible : mapping of int to Visibility, optional
        How lesions show, by label; from `lesion_visibility`.
    first_id : int
        Number of the first; above 1 for the second breast of an exam.

    Returns
    -------
    list of Target
        Numbered in turn, the same target by the same number in every view.

    Notes
    -----
    The compressed place of a lesion is the mean over its voxel centres, displaced; its deformation
    the mean over them of the deformation gradient F, whose singular values are the principal
    stretches. Landmarks and nipple are single points. On the image a lesion is at the centroid of
    its own path length where it has any, else (and for points) where the focal spot throws its
    compressed place.

    Not modelled: a stiff lesion moving as one body; what is reported is the field at its voxels.
    """
    origins = target_origins(compressed.phantom)
    shifts_mm = [mean_shift_mm(compressed.field, origin) for origin in origins]
    nipple_px = _projected_px(origins[-1].centre_mm + shifts_mm[-1], paths)
    seen = visible or {}
    return [
        _target(number, origin, shift_mm, compressed, paths, nipple_px, seen.get(origin.label))
        for number, (origin, shift_mm) in enumerate(
            zip(origins, shifts_mm, strict=True), start=first_id
        )
    ]


def _target(
    number: int,
    origin: UncompressedTarget,
    shift_mm: NDArray[np.float64],
    compressed: CompressedBreast,
    paths: PathLengths,
    nipple_px: NDArray[np.float64],
    seen: Visibility | None,
) -> Target:
    return Target(
        target_id=number,
        name=origin.name,
        kind=origin.kind,
        view=compressed.view.label,
        volume_mm3=float(origin.volume_mm3),
        **_before(origin, compressed.phantom),
        **_moved(origin, shift_mm, paths),
        **_deformed(origin, compressed),
        **_imaged(origin, shift_mm, paths, nipple_px),
        **_along_and_across(shift_mm, compressed),
        contrast=seen.contrast if seen else math.nan,
        sdnr=seen.sdnr if seen else math.nan,
        extent_mm=origin.extent_mm,
        laterality=compressed.view.laterality,
    )


def _before(origin: UncompressedTarget, phantom: BreastPhantom) -> dict[str, Any]:
    centre = origin.centre_mm
    nipple = np.asarray(phantom.nipple_mm, dtype=float)
    return {
        "x_mm": float(centre[0]),
        "y_mm": float(centre[1]),
        "z_mm": float(centre[2]),
        "clock_position": "" if origin.kind == "nipple" else clock_position(centre, nipple),
        "nipple_distance_mm": float(np.linalg.norm(centre - nipple)),
        "skin_depth_mm": skin_depth_mm(phantom, centre),
    }


def _moved(
    origin: UncompressedTarget, shift_mm: NDArray[np.float64], paths: PathLengths
) -> dict[str, Any]:
    moved = origin.centre_mm + shift_mm
    place = paths.gantry.gantry_from_breast(moved)
    at_rest = paths.gantry.gantry_from_breast(origin.centre_mm)
    return {
        **{f"moved_{axis}_mm": float(moved[n]) for n, axis in enumerate("xyz")},
        **{f"gantry_{axis}_mm": float(at_rest[n]) for n, axis in enumerate("xyz")},
        "compressed_x_mm": float(place[0]),
        "compressed_y_mm": float(place[1]),
        "compressed_z_mm": float(place[2]),
        "shift_x_mm": float(shift_mm[0]),
        "shift_y_mm": float(shift_mm[1]),
        "shift_z_mm": float(shift_mm[2]),
        "shift_mm": float(np.linalg.norm(shift_mm)),
    }


def _deformed(origin: UncompressedTarget, compressed: CompressedBreast) -> dict[str, Any]:
    gradient = compressed.field.deformation_gradient_at(origin.points_mm)
    mean = gradient.mean(axis=0, dtype=np.float64)
    stretches = np.full(3, np.nan)
    if np.isfinite(mean).all():
        stretches = np.linalg.svd(mean, compute_uv=False)
    return {
        "volume_ratio": float(np.linalg.det(gradient).mean(dtype=np.float64)),
        "stretch_max": float(stretches[0]),
        "stretch_middle": float(stretches[1]),
        "stretch_min": float(stretches[-1]),
    }


def _along_and_across(
    shift_mm: NDArray[np.float64], compressed: CompressedBreast
) -> dict[str, Any]:
    """The shift along the plates' normal, towards the paddle, and its length across it."""
    across_x, across_y, along = compressed.view.compression_from_breast(shift_mm)
    return {
        "shift_along_mm": float(along),
        "shift_across_mm": float(np.hypot(across_x, across_y)),
    }


def _imaged(
    origin: UncompressedTarget,
    shift_mm: NDArray[np.float64],
    paths: PathLengths,
    nipple_px: NDArray[np.float64],
) -> dict[str, Any]:
    gantry = paths.gantry
    pixel = _centroid_px(origin.label, paths)
    row, column = _projected_px(origin.centre_mm + shift_mm, paths) if pixel is None else pixel
    distance_px = np.hypot(row - nipple_px[0], column - nipple_px[1])
    return {
        "image_row_px": float(row),
        "image_col_px": float(column),
        "image_nipple_distance_mm": float(distance_px * gantry.pixel_mm),
        "in_field": bool(
            -0.5 <= row <= gantry.rows - 0.5 and -0.5 <= column <= gantry.columns - 0.5
        ),
    }


def _projected_px(place_mm: NDArray[np.float64], paths: PathLengths) -> NDArray[np.float64]:
    """(2,) row and column at which the focal spot throws a compressed breast-frame point."""
    return paths.gantry.project(paths.gantry.gantry_from_breast(place_mm))


def _centroid_px(label: int, paths: PathLengths) -> tuple[float, float] | None:
    """Row and column of the centroid of a lesion's path length; None where it has none."""
    if label == 0 or label not in paths.lesion_labels:
        return None
    image = paths.length_mm[paths.lesion_labels.index(label)]
    down, along = image.sum(axis=1, dtype=float), image.sum(axis=0, dtype=float)
    if not down.any():
        return None
    return (
        float(np.average(np.arange(down.size), weights=down)),
        float(np.average(np.arange(along.size), weights=along)),
    )
