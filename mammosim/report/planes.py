"""The breast seen through along three axes, from uncompressed to compressed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.compression import CompressedBreast
from mammosim.phantom import BreastPhantom
from mammosim.report.figures import jpeg_data_uri
from mammosim.report.labels import Label, Marked, place_labels, sampled
from mammosim.targets import Target
from mammosim.tissues import TISSUES

MOST_POINTS = 160_000
"""Of tissue that are moved and drawn: a 550 mL breast has one every 1.5 mm."""

PIXEL_MM = 1.5
"""Of the drawings: they show shape and gland, the mammograms show detail."""

BLUR_PX = 0.7
"""Standard deviation of the blur that hides the points' grid."""

FRAMES = 9
"""Pictures from uncompressed to compressed, both ends included."""

MARGIN_MM = 6.0

_FONTS = 22.0  # sizes of the numbers' font in the height of a drawing
_DOT_FONTS = 0.32  # radius of a target's dot in that size

_FAT_SHARE = 0.1  # of the brightness of gland, a length; only shape and gland are to be seen
_BRIGHTEST = 0.995  # quantile of the pixels with tissue that is shown white


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

    def project(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 2) place in the drawing, mm to the right and **down**, as in SVG."""
        axes = np.array([self.right, np.negative(self.up)])
        placed: NDArray[np.float64] = points_mm @ axes.T
        return placed


PLANES = (
    Plane("frontal", "from the front", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    Plane("sagittal", "from the patient's left", (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    Plane("transverse", "from below", (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
)
"""As sections are hung: the patient's left on the right, anterior to the left or on top."""


@dataclass(frozen=True)
class Moved:
    """A target in one drawing: where it was and where it is, mm, and its number beside it."""

    label: Label
    name: str
    kind: str
    x: float
    y: float
    to_x: float
    to_y: float


@dataclass(frozen=True)
class Drawing:
    """One view seen along one direction.

    Parameters
    ----------
    plane : Plane
    left, top, width, height : float
        Box of the drawing, mm.
    frames : tuple of str
        Data URIs of the pictures, uncompressed first.
    targets : tuple of Moved
    """

    plane: Plane
    left: float
    top: float
    width: float
    height: float
    frames: tuple[str, ...]
    targets: tuple[Moved, ...]

    @property
    def dot_mm(self) -> float:
        """Radius of a target's dot."""
        return _DOT_FONTS * self.height / _FONTS


def drawings(squeezed: CompressedBreast, targets: Sequence[Target]) -> list[Drawing]:
    """See a view's breast through along three directions.

    Parameters
    ----------
    squeezed : CompressedBreast
    targets : sequence of Target
        Of this view.

    Returns
    -------
    list of Drawing
        One a plane of `PLANES`.

    Notes
    -----
    Between both ends each point goes straight and evenly: that is a way of drawing, not a
    solution of the model at a lesser compression. Points of tissue are added up along the line of
    sight, gland and lesions brighter than fat.
    """
    points, weights = _points(squeezed.phantom)
    shifts = squeezed.displacement_at(points)
    return [_drawing(plane, points, shifts, weights, targets) for plane in PLANES]


def _points(phantom: BreastPhantom) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Evenly taken points of tissue (n, 3), breast frame, mm, and their brightness (n,)."""
    shares = np.zeros(256)
    for label, name in phantom.tissue_of_label.items():
        for part, share in (TISSUES[name].mixture or {name: 1.0}).items():
            if TISSUES[part].material is not None:
                shares[label] += share * (_FAT_SHARE if part == "adipose" else 1.0)
    tissue = sum(int(np.count_nonzero(plane)) for plane in phantom.labels)
    volume_mm3 = tissue * float(np.prod(phantom.voxel_mm))
    wanted_mm = max(1.0, (volume_mm3 / MOST_POINTS) ** (1.0 / 3.0))
    steps = np.maximum(1, np.rint(wanted_mm / phantom.voxel_mm)).astype(int)
    some = phantom.labels[tuple(slice(None, None, step) for step in steps)]
    index = np.argwhere(some)
    return phantom.frame.position_mm(index * steps), shares[some[tuple(index.T)]]


def _drawing(
    plane: Plane,
    points: NDArray[np.float64],
    shifts: NDArray[np.float64],
    weights: NDArray[np.float64],
    targets: Sequence[Target],
) -> Drawing:
    here, moved = plane.project(points), plane.project(shifts)
    corners = np.concatenate([here, here + moved])
    low = corners.min(axis=0) - MARGIN_MM
    size = np.ceil((corners.max(axis=0) + MARGIN_MM - low) / PIXEL_MM).astype(int)
    brightest = 0.0
    frames: list[str] = []
    for share in np.linspace(0.0, 1.0, FRAMES):
        place = (here + share * moved - low) / PIXEL_MM - 0.5
        image = ndimage.gaussian_filter(_splatted(place, weights, size), BLUR_PX)
        if not frames:
            brightest = float(np.quantile(image[image > 0.0], _BRIGHTEST))
        frames.append(_uri(image / brightest))
    (left, top), (width, height) = low.tolist(), (size * PIXEL_MM).tolist()
    box = (left, top, width, height)
    return Drawing(plane, *box, tuple(frames), tuple(_moved(plane, targets, box)))


def _splatted(
    place: NDArray[np.float64], weights: NDArray[np.float64], size: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Sum of the points' weights on pixels [row, column], each shared among the four nearest."""
    width, height = int(size[0]), int(size[1])
    low = np.floor(place).astype(np.intp)
    part = place - low
    image = np.zeros(width * height)
    for right in (0, 1):
        for down in (0, 1):
            share = np.where(right, part[:, 0], 1.0 - part[:, 0])
            share = share * np.where(down, part[:, 1], 1.0 - part[:, 1])
            pixel = (low[:, 1] + down) * width + low[:, 0] + right
            image += np.bincount(pixel, weights * share, width * height)
    return image.reshape(height, width)


def _uri(image: NDArray[np.float64]) -> str:
    grey = np.rint(255.0 * np.sqrt(np.clip(image, 0.0, 1.0))).astype(np.uint8)
    return jpeg_data_uri(grey)


def _moved(
    plane: Plane, targets: Sequence[Target], box: tuple[float, float, float, float]
) -> list[Moved]:
    """The targets with their numbers, which stand clear all along the targets' way."""
    start = plane.project(np.array([target.place_mm for target in targets]).reshape(-1, 3))
    shift = plane.project(np.array([target.shift_vector_mm for target in targets]).reshape(-1, 3))
    font = box[3] / _FONTS
    ways = sampled(zip(start, start + shift, strict=True), font)
    shares = np.linspace(0.0, 1.0, FRAMES)[:, None, None]
    texts = ["N" if target.kind == "nipple" else str(target.target_id) for target in targets]
    marked = Marked(start + shares * shift, [_DOT_FONTS * font] * len(texts), box,
                    [ways] * FRAMES)  # fmt: skip
    labels = place_labels(marked, texts, [font] * len(texts), (1.0, -0.5))
    ends = np.concatenate([start, start + shift], axis=1).tolist()
    return [
        Moved(label, target.name, target.kind, *end)
        for label, target, end in zip(labels, targets, ends, strict=True)
    ]
