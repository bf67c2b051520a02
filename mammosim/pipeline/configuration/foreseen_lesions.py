"""Lesions in the outline of a generated breast: whether they fit in it, and where they will be."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.errors import InputError
from mammosim.phantom import (
    BreastPhantom,
    Lesion,
    PhantomSettings,
    PlannedLesion,
    box_text,
    plan_lesions,
)
from mammosim.targets import UncompressedTarget, target_origins
from mammosim.tissues import LESION_LABELS

_ACROSS = 7
"""Points across the ball that stands for a lesion whose voxels are not there yet."""

_OUTLINE_ERROR = 1.5
"""Largest error of a depth that is measured on the outline's voxels, in their edges: of 4000 places
in each of two breasts, beside voxels of 2 mm, 1.45 at most, and 0.65 in nine of ten."""

_WALL_ERROR_MM = 0.5
"""Of the chest-wall plane: where voxels end, half a voxel of the breast itself at most."""

BY_OUTLINE = "by an outline of coarse voxels"


def with_lesions(phantom: PhantomSettings, outline: BreastPhantom) -> BreastPhantom:
    """An outline with the lesions whose position is given, which have no voxels in it.

    Parameters
    ----------
    phantom : PhantomSettings
    outline : BreastPhantom
        Of coarse voxels.

    Returns
    -------
    BreastPhantom
        Its notes name those that may lie outside.

    Raises
    ------
    InputError
        With one line for each lesion or landmark that certainly lies outside the breast, or
        reaches beyond it.
    """
    depth_mm = _voxel_depth_mm(outline)
    error_mm = _OUTLINE_ERROR * float(outline.voxel_mm.max())
    planned = plan_lesions(phantom.lesions)
    problems, notes, lesions = [], [], []
    for key, number, name, position, size_mm in _places(phantom, planned):
        centre, radius = np.array(position), 0.5 * size_mm
        start = f"phantom.{key}.{number}: '{name}' at {list(position)} mm"
        depth = _depth_mm(outline, depth_mm, centre)
        room = min(depth + error_mm, _behind_mm(outline, centre) + _WALL_ERROR_MM)
        if room < 0.0:
            problems.append(f"{start} lies outside the breast; {box_text(outline)}")
        elif room < radius:
            problems.append(
                f"{start} extends beyond the breast with its {size_mm:g} mm; move it inwards or "
                f"make it smaller; {box_text(outline)}"
            )
        elif depth < radius:
            notes.append(
                f"{start} reaches beyond the breast, or nearly so, {BY_OUTLINE}; the run refuses "
                "it if it does"
            )
    for entry, label in zip(planned, LESION_LABELS, strict=False):
        keys = entry.settings
        if keys.position_mm is not None:
            centre, volume = np.array(keys.position_mm), math.pi / 6.0 * entry.size_mm**3
            lesions.append(Lesion(keys.name, keys.kind, label, keys.kind, centre, volume))
    if problems:
        raise InputError(problems)
    return dataclasses.replace(outline, lesions=tuple(lesions), notes=tuple(notes))


def _places(
    phantom: PhantomSettings, planned: Iterable[PlannedLesion]
) -> Iterator[tuple[str, int, str, tuple[float, float, float], float]]:
    """Key, number, name, position and size of each lesion and landmark whose position is given."""
    for number, entry in enumerate(planned):
        if entry.settings.position_mm is not None:
            yield "lesions", number, entry.name, entry.settings.position_mm, entry.size_mm
    for number, mark in enumerate(phantom.landmarks):
        yield "landmarks", number, mark.name, mark.position_mm, 0.0


def foreseen_origins(phantom: PhantomSettings, breast: BreastPhantom) -> list[UncompressedTarget]:
    """Lesions of a breast by their voxels; of an outline, each by the ball around it.

    Parameters
    ----------
    phantom : PhantomSettings
    breast : BreastPhantom
        From a file, or an outline `with_lesions`.
    """
    origins = [origin for origin in target_origins(breast) if origin.label]
    if phantom.generate is None:
        return origins
    radius_mm = {one.name: 0.5 * one.size_mm for one in plan_lesions(phantom.lesions)}
    return [
        dataclasses.replace(one, points_mm=one.centre_mm + radius_mm[one.name] * _ball())
        for one in origins
    ]


def _ball() -> NDArray[np.float64]:
    """Points (n, 3) spread over the unit ball."""
    axis = np.linspace(-1.0, 1.0, _ACROSS)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    inside: NDArray[np.float64] = points[np.linalg.norm(points, axis=1) <= 1.0]
    return inside


def _voxel_depth_mm(outline: BreastPhantom) -> NDArray[np.float64]:
    """Depth of each voxel's centre below the outline's voxels, negative in the air, mm."""
    tissue = np.pad(outline.labels != 0, 1, mode="edge")
    inside, outside = (
        ndimage.distance_transform_edt(mask, sampling=outline.voxel_mm)
        for mask in (tissue, ~tissue)
    )
    depth: NDArray[np.float64] = (inside - outside)[1:-1, 1:-1, 1:-1]
    return depth


def _depth_mm(
    outline: BreastPhantom, depth_mm: NDArray[np.float64], point_mm: NDArray[np.float64]
) -> float:
    """Depth of a point below the outline's voxels, negative in the air, mm."""
    index = outline.frame.index(point_mm)
    away = np.maximum(np.maximum(-index, index - np.array(outline.labels.shape) + 1.0), 0.0)
    nearest = ndimage.map_coordinates(depth_mm, index[:, None], order=1, mode="nearest")[0]
    return float(nearest - np.linalg.norm(away * outline.voxel_mm))


def _behind_mm(outline: BreastPhantom, point_mm: NDArray[np.float64]) -> float:
    """Distance of a point from the chest-wall plane, where the phantom ends, mm."""
    return float(point_mm[0] - outline.origin_mm[0] + 0.5 * outline.voxel_mm[0])
