"""Targets of one view: where each was, where it went, and where it appears."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom, Lesion
from mammosim.projection import PathLengths
from mammosim.projection.channels import planes_with_labels
from mammosim.targets.anatomy import clock_position, skin_depth_mm
from mammosim.targets.target import Target

MOST_VOXELS = 20_000
"""Voxels of one lesion that are followed: evenly taken among all where there are more."""


@dataclass(frozen=True, eq=False)
class _Origin:
    """A target before compression: its points followed, (n, 3) mm in the breast frame."""

    name: str
    kind: str
    centre_mm: NDArray[np.float64]
    points_mm: NDArray[np.float64]
    volume_mm3: float = 0.0
    label: int = 0


def find_targets(squeezed: CompressedBreast, paths: PathLengths) -> list[Target]:
    """Lesions, then landmarks, then the nipple, in one view.

    Parameters
    ----------
    squeezed : CompressedBreast
    paths : PathLengths
        Its projection.

    Returns
    -------
    list of Target
        Numbered from 1, the same target by the same number in every view.

    Notes
    -----
    The compressed place of a lesion is the mean over its voxel centres, displaced; its deformation
    the mean over them of the deformation gradient F, whose singular values are the principal
    stretches. Landmarks and nipple are single points. On the image a lesion is at the centroid of
    its own path length where it has any, else (and for points) where the focal spot throws its
    compressed place.

    Not modelled: a stiff lesion moving as one body; what is reported is the field at its voxels.
    """
    origins = [*_lesions(squeezed.phantom), *_points(squeezed.phantom)]
    shifts_mm = [
        squeezed.displacement_at(origin.points_mm).mean(axis=0, dtype=np.float64)
        for origin in origins
    ]
    nipple_px = _thrown(origins[-1].centre_mm + shifts_mm[-1], paths)
    return [
        _target(number, origin, shift_mm, squeezed, paths, nipple_px)
        for number, (origin, shift_mm) in enumerate(zip(origins, shifts_mm, strict=True), start=1)
    ]


def _lesions(phantom: BreastPhantom) -> list[_Origin]:
    if not phantom.lesions:
        return []
    planes = planes_with_labels(phantom.labels)
    origins = []
    for lesion in phantom.lesions:
        points = _voxel_centres(phantom, lesion, planes[:, lesion.label])
        # A lesion whose voxels were overwritten by another is followed as the point it was.
        points = points if len(points) else np.atleast_2d(lesion.position_mm)
        some = np.linspace(0, len(points) - 1, min(len(points), MOST_VOXELS)).round().astype(int)
        origins.append(
            _Origin(lesion.name, lesion.kind, points.mean(axis=0), points[some],
                    lesion.volume_mm3, lesion.label)
        )  # fmt: skip
    return origins


def _voxel_centres(
    phantom: BreastPhantom, lesion: Lesion, planes: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """(n, 3) centres in mm of a lesion's voxels; `planes` tells in which x planes they are."""
    x = np.flatnonzero(planes)
    if x.size == 0:
        return np.empty((0, 3))
    index = np.argwhere(phantom.labels[x[0] : x[-1] + 1] == lesion.label)
    index[:, 0] += x[0]
    return phantom.frame.position_mm(index)


def _points(phantom: BreastPhantom) -> list[_Origin]:
    nipple = np.asarray(phantom.nipple_mm, dtype=float)
    return [
        *(
            _Origin(mark.name, "landmark", mark.position_mm, np.atleast_2d(mark.position_mm))
            for mark in phantom.landmarks
        ),
        _Origin("nipple", "nipple", nipple, nipple[None]),
    ]


def _target(
    number: int,
    origin: _Origin,
    shift_mm: NDArray[np.float64],
    squeezed: CompressedBreast,
    paths: PathLengths,
    nipple_px: NDArray[np.float64],
) -> Target:
    return Target(
        target_id=number,
        name=origin.name,
        kind=origin.kind,
        view=squeezed.view.label,
        volume_mm3=float(origin.volume_mm3),
        **_before(origin, squeezed.phantom),
        **_moved(origin, shift_mm, paths),
        **_deformed(origin, squeezed),
        **_imaged(origin, shift_mm, paths, nipple_px),
    )


def _before(origin: _Origin, phantom: BreastPhantom) -> dict[str, Any]:
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


def _moved(origin: _Origin, shift_mm: NDArray[np.float64], paths: PathLengths) -> dict[str, Any]:
    place = paths.gantry.gantry_from_breast(origin.centre_mm + shift_mm)
    return {
        "compressed_x_mm": float(place[0]),
        "compressed_y_mm": float(place[1]),
        "compressed_z_mm": float(place[2]),
        "shift_x_mm": float(shift_mm[0]),
        "shift_y_mm": float(shift_mm[1]),
        "shift_z_mm": float(shift_mm[2]),
        "shift_mm": float(np.linalg.norm(shift_mm)),
    }


def _deformed(origin: _Origin, squeezed: CompressedBreast) -> dict[str, Any]:
    gradient = squeezed.field.deformation_gradient_at(origin.points_mm)
    mean = gradient.mean(axis=0, dtype=np.float64)
    stretches = np.full(3, np.nan)
    if np.isfinite(mean).all():
        stretches = np.linalg.svd(mean, compute_uv=False)
    return {
        "volume_ratio": float(np.linalg.det(gradient).mean(dtype=np.float64)),
        "stretch_max": float(stretches[0]),
        "stretch_min": float(stretches[-1]),
    }


def _imaged(
    origin: _Origin,
    shift_mm: NDArray[np.float64],
    paths: PathLengths,
    nipple_px: NDArray[np.float64],
) -> dict[str, Any]:
    gantry = paths.gantry
    pixel = _centroid_px(origin.label, paths)
    row, column = _thrown(origin.centre_mm + shift_mm, paths) if pixel is None else pixel
    distance_px = np.hypot(row - nipple_px[0], column - nipple_px[1])
    return {
        "image_row_px": float(row),
        "image_col_px": float(column),
        "image_nipple_distance_mm": float(distance_px * gantry.pixel_mm),
        "in_field": bool(
            -0.5 <= row <= gantry.rows - 0.5 and -0.5 <= column <= gantry.columns - 0.5
        ),
    }


def _thrown(place_mm: NDArray[np.float64], paths: PathLengths) -> NDArray[np.float64]:
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
