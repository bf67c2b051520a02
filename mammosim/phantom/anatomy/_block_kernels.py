"""A block of voxels, a cell of the coarse grid: what it is made from, and values within it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import borrowing_kernel, kernel, merged_kernel
from mammosim.phantom.anatomy._net_kernels import Near, Net, new_near
from mammosim.phantom.anatomy._noise_kernels import MAX_CORNERS

SKIN_DEPTH, MUSCLE_DEPTH, POTENTIAL, SEPTUM, SKIN_MM, NET, FIBRE = (
    np.intp(n) for n in (0, 1, 2, 3, 4, 5, 8)
)
"""Channels of the coarse fields; NET and FIBRE take three each."""

CHANNELS = 11
"""Number of all of these."""

SUB_STEPS = 4
"""Steps of a block's sub-grid: 0.5 mm, against a finest noise of 1.6 mm."""


class Lattice(NamedTuple):
    """Where voxels and coarse grid lie, in generator coordinates (x, lateral, superior), mm.

    `x_start` and so on give the first voxel of each block, and the number of voxels last.
    """

    x_mm: NDArray[np.float64]
    lateral_mm: NDArray[np.float64]
    superior_mm: NDArray[np.float64]
    coarse_origin_mm: NDArray[np.float64]
    coarse_mm: float
    x_start: NDArray[np.int64]
    lateral_start: NDArray[np.int64]
    superior_start: NDArray[np.int64]


class Texture(NamedTuple):
    """Everything that decides the fine structure.

    `fields` is (x, lateral, superior, channel); `lobules` is the net of fat lobules, `bundles` that
    of the muscle's; amplitudes are in units of the potential. Lobes of gland raise the potential
    by at most `gland_push`. Gland is where the potential above the threshold, at most `gland_cap`,
    and the tile times `gland_scale` are positive together; fat streaks of muscle are where the
    tile's noise exceeds `muscle_streaks` standard deviations.
    """

    fields: NDArray[np.float32]
    lobules: Net
    bundles: Net
    apex_mm: NDArray[np.float64]
    fan_amplitude: NDArray[np.float64]
    fan_per_radian: NDArray[np.float64]
    grain_amplitude: NDArray[np.float64]
    grain_mm: NDArray[np.float64]
    noise_limit: float
    lobule_mm: float
    lobule_amplitude: float
    gland_push: float
    grain_tile: NDArray[np.int8]
    gland_scale: float
    gland_cap: float
    muscle_streaks: float
    key: int


class Paint(NamedTuple):
    """Labels and lengths that the last step needs.

    `nipple` is described at `in_nipple`; `areola_mm` is extra thickness of the skin at the
    nipple and the radius over which it is lost; `cut` is the direction out of the open end and its
    distance from the nipple's axis.
    """

    nipple: NDArray[np.float64]
    areola_mm: NDArray[np.float64]
    cut: NDArray[np.float64]
    cover_mm: float
    threshold: float
    labels: NDArray[np.uint8]


ADIPOSE, SKIN, GLAND, NIPPLE, MUSCLE, LIGAMENT, EIGHTH, QUARTER, HALF = range(9)
"""Places in `Paint.labels`."""


class Places(NamedTuple):
    """Scratch of places of a block: where they are, in mm and in parts of its side, their distance
    (a third of its logarithm) and direction from the nipple, where noise is looked up for them, its
    gradients and the lattice points that have them, and what the noise, or all of the potential,
    comes to."""

    at_mm: NDArray[np.float64]
    part: NDArray[np.float64]
    fan: NDArray[np.float64]
    seen: NDArray[np.float64]
    gradients: NDArray[np.float64]
    span: NDArray[np.int64]
    noise: NDArray[np.float64]


class Block(NamedTuple):
    """Scratch of one block: its first corner, mm, corners of each channel, its sub-grid and a row
    of it, slope and centre of the net's coordinates, first node of a cell of the sub-grid, the
    sides of a layer of rows, net coordinates at the block's corners and a row's ends, walls near
    it, the planes of the sub-grid that are wanted, and places of it."""

    origin: NDArray[np.float64]
    corner: NDArray[np.float64]
    sub: NDArray[np.float64]
    sub_row: NDArray[np.float64]
    slope: NDArray[np.float64]
    centre: NDArray[np.float64]
    low: NDArray[np.float64]
    side: NDArray[np.float64]
    corners: NDArray[np.float64]
    ends: NDArray[np.float64]
    near: Near
    wanted: NDArray[np.bool_]
    places: Places


