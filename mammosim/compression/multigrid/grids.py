"""Sizes of nested lattices, and which part of each row along z is used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid._row_kernels import VECTOR


def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the next level of a multigrid, the layer around it included.

    Parameters
    ----------
    shape : tuple of int
        Nodes along each axis, with one layer of nodes around that do not move.

    Returns
    -------
    tuple of int
        Coarse node J lies on fine node 2 J - 1: every second inner node, and one more beyond.

    Examples
    --------
    >>> coarse_shape((10, 10, 11))
    (7, 7, 7)
    """
    return tuple((n - 2) // 2 + 3 for n in shape)


def whole_rows(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape with room for whole vectors along z between the layers around.

    Parameters
    ----------
    shape : tuple of int
        Nodes along x, y and z, the layer around included.

    Returns
    -------
    tuple of int
        The same but for z: two more than a multiple of `VECTOR`.
    """
    vectors = -(-(shape[2] - 2) // VECTOR)
    return (*shape[:2], vectors * VECTOR + 2)


def row_spans(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Where the true part of each row along z begins and ends.

    Parameters
    ----------
    mask : ndarray of bool, [x, y, z]

    Returns
    -------
    ndarray of int32, [x, y, 2]
        First and one past the last z index at which the mask is true, and whatever lies between; 0
        and 0 where none is.

    Examples
    --------
    >>> row_spans(np.array([[[False, True, False, True]], [[False] * 4]])).tolist()
    [[[1, 4]], [[0, 0]]]
    """
    some, last = mask.any(axis=2), mask.shape[2]
    span = np.zeros((*mask.shape[:2], 2), np.int32)
    span[..., 0] = np.where(some, mask.argmax(axis=2), 0)
    span[..., 1] = np.where(some, last - mask[:, :, ::-1].argmax(axis=2), 0)
    return span
