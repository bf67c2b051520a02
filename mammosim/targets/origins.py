"""Targets in the uncompressed breast: lesions by their voxels, landmarks and nipple as points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mammosim._derived import Derived
from mammosim.compression import DisplacementField
from mammosim.phantom import BreastPhantom
from mammosim.targets.lesion_voxels import lesion_voxels

MAX_VOXELS = 20_000
"""Voxels of one lesion that are followed: evenly taken among all where there are more."""


@dataclass(frozen=True, eq=False)
class UncompressedTarget:
    """A target before compression.

    Parameters
    ----------
    name, kind : str
    centre_mm : ndarray, (3,)
        Mean of its voxels' centres, or the point, breast frame, mm.
    points_mm : ndarray, (n, 3)
        Points of it that are followed, breast frame, mm.
    volume_mm3 : float
        0 for a point.
    label : int
        Of a lesion's voxels, 0 for a point.
    extent_mm : float
        Largest distance between the centres of two of a lesion's voxels plus the edge of one;
        NaN for a point.
    """

    name: str
    kind: str
    centre_mm: NDArray[np.float64]
    points_mm: NDArray[np.float64]
    volume_mm3: float = 0.0
    label: int = 0
    extent_mm: float = math.nan


_origins: Derived[BreastPhantom, list[UncompressedTarget]] = Derived()
"""Each view's table, warnings and rules ask for them: all voxels near a lesion are searched."""


def target_origins(phantom: BreastPhantom) -> list[UncompressedTarget]:
    """Targets of a phantom before compression: lesions, then landmarks, then the nipple.

    Parameters
    ----------
    phantom : BreastPhantom

    Returns
    -------
    list of UncompressedTarget
        Centre and points of each in the breast frame, mm. Their order gives the numbers
        (`target_id`) of all tables.
    """
    return list(_origins.of(phantom, lambda: [*_lesions(phantom), *_points(phantom)]))


def mean_shift_mm(field: DisplacementField, origin: UncompressedTarget) -> NDArray[np.float64]:
    """Mean displacement over a target's points.

    Parameters
    ----------
    field : DisplacementField
    origin : UncompressedTarget
        Its points are spread over its volume; a landmark has one.

    Returns
    -------
    ndarray, (3,)
        Breast frame, mm: from where the target was to where compression brought it. For an extended
        target that is deformed this is the shift of its centroid, not of each of its parts.
    """
    shift: NDArray[np.float64] = field.displacement_at(origin.points_mm).mean(axis=0)
    return shift


def largest_distance(points: NDArray[np.float64]) -> float:
    """Largest distance between two of the points (n, 3); NaN without any.

    From the first point, and the foremost in each of 26 directions, to the farthest from it, and on
    from there while that grows: exact except for contrived shapes, without n x n distances.
    """
    if not len(points):
        return math.nan
    length = 0.0
    for direction in product((-1.0, 0.0, 1.0), repeat=3):
        here = points[np.argmax(points @ np.array(direction))]
        while True:
            away = np.linalg.norm(points - here, axis=1)
            farthest = int(np.argmax(away))
            if away[farthest] <= length:
                break
            length, here = float(away[farthest]), points[farthest]
    return length


def row_ends(index: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Which voxels (n, 3), in the array's order, are the first or last of their row along z.

    The two that are farthest apart are among them: along a row distances are largest at an end.
    """
    changes = (np.diff(index[:, :2], axis=0) != 0).any(axis=1)
    edge = np.ones(min(len(index), 1), bool)
    ends: NDArray[np.bool_] = np.concatenate([edge, changes]) | np.concatenate([changes, edge])
    return ends


def _lesions(phantom: BreastPhantom) -> list[UncompressedTarget]:
    origins = []
    voxels = lesion_voxels(phantom)
    for lesion in phantom.lesions:
        points = phantom.frame.position_mm(voxels[lesion.label])
        ends = points[row_ends(voxels[lesion.label])]
        extent_mm = largest_distance(ends) + float(phantom.voxel_mm.mean())
        # A lesion whose voxels were overwritten by another is followed as the point it was.
        points = points if len(points) else np.atleast_2d(lesion.position_mm)
        some = np.linspace(0, len(points) - 1, min(len(points), MAX_VOXELS)).round().astype(int)
        origins.append(
            UncompressedTarget(lesion.name, lesion.kind, points.mean(axis=0), points[some],
                    lesion.volume_mm3, lesion.label, extent_mm)
        )  # fmt: skip
    return origins


def _points(phantom: BreastPhantom) -> list[UncompressedTarget]:
    nipple = np.asarray(phantom.nipple_mm, dtype=float)
    return [
        *(
            UncompressedTarget(
                mark.name, "landmark", mark.position_mm, np.atleast_2d(mark.position_mm)
            )
            for mark in phantom.landmarks
        ),
        UncompressedTarget("nipple", "nipple", nipple, nipple[None]),
    ]
