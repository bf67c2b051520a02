"""From a file's own values to the labels of the tissue table."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mammosim._wording import counted
from mammosim.errors import InputError
from mammosim.tissues import TISSUES

BLOCK_VOXELS = 1 << 22
"""Voxels counted at a time: a few tens of megabytes beside the phantom."""

TILE_SIDE = 64
"""Voxels along each side of what is translated at a time: axes change their order on the way."""

MAX_VALUES = 255
"""Different values in a file of labels: a picture or a density map holds more."""

MAX_SHOWN = 20
"""Unknown labels that a message lists."""


def translated(
    values: NDArray[Any],
    counts: Mapping[int, int],
    label_map: Mapping[int, str],
    voxel_mm3: float,
    path: Path,
    kept: Collection[int] = (),
    decimals: int = 0,
) -> NDArray[np.uint8]:
    """Labels of the tissue table.

    Parameters
    ----------
    values : ndarray, [x, y, z]
        The file's own; may be a strided view.
    counts : mapping of int to int
        Of `count_values`.
    label_map : mapping of int to str
        Tissue of each value.
    voxel_mm3 : float
        Volume of a voxel, mm3, for messages.
    path : path
        For messages.
    kept : collection of int
        Values that stay what they are: labels of single lesions.
    decimals : int
        Of the file's labels, where they are no whole numbers (see `Volume`).

    Returns
    -------
    ndarray of uint8, [x, y, z]
        z contiguous.

    Raises
    ------
    InputError
        If a value is not in the map; lists all such values with their volume.
    """
    _check_known(counts, label_map, voxel_mm3, path, decimals)
    keys = np.array(sorted(counts))
    labels = np.array(
        [key if key in kept else TISSUES[label_map[int(key)]].label for key in keys], np.uint8
    )
    out = np.empty(values.shape, np.uint8)
    if values.dtype == np.uint8:
        table = np.zeros(256, np.uint8)
        table[keys] = labels
        _translate_bytes(values, table.tobytes(), out)
        return out
    for part in _tiles(values.shape):
        out[part] = labels[np.searchsorted(keys, values[part])]
    return out


def _translate_bytes(values: NDArray[np.uint8], table: bytes, out: NDArray[np.uint8]) -> None:
    """By Python's own table look-up for bytes, several times as fast as an index array."""
    order: Literal["C", "F"] = "C" if abs(values.strides[2]) <= abs(values.strides[0]) else "F"
    for part in _tiles(values.shape):
        tile = values[part]
        found = np.frombuffer(tile.tobytes(order).translate(table), np.uint8)
        out[part] = found.reshape(tile.shape, order=order)


def _tiles(shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
    """Cubes that fill an array; one and its transpose fit into a core's cache together."""
    for corner in product(*(range(0, side, TILE_SIDE) for side in shape)):
        yield tuple(slice(start, start + TILE_SIDE) for start in corner)


def whole_labels(values: NDArray[Any], decimals: int, path: Path) -> NDArray[np.int32]:
    """Labels that are no whole numbers times 10 to the number of their decimals.

    Parameters
    ----------
    values : ndarray, [i, j, k]
    decimals : int
    path : path
        For messages.

    Raises
    ------
    InputError
        If a value has more decimals, or is no label at all.
    """
    whole = np.empty(values.shape, np.int32)
    for layer, plane in zip(whole, values, strict=True):
        scaled = plane.astype(np.float64) * 10**decimals
        rounded = np.rint(scaled)
        # Not (> tolerance), so that NaN is refused too; 32-bit floats miss 3.3 by 5e-8.
        with np.errstate(invalid="ignore"):  # infinity less itself
            odd = ~((np.abs(scaled - rounded) < 1e-3) & (np.abs(rounded) < 2**31))
        if odd.any():
            raise InputError(
                f"{path}: holds the value {plane[odd][0]:g}, expected labels of at most {decimals} "
                f"decimal{'s' if decimals > 1 else ''}, as the label map has"
            )
        layer[...] = rounded
    return whole


def count_values(values: NDArray[Any], path: Path) -> dict[int, int]:
    """How often each value occurs.

    Raises
    ------
    InputError
        If there is no voxel, a value is not a whole number, or there are too many different ones.
    """
    if values.dtype.kind not in "iufb":
        raise InputError(f"{path}: holds {values.dtype} voxels, expected whole numbers")
    if values.size == 0:
        raise InputError(f"{path}: its shape is {values.shape}, expected at least one voxel")
    counts: dict[int, int] = {}
    for part in _blocks(values):
        each, how_many = _counted(values[part])
        odd = each[~(np.isfinite(each) & (each == np.rint(each)))]
        if len(odd):
            raise InputError(f"{path}: holds the value {odd[0]}, expected whole-number labels")
        for value, number in zip(each, how_many, strict=True):
            counts[int(value)] = counts.get(int(value), 0) + int(number)
        if len(counts) > MAX_VALUES:
            raise InputError(
                f"{path}: holds over {MAX_VALUES} different values, expected tissue labels"
            )
    return counts


def _blocks(values: NDArray[Any]) -> Iterator[tuple[slice, ...]]:
    """Slices through the slowest axis of an array, each of some million voxels."""
    axis = int(np.argmax(np.abs(values.strides)))
    layers = max(1, BLOCK_VOXELS * values.shape[axis] // max(values.size, 1))
    for start in range(0, values.shape[axis], layers):
        part = [slice(None)] * 3
        part[axis] = slice(start, start + layers)
        yield tuple(part)


def _counted(block: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Different values of a block, and how often each occurs."""
    if block.dtype.kind in "iu" and block.dtype.itemsize <= 2:
        lowest = int(block.min())
        how_many = np.bincount(block.ravel(order="K").astype(np.int64) - lowest)
        each = np.flatnonzero(how_many)
        return each + lowest, how_many[each]
    return np.unique(block.astype(np.uint8) if block.dtype.kind == "b" else block,
                     return_counts=True)  # fmt: skip


def _check_known(
    counts: Mapping[int, int],
    label_map: Mapping[int, str],
    voxel_mm3: float,
    path: Path,
    decimals: int = 0,
) -> None:
    unknown = [value for value in sorted(counts) if value not in label_map]
    if not unknown:
        return
    known = ", ".join(f"{_shown(label, decimals)} {name}" for label, name in label_map.items())
    shown = [
        f"{path}: label {_shown(value, decimals)} ({counts[value] * voxel_mm3 / 1000:.3g} mL) is "
        "not in the label map"
        for value in unknown[:MAX_SHOWN]
    ]
    if len(unknown) > MAX_SHOWN:
        more = len(unknown) - MAX_SHOWN
        shown.append(f"{path}: and {counted(more, 'more label')} not in the label map")
    raise InputError([*shown, f"{path}: known labels: {known}"])


def _shown(value: int, decimals: int) -> str:
    """A label as the file has it."""
    return f"{value / 10**decimals:g}" if decimals else str(value)
