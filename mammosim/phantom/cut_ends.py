"""Where a breast from a file is cut off: planes of tissue without skin, and what closes it there.

Files of other programs do not say that the body goes on beyond their last voxel. It shows: tissue
lies bare on the array's end, or, in a file whose breast has skin, along an inclined plane.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom._cut_kernels import count_faces, count_places
from mammosim.phantom.anatomy.axilla import HELD_FROM, HELD_OVER
from mammosim.phantom.anatomy.shape import smooth_step
from mammosim.phantom.breast import OpenEnd
from mammosim.phantom.readers.volume import every_nth
from mammosim.tissues import TISSUES

Wish = Literal["auto", "none"] | tuple[float, float, float]
"""What a user says of the open end: to be found, none, or the way out of it."""

WAY_EXPECTED = (
    "auto, none, or the way out as a direction to the side, such as [0, 1, 1], with y to the "
    "patient's left and z upwards"
)

COVERS = ("skin", "nipple")
"""Tissues with which a breast ends."""

BACK_MM = 10.0
"""Of the breast at the chest wall that is not looked at: its rim has no skin in FDA's phantom over
7 mm."""

MIN_AREA_MM2 = 400.0
"""Of bare tissue that makes a cut end. Generated breasts have 15 to 40 cm2 towards the axilla,
FDA's phantom none, and the side of a round breast that touches the array's end 2 cm2 with voxels of
0.5 mm. Chosen."""

MIN_COVERED, MIN_FLAT, FLAT_MM = 0.6, 0.8, 2.0
"""Part of the faces on air that skin must make, for bare ones to mean anything, and part of the
bare ones that must lie in one plane, which may be so thick. Chosen."""

NEAREST = 0.7
"""Distance of a cut end from the nipple, in radii of the breast, below which it goes through the
breast itself, which no surface of its own can then replace. Chosen."""

GRID_MM, SMOOTH_MM = 1.0, 2.0
"""Spacing of the grid of depths, and by how much they are smoothed there, mm: voxels' steps vanish,
and a skin of radius 50 mm moves by 0.1 mm."""

DEEP_MM = 40.0
"""Depth where nothing is to be left out, as in `anatomy.outline`."""


class CutEnd(NamedTuple):
    """A plane of bare tissue.

    Parameters
    ----------
    normal : ndarray, (3,)
        Unit vector out of the tissue, breast frame.
    place_mm : float
        Where the plane lies along it, mm from the frame's origin.
    area_mm2 : float
    """

    normal: NDArray[np.float64]
    place_mm: float
    area_mm2: float


class _Faces(NamedTuple):
    """Areas of faces towards -y, +y, -z and +z, mm2, and the skin's thickness, mm."""

    skin: NDArray[np.float64]
    bare: NDArray[np.float64]
    at_end: NDArray[np.float64]
    skin_mm: float


