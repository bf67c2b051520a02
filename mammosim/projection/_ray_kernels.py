"""Compiled loops of the tracer: rays through deformed voxels, in the units of `_grid_kernels`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, enclosed_kernel, parallel_kernel, share
from mammosim.projection._grid_kernels import (
    NOWHERE,
    Floats,
    Labels,
    Nodes,
    Place,
    Words,
    value_on_plane,
)

LABELS_PER_WORD = 8
"""Labels that are looked at together, as one 64-bit word of a little-endian machine."""

STEEP = 4.0
"""Segments that go through more voxels than this along z before they leave a column are followed
column by column, others slab by slab. Along a column voxels lie side by side in memory."""

_SKIN = 1e-6
"""Part of a voxel by which the array is taken smaller on each side, against rounding."""
_ROOM = 0.01
"""Part of a voxel by which a box is taken larger on each side, against rounding."""
_NO_BIT, _ONE = np.uint64(0), np.uint64(1)
_EACH_BYTE, _HIGHEST_OF_BYTES = np.uint64(0x0101010101010101), np.uint64(0x8080808080808080)

Axis = tuple[float, float, int]
"""Of an axis, along a segment: where it leaves its voxel, the way through one, and the step in
the array to the next, which is signed."""


class Beam(NamedTuple):
    """The rays of one view in grid units.

    `spot_u`, `spot_v`, `spot_k` is the focal spot as a fractional node; `planes_to_detector` the
    height of the spot above each row of pixels in grid planes; `first_plane` the lowest plane that
    is not below the detector; `spacing` the grid's spacing in mm; `row_v` and `column_u` where the
    rows and columns of pixels lie on the detector, as fractional nodes.
    """

    spot_u: float
    spot_v: float
    spot_k: float
    planes_to_detector: Floats
    first_plane: int
    spacing: Floats
    row_v: Floats
    column_u: Floats


class Voxels(NamedTuple):
    """The phantom's labels, run together, and what they are added to.

    `words` is the same memory, eight labels a word (the rest that fills no word left out).
    `channel_of_label` is the channel of each label; those whose lengths are not asked for go to a
    channel behind the last. `empty` [x, y, z] marks the cells of the grid that hold nothing but
    those (`find_empty_cells`).
    """

    labels: Labels
    words: Words
    size_x: int
    size_y: int
    size_z: int
    channel_of_label: Words
    empty: NDArray[np.bool_]


@parallel_kernel
def find_empty_cells(
    thread: Thread, nodes: Nodes, voxels: Voxels, unwanted: int, out_empty: NDArray[np.bool_]
) -> None:
    """Cells of the grid in whose box of voxels all labels go to the channel `unwanted`.

    The box holds the cell's eight nodes, with room for rounding; `voxels.empty` is not read.
    """
    sizes = (voxels.size_x, voxels.size_y, voxels.size_z)
    for i in share(thread, 0, out_empty.shape[0]):
        low, high = np.empty(3, np.int64), np.empty(3, np.int64)
        for j in range(out_empty.shape[1]):
            for k in range(out_empty.shape[2]):
                known = True
                for axis in range(3):
                    least, most = math.inf, -math.inf
                    for n in range(8):
                        place = nodes[i + n // 4, j + n // 2 % 2, k + n % 2, axis]
                        known = known and not math.isnan(place)
                        least, most = min(least, place), max(most, place)
                    if known:
                        low[axis] = max(math.floor(least - _ROOM), 0)
                        high[axis] = min(math.floor(most + _ROOM), sizes[axis] - 1)
                out_empty[i, j, k] = known and _all_unwanted(low, high, voxels, unwanted)


@enclosed_kernel
def _all_unwanted(
    low: NDArray[np.int64], high: NDArray[np.int64], voxels: Voxels, unwanted: int
) -> bool:
    """Whether all voxels from `low` to `high` (3,) have labels of the channel `unwanted`."""
    for x in range(low[0], high[0] + 1):
        for y in range(low[1], high[1] + 1):
            column = (x * voxels.size_y + y) * voxels.size_z
            z = low[2] if low[2] <= high[2] else -1
            while z >= 0:
                label = voxels.labels[np.uint64(column + z)]
                if voxels.channel_of_label[label] != unwanted:
                    return False
                z = _other(column, z, high[2], label, voxels)
    return True


@parallel_kernel
def trace(
    thread: Thread,
    band_order: NDArray[np.int64],
    band_rows: int,
    beam: Beam,
    nodes: Nodes,
    voxels: Voxels,
    out_length: NDArray[np.float32],
    out_weighted: NDArray[np.float32],
) -> None:
    """Lengths of each channel along the ray to each pixel, plain and times density.

    Rows are handled in bands, column by column, so that neighbouring rays meet the voxels that
    are in the cache; each band writes its own rows.
    """
    channels, rows, columns = out_length.shape
    for turn in share(thread, 0, band_order.size):
        shares, sums = np.zeros((3, channels + 1)), np.zeros((2, channels + 1))
        first = band_order[turn] * band_rows
        for column in range(columns):
            for row in range(first, min(first + band_rows, rows)):
                slope_u = (beam.column_u[column] - beam.spot_u) / beam.planes_to_detector[row]
                slope_v = (beam.row_v[row] - beam.spot_v) / beam.planes_to_detector[row]
                if not _ray(slope_u, slope_v, beam, nodes, voxels, shares, sums):
                    continue
                for channel in range(channels):
                    if sums[0, channel] > 0.0:
                        out_length[channel, row, column] = sums[0, channel]
                        out_weighted[channel, row, column] = sums[1, channel]
                sums[:] = 0.0


@enclosed_kernel
def _ray(
    slope_u: float, slope_v: float, beam: Beam, nodes: Nodes, voxels: Voxels, shares: Floats,
    sums: Floats,
) -> bool:  # fmt: skip
    """Add one ray's lengths to `sums`; tell whether it came near the breast at all.

    On plane k the ray is at u = spot_u + slope_u (spot_k - k), and so for v.
    """
    nu, nv, nk, _ = nodes.shape
    low, high = float(beam.first_plane), min(nk - 1.0, beam.spot_k)
    low, high = _within(beam.spot_u, slope_u, beam.spot_k, nu - 1.0, low, high)
    low, high = _within(beam.spot_v, slope_v, beam.spot_k, nv - 1.0, low, high)
    bottom, top = math.ceil(low), math.floor(high)
    du, dv, dk = beam.spacing[0], beam.spacing[1], beam.spacing[2]
    length = math.sqrt((slope_u * du) ** 2 + (slope_v * dv) ** 2 + dk**2)
    met = False
    before, i_before, j_before = NOWHERE, -1, -1
    for k in range(bottom, top + 1):
        height = beam.spot_k - k
        u, v = beam.spot_u + slope_u * height, beam.spot_v + slope_v * height
        i, j = min(max(int(u), 0), nu - 2), min(max(int(v), 0), nv - 2)
        here = value_on_plane(nodes, u, v, k)
        unknown = math.isnan(here[0]) or math.isnan(before[0])
        in_cell = i == i_before and j == j_before
        if not (unknown or (in_cell and voxels.empty[i, j, k - 1])):
            t_in, t_out = _inside(before[2], here[2], voxels.size_z, 0.0, 1.0)
            t_in, t_out = _inside(before[0], here[0], voxels.size_x, t_in, t_out)
            t_in, t_out = _inside(before[1], here[1], voxels.size_y, t_in, t_out)
            if t_in < t_out:
                _segment(before, here, t_in, t_out, length, voxels, shares, sums)
                met = True
        before, i_before, j_before = here, i, j
    return met


@enclosed_kernel
def _within(
    spot: float, slope: float, spot_k: float, last: float, low: float, high: float
) -> tuple[float, float]:
    """The part of [low, high] in k where 0 <= spot + slope (spot_k - k) <= last."""
    if slope == 0.0:
        return (low, high) if 0.0 <= spot <= last else (0.0, -1.0)
    at_zero = spot_k + spot / slope
    at_last = spot_k + (spot - last) / slope
    return max(low, min(at_zero, at_last)), min(high, max(at_zero, at_last))


@enclosed_kernel
def _segment(
    start: Place, end: Place, t_in: float, t_out: float, length: float, voxels: Voxels,
    shares: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Add a straight segment's lengths, voxel by voxel, to the channels of the voxels' labels.

    `length` is the segment's length in the compressed breast, mm, run over t = 0 to 1; from `t_in`
    to `t_out` it is within the array. Traversal of Amanatides and Woo 1987 (Eurographics), but by
    slabs of voxels across the axis along which the segment is longest.
    """
    x, t_x, delta_x, step_x = _enter(start[0], end[0], voxels.size_x, t_in)
    y, t_y, delta_y, step_y = _enter(start[1], end[1], voxels.size_y, t_in)
    z, t_z, delta_z, step_z = _enter(start[2], end[2], voxels.size_z, t_in)
    first = (x * voxels.size_y + y) * voxels.size_z + z
    along_x = t_x, delta_x, step_x * voxels.size_y * voxels.size_z
    along_y = t_y, delta_y, step_y * voxels.size_z
    along_z = t_z, delta_z, step_z
    weighted = 0.5 * (start[3] + end[3]) * length
    if min(delta_x, delta_y) > STEEP * delta_z:
        _along_columns(
            first - z, (z, start[2], end[2] - start[2]), t_in, t_out, along_x, along_y,
            (length, weighted), voxels, sums,
        )  # fmt: skip
        return
    if delta_z <= delta_x and delta_z <= delta_y:
        across, one, other = along_z, along_x, along_y
    elif delta_y <= delta_x:
        across, one, other = along_y, along_x, along_z
    else:
        across, one, other = along_x, along_y, along_z
    _through_slabs(first, t_in, t_out, across, one, other, voxels, shares)
    _gather(length, weighted, shares, sums)


