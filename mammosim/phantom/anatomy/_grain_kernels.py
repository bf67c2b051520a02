"""The finest structure: a tile of noise that is repeated, looked up at a point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import merged_kernel

TILE = 128
"""Side of the tile, a power of two, so that repeating it is a mask."""

TILE_LIMIT = 2.6
"""Where the tile's noise is cut off, in standard deviations; this is 127 in the tile."""

TILE_STEP = TILE_LIMIT / 127.0
"""One in the tile, in standard deviations of its noise."""

ALONG = 0.7
"""Scale of the tile's first axis, along which structure is longer by its inverse, in muscle."""

BROAD = 2.5
"""Width of muscle's streaks of fat against the tile's structure: 1.2 to 10 mm, the width of its
bundles and less, and about four times as long. Finer ones drew a hatching. Chosen by eye."""

GLAND_PER_MM = (1.8, 5.0, 1.5)
"""Cells of the tile per millimetre of net coordinates in gland: across the way to the nipple
wavelengths of 0.5 to 4 mm; 2.8 times as long along this way, on which lobes and ducts run, and 3.3
times along the direction in which plates press, which shortens them to about half of that: sheets
seen edge-on keep their contrast through a plate of gland. Chosen by eye on projections."""

STEEPER = 1.0 / math.sqrt(1.0 - 2.0 / math.pi)
"""Standard deviation of normal noise against that of its magnitude."""

MOST_GLAND_GRAIN = 127.0 / TILE_LIMIT * math.sqrt(2.0 / math.pi) * STEEPER
"""Most that gland's grain can be, against the scale of the tile: the mean magnitude of normal noise
is the root of 2 / pi standard deviations."""

UNEVEN, UNEVEN_PER, MOST_UNEVEN = 0.45, 0.35, 1.7
"""Thickness of walls: change per standard deviation of the tile's noise, which is stretched by the
inverse of the second (1.5 to 11 mm), and the most against the mean. Chosen by eye."""


@merged_kernel
def grain_at(tile: NDArray[np.int8], p: float, q: float, r: float) -> float:
    """Noise at a point of net coordinates, mm, in standard deviations, from cells of 0.2 mm."""
    a = int(p * (5.0 * ALONG) + 65536.0) & (TILE - 1)
    b = int(q * 5.0 + 65536.0) & (TILE - 1)
    c = int(r * 5.0 + 65536.0) & (TILE - 1)
    return TILE_STEP * tile[a, b, c]


@merged_kernel
def muscle_grain_at(tile: NDArray[np.int8], p: float, q: float, r: float) -> float:
    """As `grain_at`, for streaks of fat in muscle, which are `BROAD` times as wide."""
    return grain_at(tile, p, q / BROAD, r / BROAD)


@merged_kernel
def wall_unevenness(tile: NDArray[np.int8], p: float, q: float, r: float) -> float:
    """Thickness of a wall at a point of net coordinates, mm, against its mean."""
    grain = grain_at(tile, UNEVEN_PER * p, UNEVEN_PER * q, UNEVEN_PER * r)
    return min(max(1.0 + UNEVEN * grain, 0.0), MOST_UNEVEN)


@merged_kernel
def gland_grain_at(tile: NDArray[np.int8], scale: float, p: float, q: float, r: float) -> float:
    """Grain of gland, on scales of its own: greatest where the tile's noise is zero, that is on
    thin bent sheets. Its mean and standard deviation are those of the noise.

    Sheets that are seen edge-on are the fine bright lines of gland. The noise itself, as often
    bright as dark, would be an even mottle in projection.
    """
    a = int(p * GLAND_PER_MM[0] + 65536.0) & (TILE - 1)
    b = int(q * GLAND_PER_MM[1] + 65536.0) & (TILE - 1)
    c = int(r * GLAND_PER_MM[2] + 65536.0) & (TILE - 1)
    return scale * (MOST_GLAND_GRAIN - STEEPER * abs(float(tile[a, b, c])))