def is_way_out(way: Any) -> bool:
    """Whether something is a direction to the side, three numbers, within 30 degrees of it."""
    try:
        normal = np.asarray(way, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    if normal.shape != (3,) or not np.isfinite(normal).all():
        return False
    length = float(np.linalg.norm(normal))
    return length > 0.0 and abs(normal[0]) <= 0.5 * length


def find_open_end(
    labels: NDArray[np.uint8], frame: VoxelFrame, nipple_mm: NDArray[np.float64], wish: Wish
) -> tuple[OpenEnd | None, tuple[str, ...]]:
    """The end through which a breast from a file goes on, and what is to be said about it.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Of the tissue table.
    frame : VoxelFrame
    nipple_mm : ndarray, (3,)
    wish : "auto", "none" or (3,)

    Raises
    ------
    InputError
        If the way that is given does not lead to an end.
    """
    if wish == "none":
        return None, ()
    first = _first_layer(labels, frame)
    faces = _faces(labels, frame, first)
    ends, notes = _found(labels, frame, first, faces) if wish == "auto" else ([], [])
    if wish != "auto":
        ends = [_given(labels, frame, wish)]
    if not ends:
        return None, tuple(notes)
    end, *others = sorted(ends, key=lambda found: -found.area_mm2)
    depth, grid = _own_depth(labels, frame)
    held = _held_depth(depth, grid, nipple_mm, end)
    said = f"ends in cut tissue{_area(end)} towards {_way(end.normal)}"
    if held is None:
        notes.append(
            f"the breast {said}, too near to the nipple for views to leave it out: the cut was "
            f"taken for its own surface, without skin; if it is the chest wall, set phantom.axes"
        )
        return None, tuple(notes)
    notes += [
        f"the breast also ends in cut tissue{_area(other)} towards {_way(other.normal)}: that was "
        f"taken for its own surface, without skin"
        for other in others
    ]
    notes.append(
        f"the breast {said}: taken for the way to the axilla, where oblique images end; "
        f"other views leave it out; say otherwise with phantom.open_end"
    )
    return OpenEnd(
        end.place_mm * end.normal, end.normal, held.astype(np.float32), grid, faces.skin_mm
    ), tuple(notes)


def _area(end: CutEnd) -> str:
    return f" ({end.area_mm2 / 100.0:.0f} cm2)" if end.area_mm2 else ""


def _way(normal: NDArray[np.float64]) -> str:
    return f"[{', '.join(f'{part:.2g}' for part in np.round(normal, 2) + 0.0)}]"


def _first_layer(labels: NDArray[np.uint8], frame: VoxelFrame) -> int:
    """First layer along x that is looked at."""
    tissue = labels.any(axis=(1, 2))
    return int(tissue.argmax()) + int(np.ceil(BACK_MM / float(frame.spacing_mm[0])))


def _covers() -> NDArray[np.bool_]:
    covers = np.zeros(256, bool)
    covers[[TISSUES[name].label for name in COVERS]] = True
    return covers


def _faces(labels: NDArray[np.uint8], frame: VoxelFrame, first: int) -> _Faces:
    counts = np.zeros((labels.shape[0], 4, 3), np.int64)
    count_faces(labels, _covers(), counts)
    x, y, z = frame.spacing_mm
    areas = counts[first:].sum(axis=0) * np.array([x * z, x * z, x * y, x * y])[:, None]
    skin = int(np.count_nonzero(labels[first:] == TISSUES["skin"].label))
    # Of a half ball, faces to four of the six sides have as much area as its round surface.
    covered = float(areas[:, 0].sum())
    thickness = skin * float(np.prod(frame.spacing_mm)) / covered if covered else 0.0
    return _Faces(areas[:, 0], areas[:, 1], areas[:, 2], thickness)


def _found(
    labels: NDArray[np.uint8], frame: VoxelFrame, first: int, faces: _Faces
) -> tuple[list[CutEnd], list[str]]:
    """Cut ends, and what is to be said of bare tissue that lies in no plane."""
    ends = []
    for way, area in enumerate(faces.at_end):
        if area >= MIN_AREA_MM2:
            axis, upper = 1 + way // 2, way % 2
            normal = np.zeros(3)
            normal[axis] = 2.0 * upper - 1.0
            last = frame.origin_mm[axis] + frame.spacing_mm[axis] * (
                labels.shape[axis] - 0.5 if upper else -0.5
            )
            ends.append(CutEnd(normal, float(normal[axis] * last), float(area)))
    bare = float(faces.bare.sum())
    if bare < MIN_AREA_MM2 or faces.skin.sum() < MIN_COVERED * (bare + faces.skin.sum()):
        return ends, []
    net = np.array([0.0, *(faces.bare[1::2] - faces.bare[::2])])
    area = float(np.linalg.norm(net))
    if area >= MIN_AREA_MM2:
        place, flat = _plane(labels, frame, first, net / area)
        if flat >= MIN_FLAT:
            return [*ends, CutEnd(net / area, place, area)], []
    return ends, [
        f"{bare / 100.0:.0f} cm2 of tissue have no skin, away from the chest wall, and lie in no "
        f"one plane: they were taken for the breast's own surface"
    ]


def _plane(
    labels: NDArray[np.uint8], frame: VoxelFrame, first: int, normal: NDArray[np.float64]
) -> tuple[float, float]:
    """Place of the plane that holds most of the bare tissue, mm, and its part of all that is bare.

    Its faces lie half a voxel beyond the voxels' centres.
    """
    bin_mm = 0.5 * float(frame.spacing_mm.min())
    along = [normal[axis] * frame.axis_mm(axis) for axis in (1, 2)]
    start = sum(float(values.min()) for values in along)
    y, z = (values / bin_mm for values in along)
    y -= start / bin_mm
    bins = int(y.max() + z.max()) + 2
    places = np.zeros((labels.shape[0], bins), np.int64)
    count_places(labels, _covers(), y, z, places)
    profile = places[first:].sum(axis=0).astype(np.float64)
    width = max(1, round((FLAT_MM + float(frame.spacing_mm.max())) / bin_mm))
    within = np.convolve(profile, np.ones(width), mode="full")[width - 1 :]
    best = int(within.argmax())
    window = profile[best : best + width]
    middle = np.average(best + np.arange(len(window)) + 0.5, weights=window)
    half_mm = 0.5 * float(np.abs(normal) @ frame.spacing_mm)
    return start + float(middle) * bin_mm + half_mm, float(within[best] / profile.sum())


def _given(labels: NDArray[np.uint8], frame: VoxelFrame, way: tuple[float, float, float]) -> CutEnd:
    """The end in a direction that the user gave: as far as tissue extends."""
    if not is_way_out(way):
        raise InputError(f"phantom.open_end: found {way}, expected {WAY_EXPECTED}")
    normal = np.asarray(way, dtype=np.float64)
    normal = np.array([0.0, *normal[1:]]) / float(np.linalg.norm(normal[1:]))
    section = labels.any(axis=0)
    y, z = (normal[axis] * frame.axis_mm(axis) for axis in (1, 2))
    half_mm = 0.5 * float(np.abs(normal) @ frame.spacing_mm)
    return CutEnd(normal, float((y[:, None] + z)[section].max()) + half_mm, 0.0)


def _own_depth(
    labels: NDArray[np.uint8], frame: VoxelFrame
) -> tuple[NDArray[np.float64], VoxelFrame]:
    """Depth below the breast's surface, mm, negative outside, and its grid.

    Behind its tissue the breast goes on: what lies behind is tissue, too.
    """
    step = max(1, round(GRID_MM / float(frame.spacing_mm.min())))
    step = min(step, *labels.shape)
    margin = int(np.ceil(DEEP_MM / (step * float(frame.spacing_mm[0]))))
    tissue = np.pad(every_nth(labels, step) != 0, ((1, 1), (2, 2), (2, 2)))
    tissue = np.logical_or.accumulate(tissue[::-1], axis=0)[::-1]
    tissue = np.concatenate([np.repeat(tissue[:1], margin, axis=0), tissue])
    spacing = step * frame.spacing_mm
    depth = ndimage.distance_transform_edt(tissue, sampling=spacing)
    depth -= ndimage.distance_transform_edt(~tissue, sampling=spacing)
    depth = ndimage.gaussian_filter(np.clip(depth, -DEEP_MM, DEEP_MM), SMOOTH_MM / spacing)
    depth = depth[margin:]
    nx, ny, nz = depth.shape
    origin = frame.position_mm(np.full(3, step // 2)) - spacing * [1, 2, 2]
    return depth, VoxelFrame(origin, spacing, (nx, ny, nz))


def _held_depth(
    depth_mm: NDArray[np.float64],
    grid: VoxelFrame,
    nipple_mm: NDArray[np.float64],
    end: CutEnd,
) -> NDArray[np.float64] | None:
    """Depth below the skin in views that leave the end out, mm, or None where it is too near.

    On the way to the end the breast goes over into a surface of its own: that of its two sides,
    turned about the nipple's axis from one to the other. `anatomy.outline.held_depth` does the same
    for generated breasts, whose surface without the axilla is known.
    """
    along = np.cross([1.0, 0.0, 0.0], end.normal)  # to one of the two sides
    y, z = (grid.axis_mm(axis) - nipple_mm[axis] for axis in (1, 2))
    way = end.normal[1] * y[:, None] + end.normal[2] * z
    side = along[1] * y[:, None] + along[2] * z
    distance = np.hypot(way, side)
    steps_mm = float(grid.spacing_mm[1:].min())
    out_mm = np.arange(0.0, distance.max() + 2.0 * steps_mm, steps_mm)
    one, other = (_along_side(depth_mm, grid, nipple_mm, sign * along, out_mm) for sign in (1, -1))
    cut_mm = end.place_mm - float(end.normal @ nipple_mm)
    radius_mm = _radius_mm(one, other, steps_mm)
    if cut_mm < NEAREST * radius_mm:
        return None
    started = (way / min(radius_mm, cut_mm / (HELD_FROM + HELD_OVER)) - HELD_FROM) / HELD_OVER
    part = smooth_step(started)
    share = 0.5 * (1.0 + side / np.maximum(distance, 1e-6))
    low = (distance / steps_mm).astype(np.int64)
    rest = distance / steps_mm - low
    held = np.full(depth_mm.shape, DEEP_MM)
    moved = part > 0.0
    for layer in range(depth_mm.shape[0]):
        turned = share * _between(one[layer], low, rest)
        turned += (1.0 - share) * _between(other[layer], low, rest)
        own = depth_mm[layer]
        held[layer][moved] = (own + part * (turned - own))[moved]
    return held


def _between(
    line: NDArray[np.float64], low: NDArray[np.int64], rest: NDArray[np.float64]
) -> NDArray[np.float64]:
    values: NDArray[np.float64] = line[low] + rest * (line[low + 1] - line[low])
    return values


def _along_side(
    depth_mm: NDArray[np.float64],
    grid: VoxelFrame,
    nipple_mm: NDArray[np.float64],
    direction: NDArray[np.float64],
    out_mm: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Depth at distances from the nipple's axis to one side, [x, distance] mm."""
    points = nipple_mm + out_mm[:, None] * direction
    points = np.broadcast_to(points, (depth_mm.shape[0], *points.shape)).copy()
    points[..., 0] = grid.axis_mm(0)[:, None]
    index = np.moveaxis(grid.index(points), -1, 0)
    line: NDArray[np.float64] = ndimage.map_coordinates(depth_mm, index, order=1, mode="nearest")
    return line


def _radius_mm(one: NDArray[np.float64], other: NDArray[np.float64], steps_mm: float) -> float:
    """Mean half width of the breast across the way to its end, at its widest."""
    widths = ((one > 0.0).sum(axis=1) + (other > 0.0).sum(axis=1)) * 0.5 * steps_mm
    return float(widths.max())
