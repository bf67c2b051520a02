"""Sizes of nested lattices, and which part of each row along z is used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid._row_kernels import VECTOR


def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the next level, layer around included: coarse node J lies on fine node 2 J - 1."""
    return tuple((n - 2) // 2 + 3 for n in shape)


def whole_rows(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape with room for whole vectors along z between the layers around."""
    vectors = -(-(shape[2] - 2) // VECTOR)
    return (*shape[:2], vectors * VECTOR + 2)


def row_spans(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """First and one past the last z index at which a mask is true, [x, y, 2]; 0 where none is."""
    some, last = mask.any(axis=2), mask.shape[2]
    span = np.zeros((*mask.shape[:2], 2), np.int32)
    span[..., 0] = np.where(some, mask.argmax(axis=2), 0)
    span[..., 1] = np.where(some, last - mask[:, :, ::-1].argmax(axis=2), 0)
    return span
