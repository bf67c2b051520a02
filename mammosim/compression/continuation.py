"""Continuation of a displacement field from tissue into the air around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression._continuation_kernels import continue_one_layer, extrapolate_one_layer


def continued(
    field: NDArray[np.floating], tissue: NDArray[np.bool_], layers: int, straight: int = 0
) -> NDArray[np.floating]:
    """Copy of a field in which air near tissue moves with the tissue beside it.

    Parameters
    ----------
    field : ndarray, [component, x, y, z]
    tissue : ndarray of bool, [x, y, z]
        Where the field is known.
    layers : int
        How many layers of nodes into the air; beyond them the copy is 0.
    straight : int
        How many of them go on with the field's slope; the others take the mean of their neighbours.

    Returns
    -------
    ndarray, [component, x, y, z]
    """
    copy = np.where(tissue, field, field.dtype.type(0.0))
    continue_into_air(copy, tissue, layers, straight)
    return copy


def continue_into_air(
    field: NDArray[np.floating], tissue: NDArray[np.bool_], layers: int, straight: int = 0
) -> NDArray[np.int32]:
    """Let air near tissue move with the tissue beside it, in a field that is 0 in air.

    The parameters are those of `continued`; the field itself is changed.

    Returns
    -------
    ndarray of int32, [x, y, z]
        1 in tissue, higher in each layer of air that was reached, 0 beyond.
    """
    layer = tissue.astype(np.int32)
    for number in range(2, layers + 2):
        if number < straight + 2:
            extrapolate_one_layer(field, layer, number)
        continue_one_layer(field, layer, number)
    return layer
