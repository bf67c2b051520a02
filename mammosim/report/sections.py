"""Plane sections of a breast: uncompressed, compressed, and in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from mammosim.compression import CompressedBreast, DisplacementField
from mammosim.geometry import VoxelFrame
from mammosim.phantom import BreastPhantom, tissue_box_mm
from mammosim.tissues import TISSUES

PIXEL_MM = 1.0
"""Of the sections: skin is one or two pixels; the mammograms show detail."""

FIELD_MM = 3.0
"""Smallest spacing of the displacement field that places a section's pixels between nodes."""

MARGIN_MM = 6.0
"""Air around the breast in a section, mm, for the eye."""

_BRIGHTNESS = {"adipose": 0.32, "skin": 0.85, "muscle": 0.6, "ligament": 0.65}
_GLAND, _LESION = 0.75, 1.0
"""Fractions of white: fat dark and gland bright, in the order of attenuation but not to scale."""


@dataclass(frozen=True)
class Plane:
    """A direction of looking.

    Parameters
    ----------
    name : str
    caption : str
        From where one looks, in words.
    right, up : tuple of float
        Breast-frame vectors that point right and up in the drawing.
    """

    name: str
    caption: str
    right: tuple[float, float, float]
    up: tuple[float, float, float]

    @property
    def axes(self) -> NDArray[np.float64]:
        """(2, 3) breast-frame vectors to the right and **down** in the drawing, as in SVG."""
        return np.array([self.right, np.negative(self.up)])

    def project(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) place in the drawing, mm to the right and down."""
        placed: NDArray[np.float64] = points_mm @ self.axes.T
        return placed

    def points(
        self, place_mm: NDArray[np.float64], through_mm: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(..., 3) breast-frame points of the plane through a point, at places in the drawing."""
        normal = np.cross(self.right, self.up)
        points: NDArray[np.float64] = place_mm @ self.axes + normal * (normal @ through_mm)
        return points


