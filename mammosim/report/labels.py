"""Places for the numbers beside marks, so that none covers another or its own mark."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]

# Of a bold sans-serif letter or digit, in units of the font's size, with its dark outline; fonts
# differ, so the widest usual one (DejaVu Sans Bold, 0.70) counts.
LETTER_WIDTH, LETTER_HEIGHT = 0.72, 0.9
BASELINE = 0.36  # of the middle of a digit above its baseline, in the same units
GAP = 0.2  # between a mark and its number, and around it
FARTHER = 0.5  # by which a number is tried farther out
DIRECTIONS = 16
# What counts against a place, in steps of `FARTHER`: another mark that the number would cover, and
# each point of a line that it would; the worst direction counts `ASIDE`.
OVER_MARK, OVER_LINE, ASIDE = 5.0, 0.5, 1.0
NOT_FREE, NOT_INSIDE = 1e6, 1e3  # over another text; out of the drawing
RINGS_AT_ONCE = 6
LEAD = 0.6  # a number farther from its mark than this gets a line to it


@dataclass(frozen=True)
class Label:
    """A mark's number, relative to the mark's centre, in the drawing's units; y runs down.

    Parameters
    ----------
    text : str
    x, y : float
        Where the middle of the text's baseline is.
    size : float
        Of the font.
    lead : tuple of float
        x, y of the ends of the line from the mark to a text that stands apart; else empty.
    """

    text: str
    x: float
    y: float
    size: float
    lead: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Marked:
    """What is in a drawing before its numbers, in the drawing's units; y runs down.

    Parameters
    ----------
    places : array_like, [state, mark, 2]
        Middle of each mark; in several states where the marks move, as under a slider.
    radii : array_like, [mark]
        Of the circles that the marks fill.
    box : tuple of float
        Left, top, width and height of the drawing.
    lines : array_like, [state, n, 2]
        Points of lines that numbers should rather not cover.
    taken : array_like, [n, 4]
        Middle x and y, width and height of other texts.
    """

    places: ArrayLike
    radii: ArrayLike
    box: tuple[float, float, float, float]
    lines: ArrayLike = ()
    taken: ArrayLike = ()


def place_labels(
    marked: Marked, texts: Sequence[str], sizes: Sequence[float], towards: tuple[float, float]
) -> list[Label]:
    """Place the marks' numbers, one after the other.

    Parameters
    ----------
    marked : Marked
    texts : sequence of str
    sizes : sequence of float
        Of the numbers' fonts, drawing's units.
    towards : tuple of float
        Direction in which a number stands where nothing is in its way.

    Returns
    -------
    list of Label
        Each stays in the drawing and clear of the others and of its own mark, in all states, as
        long as there is any such place; it keeps off other marks and lines where it can.

    Notes
    -----
    Each takes the best of the places in `DIRECTIONS` around its mark, ever farther out, that those
    before it leave. Nothing is random.
    """
    room = _Room(marked, len(texts))
    labels = []
    for number, (text, size) in enumerate(zip(texts, sizes, strict=True)):
        half = 0.5 * size * (np.array([LETTER_WIDTH * len(text), LETTER_HEIGHT]) + GAP)
        radius = float(room.radii[number])
        offset = _best(room, number, half, size, towards)
        label = _label(text, size, offset, radius, half)
        room.take(number, offset, half, label.lead, size)
        labels.append(label)
    return labels


def sampled(lines: Iterable[tuple[ArrayLike, ArrayLike]], size: float) -> Points:
    """Points (n, 2) of straight lines from start to end, half the size of a font apart or less."""
    points = [np.empty((0, 2))]
    for ends in lines:
        start, end = (np.asarray(place, dtype=float) for place in ends)
        count = 2 + math.ceil(2.0 * float(np.linalg.norm(end - start)) / size)
        points.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
    return np.concatenate(points)


class _Room:
    """What of a drawing is taken."""

    def __init__(self, marked: Marked, count: int) -> None:
        places = np.asarray(marked.places, dtype=float)
        self.places = places.reshape(len(places), count, 2)
        self.radii = np.asarray(marked.radii, dtype=float)
        self.corner, self.size = np.array(marked.box[:2]), np.array(marked.box[2:])
        states = len(self.places)
        self._lines = np.asarray(marked.lines, dtype=float).reshape(states, -1, 2)
        texts = np.asarray(marked.taken, dtype=float).reshape(-1, 4)
        self._texts = np.tile(texts, (states, 1, 1))

    def take(
        self, number: int, offset: Points, half: Points, lead: tuple[float, ...], size: float
    ) -> None:
        """Put a mark's number at an offset from it."""
        here = self.places[:, number]
        text = np.concatenate([here + offset, np.broadcast_to(2.0 * half, here.shape)], axis=1)
        self._texts = np.concatenate([self._texts, text[:, None]], axis=1)
        if lead:
            line = here[:, None] + sampled([(lead[:2], lead[2:])], size)
            self._lines = np.concatenate([self._lines, line], axis=1)

    def cost(self, number: int, offsets: Points, half: Points) -> Points:
        """What a mark's number would cover at offsets (n, 2) from it, in the worst state, (n,)."""
        middles = (self.places[:, number, None] + offsets)[:, :, None]  # [state, place, 1, 2]
        texts = self._texts[:, None]
        over_texts = np.abs(texts[..., :2] - middles) < half + 0.5 * texts[..., 2:]
        over_lines = np.abs(self._lines[:, None] - middles) < half
        others = np.delete(self.places, number, axis=1)[:, None]
        gaps = np.linalg.norm(np.maximum(np.abs(others - middles) - half, 0.0), axis=-1)
        corner = middles[:, :, 0] - half - self.corner
        out = ((corner < 0.0) | (corner + 2.0 * half > self.size)).any(axis=-1)
        total: Points = (
            NOT_FREE * over_texts.all(axis=-1).sum(axis=-1)
            + NOT_INSIDE * out
            + OVER_MARK * (gaps < np.delete(self.radii, number)).sum(axis=-1)
            + OVER_LINE * over_lines.all(axis=-1).sum(axis=-1)
        ).max(axis=0)
        return total


