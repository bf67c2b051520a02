"""Means over square blocks of pixels: the coarse grids of scatter, exposure control and mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def block_mean(image: NDArray[np.floating], cell: int) -> NDArray[np.float64]:
    """Mean of each block of `cell` by `cell` pixels; the last of a row or column may be smaller.

    Examples
    --------
    >>> block_mean(np.array([[1.0, 3.0, 5.0]], dtype=np.float32), 2).tolist()
    [[2.0, 5.0]]
    """
    total = block_sum(image, cell)
    rows, columns = (_sizes(n, cell) for n in image.shape)
    return total / (rows[:, None] * columns[None, :])


def block_sum(image: NDArray[np.floating], cell: int) -> NDArray[np.float64]:
    """Sum of each block of `cell` by `cell` pixels."""
    rows, columns = (np.arange(0, n, cell) for n in image.shape)
    across = np.add.reduceat(image, columns, axis=1, dtype=np.float64)
    total: NDArray[np.float64] = np.add.reduceat(across, rows, axis=0)
    return total


def cell_pixels(cell_mm: float, pixel_mm: float) -> int:
    """Pixels along the side of a block of about `cell_mm`, at least one."""
    return max(1, round(cell_mm / pixel_mm))


def _sizes(length: int, cell: int) -> NDArray[np.int64]:
    starts = np.arange(0, length, cell)
    return np.minimum(starts + cell, length) - starts