@enclosed_kernel
def _along_columns(
    column: int, along_z: tuple[int, float, float], t_in: float, t_out: float, along_x: Axis,
    along_y: Axis, lengths: tuple[float, float], voxels: Voxels, sums: Floats,
) -> None:  # fmt: skip
    """Add a steep segment's lengths, one column of voxels along z after the other.

    `column` is the place of the first column in the array, `along_z` the segment's first voxel in
    it, its start and its change. The smaller of `t_x` and `t_y` is where the column is left, until
    when the segment goes from voxel `z` to `z_next`. Voxels of one label in a row are added at
    once. `lengths` are the whole segment's, plain and weighted.
    """
    z, start_z, change_z = along_z
    t_x, delta_x, step_x = along_x
    t_y, delta_y, step_y = along_y
    label = voxels.labels[np.uint64(column + z)]
    since = entered = t_in
    while True:
        side = min(t_x, t_y)
        z_next = int(start_z + min(side, t_out) * change_z)
        other = _other(column, z, z_next, label, voxels)
        while other >= 0:
            t = entered if other == z else (other + (z_next < z) - start_z) / change_z
            _add(label, t - since, lengths, voxels, sums)
            label = voxels.labels[np.uint64(column + other)]
            since = t
            other = _other(column, other, z_next, label, voxels)
        if side >= t_out:
            break
        z, entered = z_next, side
        if t_x < t_y:
            t_x += delta_x
            column += step_x
        else:
            t_y += delta_y
            column += step_y
    _add(label, t_out - since, lengths, voxels, sums)