def _best(
    room: _Room, number: int, half: Points, size: float, towards: tuple[float, float]
) -> Points:
    """The offset (2,) of least cost of a number's middle from its mark."""
    first = math.atan2(towards[1], towards[0])
    angles = first + 2.0 * math.pi / DIRECTIONS * np.arange(DIRECTIONS)
    units = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    aside = 0.5 * ASIDE * (1.0 - np.cos(angles - first))
    # The text's box and the mark's circle are apart along the line between their middles.
    nearest = room.radii[number] + GAP * size + np.abs(units) @ half
    least, best = math.inf, np.zeros(2)
    most = 1 + math.ceil(float(np.linalg.norm(room.size)) / (FARTHER * size))
    for start in range(0, most, RINGS_AT_ONCE):
        if least <= start:
            break  # farther out costs more
        rings = np.arange(start, start + RINGS_AT_ONCE)[:, None]
        offsets = ((nearest + FARTHER * size * rings)[:, :, None] * units).reshape(-1, 2)
        cost = (rings + aside).ravel() + room.cost(number, offsets, half)
        chosen = int(np.argmin(cost))
        if cost[chosen] < least:
            least, best = float(cost[chosen]), offsets[chosen]
    return best


def _label(text: str, size: float, offset: Points, radius: float, half: Points) -> Label:
    x, y = offset.tolist()
    away = float(np.linalg.norm(offset))
    end = np.clip(0.0, offset - half, offset + half)  # the point of the text nearest to the mark
    lead: tuple[float, ...] = ()
    if float(np.linalg.norm(end)) - radius > LEAD * size:
        start = radius / away * offset
        lead = (*start.tolist(), *end.tolist())
    return Label(text, x, y + BASELINE * size, size, lead)
