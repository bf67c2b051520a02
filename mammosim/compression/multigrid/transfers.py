"""Transfer of a field between a lattice and the one of half its resolution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.compression.multigrid import _transfer_kernels as kernels

Field = NDArray[np.floating]


def restrict(fine: Field, out: Field) -> None:
    """Transpose of the trilinear interpolation: residual to coarse load.

    Parameters
    ----------
    fine, out : ndarray, [x, y, z] or [component, x, y, z]
        `out` has the next level's shape.
    """
    for source, target in zip(_components(fine), _components(out), strict=True):
        kernels.restrict(source, target)


def add_interpolated(coarse: Field, span: NDArray[np.int32], free: Field, fine: Field) -> None:
    """``fine += free * P coarse``, P being the trilinear interpolation.

    Parameters
    ----------
    coarse, fine : ndarray, [x, y, z] or [component, x, y, z]
    span : ndarray of int32, [x, y, 2]
        Rows of `fine` that are visited.
    free : ndarray, the shape of `fine`
    """
    parts = (_components(coarse), _components(free), _components(fine))
    for source, mask, target in zip(*parts, strict=True):
        kernels.add_interpolated(source, span, mask, target)


def _components(field: Field) -> tuple[Field, ...]:
    return (field,) if field.ndim == 3 else tuple(field)