@enclosed_kernel
def _other(column: int, z: int, z_next: int, label: int, voxels: Voxels) -> int:
    """First voxel of a column, from z to `z_next`, that has another label; -1 if none has.

    Upwards eight voxels are looked at a time: a label's bits against those of a word are 0 where
    the two are alike, and the zero bytes below the first that is not are counted.
    """
    if z_next < z:
        while z >= z_next and voxels.labels[np.uint64(column + z)] == label:
            z -= 1
        return z if z >= z_next else -1
    first, last = column + z, column + z_next
    word, last_word = np.uint64(first >> 3), np.uint64(last >> 3)
    if last_word >= np.uint64(voxels.words.size):
        while z <= z_next and voxels.labels[np.uint64(column + z)] == label:
            z += 1
        return z if z <= z_next else -1
    wanted = np.uint64(label) * _EACH_BYTE
    before = np.uint64((first & 7) << 3)  # bits of the word that lie before the first voxel
    bits = (voxels.words[word] ^ wanted) >> before << before
    while bits == _NO_BIT and word < last_word:
        word += _ONE
        bits = voxels.words[word] ^ wanted
    if bits == _NO_BIT:
        return -1
    below = (bits - _ONE) & ~bits & _HIGHEST_OF_BYTES
    alike = ((below >> np.uint64(7)) * _EACH_BYTE) >> np.uint64(56)  # the sum is the highest byte
    found = int(word << np.uint64(3)) + int(alike)
    return found - column if found <= last else -1