@kernel
def new_block() -> Block:
    n = SUB_STEPS + 1
    return Block(
        np.empty(3), np.empty((CHANNELS, 8)), np.empty((n, n, n)), np.empty(n), np.empty((3, 3)),
        np.empty(3), np.empty(3), np.empty((CHANNELS, 4)), np.empty((8, 3)), np.empty((2, 3)),
        new_near(), np.zeros((3, n), np.bool_),
        Places(
            np.empty((n**3, 3)), np.empty((n**3, 3)), np.empty((n**3, 3)), np.empty((n**3, 3)),
            np.empty((MAX_CORNERS, 3)), np.empty((2, 3), np.int64), np.empty(n**3),
        ),
    )  # fmt: skip


@borrowing_kernel
def load_corners(
    fields: NDArray[np.float32], i: int, j: int, k: int, corner: NDArray[np.float64]
) -> None:
    """All channels at the eight corners of a block, the last axis fastest."""
    for a in range(2):
        for b in range(2):
            for c in range(2):
                for channel in range(CHANNELS):
                    corner[channel, 4 * a + 2 * b + c] = fields[i + a, j + b, k + c, channel]


@borrowing_kernel
def least_and_most(corner: NDArray[np.float64], channel: int) -> tuple[float, float]:
    """Least and largest value of a channel at the corners of a block.

    Arrays' own ``min`` and ``max`` count references.
    """
    least = most = corner[channel, 0]
    for n in range(1, 8):
        least, most = min(least, corner[channel, n]), max(most, corner[channel, n])
    return least, most


@merged_kernel
def _bilinear(c00: float, c01: float, c10: float, c11: float, u: float, v: float) -> float:
    """Value within a square from its corners, v along the second axis."""
    return (1.0 - u) * ((1.0 - v) * c00 + v * c01) + u * ((1.0 - v) * c10 + v * c11)


@merged_kernel
def trilinear(corner: NDArray[np.float64], channel: int, u: float, v: float, w: float) -> float:
    """Value of a channel within a block from its corners."""
    low = _bilinear(
        corner[channel, 0], corner[channel, 1], corner[channel, 2], corner[channel, 3], v, w
    )
    high = _bilinear(
        corner[channel, 4], corner[channel, 5], corner[channel, 6], corner[channel, 7], v, w
    )
    return (1.0 - u) * low + u * high


@borrowing_kernel
def layer_sides(corner: NDArray[np.float64], v: float, side: NDArray[np.float64]) -> None:
    """All channels where a layer across the second axis meets the edges of its block."""
    for channel in range(CHANNELS):
        for edge in range(4):
            c = 4 * (edge >> 1) + (edge & 1)
            side[channel, edge] = (1.0 - v) * corner[channel, c] + v * corner[channel, c + 2]


@merged_kernel
def along_row(side: NDArray[np.float64], channel: int, u: float) -> tuple[float, float]:
    """Value of a channel at the start of a row of a layer, and its change up to the end."""
    low = (1.0 - u) * side[channel, 0] + u * side[channel, 2]
    return low, (1.0 - u) * side[channel, 1] + u * side[channel, 3] - low


@merged_kernel
def sub_index(part: float) -> int:
    """Cell of the sub-grid along an axis at a part of the block's side."""
    return min(int(part * SUB_STEPS), SUB_STEPS - 1)


@borrowing_kernel
def sub_row_values(sub: NDArray[np.float64], u: float, v: float, out: NDArray[np.float64]) -> None:
    """The sub-grid's values along a row of the block."""
    a, b = sub_index(u), sub_index(v)
    p, q = u * SUB_STEPS - a, v * SUB_STEPS - b
    for c in range(SUB_STEPS + 1):
        out[c] = _bilinear(
            sub[a, b, c], sub[a, b + 1, c], sub[a + 1, b, c], sub[a + 1, b + 1, c], p, q
        )


@merged_kernel
def on_sub_row(sub_row: NDArray[np.float64], w: float) -> float:
    """Value at a part of the row of `sub_row_values`."""
    c = sub_index(w)
    part = w * SUB_STEPS - c
    return (1.0 - part) * sub_row[c] + part * sub_row[c + 1]
