"""Continuation of a displacement field from tissue into the air around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression._continuation_kernels import continue_one_layer, extrapolate_one_layer


def continued(
    field: NDArray[np.floating], tissue: NDArray[np.bool_], layers: int, straight: int = 0
) -> NDArray[np.floating]:
    """Copy of a field in which air near tissue moves with the tissue beside it.

    As `continued_with_reach`, which also says how far.
    """
    return continued_with_reach(field, tissue, layers, straight)[0]


def continued_with_reach(
    field: NDArray[np.floating], tissue: NDArray[np.bool_], layers: int, straight: int = 0
) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Copy of a field in which air near tissue moves with the tissue beside it, and where it does.

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
    continued : ndarray, [component, x, y, z]
    reached : ndarray of bool, [x, y, z]
        Tissue, and the air to which it is continued.
    """
    copy = np.where(tissue, field, field.dtype.type(0.0))
    layer = tissue.astype(np.int32)
    for number in range(2, layers + 2):
        if number < straight + 2:
            extrapolate_one_layer(copy, layer, number)
        continue_one_layer(copy, layer, number)
    return copy, layer > 0