@enclosed_kernel
def _add(
    label: int, part: float, lengths: tuple[float, float], voxels: Voxels, sums: Floats
) -> None:
    """Add a part of a segment, plain and weighted, to the channel of a label."""
    channel = voxels.channel_of_label[label]
    sums[0, channel] += part * lengths[0]
    sums[1, channel] += part * lengths[1]


@enclosed_kernel
def _through_slabs(
    at: int, t_in: float, t_out: float, across: Axis, one: Axis, other: Axis, voxels: Voxels,
    shares: Floats,
) -> None:  # fmt: skip
    """Share a segment among channels, slab by slab; `at` is its first voxel.

    In a slab the segment comes to the next voxel at most once along each of the other axes: it is
    in up to three voxels, and each gets its part, be it 0, without a branch that could go either
    way. Their parts go to three rows of `shares` [3, channel], since a sum must wait for the one
    before it. Nor do the next sides wait to be compared: they are added up beforehand, and chosen.
    """
    t_slab, delta_slab, step_slab = across
    t_one, delta_one, step_one = one
    t_other, delta_other, step_other = other
    labels, channel_of_label = voxels.labels, voxels.channel_of_label
    before = t_in
    while before < t_out:
        t = min(t_slab, t_out)
        first = min(t_one, t_other, t)
        second = min(max(t_one, t_other), t)
        to_one, to_other = step_one * int(t_one < t), step_other * int(t_other < t)
        middle = at + (to_one if t_one < t_other else to_other)
        last = at + to_one + to_other
        shares[0, channel_of_label[labels[np.uint64(at)]]] += first - before
        shares[1, channel_of_label[labels[np.uint64(middle)]]] += second - first
        shares[2, channel_of_label[labels[np.uint64(last)]]] += t - second
        next_one, next_other = t_one + delta_one, t_other + delta_other
        t_one = next_one if t_one < t else t_one
        t_other = next_other if t_other < t else t_other
        t_slab += delta_slab
        at = last + step_slab
        before = t


@enclosed_kernel
def _gather(length: float, weighted: float, shares: Floats, sums: Floats) -> None:
    """Add the channels' shares of a segment to their sums, plain and weighted, and clear them.

    `length` is the whole segment's in the compressed breast, mm.
    """
    for channel in range(shares.shape[1]):
        part = shares[0, channel] + shares[1, channel] + shares[2, channel]
        sums[0, channel] += part * length
        sums[1, channel] += part * weighted
        shares[0, channel] = shares[1, channel] = shares[2, channel] = 0.0


@enclosed_kernel
def _inside(start: float, end: float, size: int, t_in: float, t_out: float) -> tuple[float, float]:
    """The part of [t_in, t_out] where start + t (end - start) lies within the array.

    The array is taken a millionth of a voxel smaller on each side, so that rounding never lets
    the segment step out of it.
    """
    low, high = _SKIN, size - _SKIN
    if low <= start <= high and low <= end <= high:
        return t_in, t_out
    if start == end:
        return 1.0, 0.0
    at_low = (low - start) / (end - start)
    at_high = (high - start) / (end - start)
    return max(t_in, min(at_low, at_high)), min(t_out, max(at_low, at_high))


@enclosed_kernel
def _enter(start: float, end: float, size: int, t_in: float) -> tuple[int, float, float, int]:
    """First voxel along one axis, t at which it is left, t that a voxel takes, and the step."""
    change = end - start
    voxel = min(max(int(start + t_in * change), 0), size - 1)
    if change > 0.0:
        rate = 1.0 / change
        return voxel, (voxel + 1 - start) * rate, rate, 1
    if change < 0.0:
        rate = 1.0 / change
        return voxel, (voxel - start) * rate, -rate, -1
    return voxel, math.inf, math.inf, 0