PLANES = (
    Plane("frontal", "from the front", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    Plane("sagittal", "from the patient's left", (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    Plane("transverse", "from below", (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
)
"""As sections are hung: the patient's left on the right, anterior to the left or on top."""


@dataclass(frozen=True)
class Box:
    """Rectangle of a drawing, mm to the right and down."""

    left: float
    top: float
    width: float
    height: float

    @property
    def sides(self) -> tuple[float, float, float, float]:
        """Left, top, width and height."""
        return self.left, self.top, self.width, self.height

    @property
    def centres_mm(self) -> NDArray[np.float64]:
        """(row, column, 2) places of the pixels' centres."""
        columns, rows = (round(length / PIXEL_MM) for length in (self.width, self.height))
        right = self.left + (np.arange(columns) + 0.5) * PIXEL_MM
        down = self.top + (np.arange(rows) + 0.5) * PIXEL_MM
        return np.stack(np.meshgrid(right, down), axis=-1)


def breast_sections(
    phantom: BreastPhantom, through_mm: NDArray[np.float64] | None = None
) -> list[tuple[Plane, Box, NDArray[np.uint8]]]:
    """Each plane of `PLANES` through an uncompressed breast: its box and its grey levels.

    Parameters
    ----------
    phantom : BreastPhantom
    through_mm : ndarray, (3,), optional
        Point of the planes, breast frame, mm; default `middle_mm`.
    """
    through = middle_mm(phantom) if through_mm is None else through_mm
    corners = tissue_box_mm(phantom)
    boxes = [(plane, _box_around(plane, corners)) for plane in PLANES]
    return [(plane, box, section(phantom, plane, through, box)) for plane, box in boxes]


def moved_sections(
    compressed: CompressedBreast, shares: Sequence[float]
) -> list[tuple[Plane, Box, list[NDArray[np.uint8]]]]:
    """Each plane of `PLANES` through a breast as it is compressed: its box, and grey levels.

    Parameters
    ----------
    compressed : CompressedBreast
    shares : sequence of float
        Parts of the displacement that tissue has moved by, 0 to 1; grey levels are given for each.

    Notes
    -----
    The planes pass through `middle_mm` and move with the tissue there.
    """
    phantom, start = compressed.phantom, middle_mm(compressed.phantom)
    shift = compressed.displacement_at(start)[0]
    steps = [
        (start + share * shift, interpolated_field(compressed.field, share) if share else None)
        for share in shares
    ]
    corners = _moved_corners_mm(compressed)
    found = []
    for plane in PLANES:
        box = _box_around(plane, corners)
        greys = [section(phantom, plane, through, box, field) for through, field in steps]
        found.append((plane, box, greys))
    return found


def middle_mm(phantom: BreastPhantom) -> NDArray[np.float64]:
    """(3,) the first lesion's place; without any, half way from the chest wall to the nipple."""
    if phantom.lesions:
        return phantom.lesions[0].position_mm
    low, high = tissue_box_mm(phantom)
    return np.array([0.5 * (low[0] + high[0]), *phantom.nipple_mm[1:]])


def _box_around(plane: Plane, corners_mm: NDArray[np.float64]) -> Box:
    """The rectangle around breast-frame points (n, 3), with a margin, in whole pixels."""
    placed = plane.project(corners_mm)
    low = placed.min(axis=0) - MARGIN_MM
    size = np.ceil((placed.max(axis=0) + MARGIN_MM - low) / PIXEL_MM) * PIXEL_MM
    return Box(*low.tolist(), *size.tolist())


def section(
    phantom: BreastPhantom,
    plane: Plane,
    through_mm: NDArray[np.float64],
    box: Box,
    field: DisplacementField | None = None,
) -> NDArray[np.uint8]:
    """Grey levels of the tissue in a plane.

    Parameters
    ----------
    phantom : BreastPhantom
    plane : Plane
    through_mm : ndarray, (3,)
        A point of the plane, breast frame, mm.
    box : Box
        The part of the plane to show.
    field : DisplacementField, optional
        How tissue was moved; without it the breast lies uncompressed.

    Returns
    -------
    ndarray of uint8, [row, column]

    Notes
    -----
    Each pixel shows the one voxel whose tissue came to lie at its centre; the inverse of the
    displacement is interpolated trilinearly on its grid.
    """
    centres = box.centres_mm
    points = plane.points(centres, through_mm).reshape(-1, 3)
    if field is not None:
        points = _origins(field, points)
    index = np.rint(phantom.frame.index(points))
    inside = ((index >= 0) & (index <= np.array(phantom.labels.shape) - 1)).all(axis=1)  # not NaN
    at = index[inside].astype(np.intp)
    labels = np.zeros(len(points), np.uint8)
    labels[inside] = phantom.labels[at[:, 0], at[:, 1], at[:, 2]]
    return grey_of_label(phantom)[labels].reshape(centres.shape[:2])


def grey_of_label(phantom: BreastPhantom) -> NDArray[np.uint8]:
    """(256,) grey level of each label; air and the outside are black."""
    shares = np.zeros(256)
    for label, name in phantom.tissue_of_label.items():
        for part, share in (TISSUES[name].mixture or {name: 1.0}).items():
            if TISSUES[part].material is not None:
                shares[label] += share * _BRIGHTNESS.get(part, _GLAND)
    for lesion in phantom.lesions:
        shares[lesion.label] = _LESION
    return np.rint(255.0 * shares).astype(np.uint8)


def _origins(field: DisplacementField, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) where tissue at points (n, 3) came from, breast frame, mm; NaN in air."""
    inverse = field.inverse
    index = inverse.frame.index(points_mm @ field.rotation.T).T
    places = [
        map_coordinates(inverse.original_mm[..., axis], index, output=np.float64, order=1,
                        mode="constant", cval=np.nan)
        for axis in range(3)
    ]  # fmt: skip
    return np.stack(places, axis=1) @ field.rotation


def interpolated_field(field: DisplacementField, share: float) -> DisplacementField:
    """A coarser field for display, in which each point has moved by a share of its displacement."""
    step = max(1, round(FIELD_MM / float(max(field.frame.spacing_mm))))
    some = (slice(None, None, step),) * 3
    displacement = np.ascontiguousarray(field.displacement_mm[some]) * np.float32(share)
    nx, ny, nz = displacement.shape[:3]
    frame = VoxelFrame(field.frame.origin_mm, field.frame.spacing_mm * step, (nx, ny, nz))
    return replace(field, frame=frame, displacement_mm=displacement, tissue=field.tissue[some])


def _moved_corners_mm(compressed: CompressedBreast) -> NDArray[np.float64]:
    """(n, 3) points around the breast before and after compression, breast frame, mm."""
    field = interpolated_field(compressed.field, 1.0)
    points = field.frame.position_mm(np.argwhere(field.tissue))
    moved = points + field.displacement_mm[field.tissue]
    return np.concatenate([points, moved]) @ field.rotation
