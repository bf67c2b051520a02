"""Sections of the breast along three planes, from uncompressed to compressed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mammosim.compression import CompressedBreast
from mammosim.report.figures import jpeg_data_uri
from mammosim.report.labels import Label, Marked, place_labels, sampled
from mammosim.report.sections import Box, Plane, moved_sections
from mammosim.targets import Target

FRAMES = 9
"""Pictures from uncompressed to compressed, both ends included."""

_FONTS = 22.0  # sizes of the numbers' font in the height of a drawing
_DOT_FONTS = 0.32  # radius of a target's dot in that size


class SectionFrames(NamedTuple):
    """A plane, its box, and its pictures as data URIs, uncompressed first."""

    plane: Plane
    box: Box
    frames: tuple[str, ...]


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


def section_frames(compressed: CompressedBreast) -> list[SectionFrames]:
    """Cut a view's breast along the three planes of `PLANES`, at each step of its compression.

    Parameters
    ----------
    compressed : CompressedBreast

    Notes
    -----
    The planes pass through the first lesion and go with it, or without lesions through the middle
    of the breast behind the nipple. Between both ends each point goes straight and evenly:
    interpolated for display only, not a solution of the model at a lesser compression.
    """
    sections = moved_sections(compressed, np.linspace(0.0, 1.0, FRAMES).tolist())
    return [
        SectionFrames(plane, box, tuple(jpeg_data_uri(grey) for grey in greys))
        for plane, box, greys in sections
    ]


def drawings(sections: Sequence[SectionFrames], targets: Sequence[Target]) -> list[Drawing]:
    """Mark a view's targets in its sections.

    Parameters
    ----------
    sections : sequence of SectionFrames
    targets : sequence of Target
        Of this view.
    """
    return [
        Drawing(plane, *box.sides, frames, tuple(_moved(plane, targets, box)))
        for plane, box, frames in sections
    ]


def _moved(plane: Plane, targets: Sequence[Target], box: Box) -> list[Moved]:
    """The targets with their numbers, which stand clear all along the targets' way."""
    start = plane.project(np.array([target.place_mm for target in targets]).reshape(-1, 3))
    shift = plane.project(np.array([target.shift_vector_mm for target in targets]).reshape(-1, 3))
    font = box.height / _FONTS
    ways = sampled(zip(start, start + shift, strict=True), font)
    shares = np.linspace(0.0, 1.0, FRAMES)[:, None, None]
    texts = ["N" if target.kind == "nipple" else str(target.target_id) for target in targets]
    marked = Marked(start + shares * shift, [_DOT_FONTS * font] * len(texts),
                    box.sides, [ways] * FRAMES)  # fmt: skip
    labels = place_labels(marked, texts, [font] * len(texts), (1.0, -0.5))
    ends = np.concatenate([start, start + shift], axis=1).tolist()
    return [
        Moved(label, target.name, target.kind, *end)
        for label, target, end in zip(labels, targets, ends, strict=True)
    ]
