"""Sums and products of fields of any number of components.

Fields are [x, y, z] or [component, x, y, z]; results are the same to the last bit for any number of
threads.
"""

from __future__ import annotations

import numpy as np

from mammosim.compression.multigrid import _vector_kernels as kernels
from mammosim.compression.multigrid.workspace import Field


def dot(a: Field, b: Field) -> float:
    """Inner product of two fields, summed in double precision."""
    a, b = _rows(a), _rows(b)
    parts = np.empty(a.shape[0])
    kernels.slab_dots(a, b, parts)
    return float(parts.sum())


def largest(a: Field) -> float:
    """Largest absolute value of a field."""
    a = _rows(a)
    parts = np.empty(a.shape[0])
    kernels.slab_largest(a, parts)
    return float(parts.max())


def add_scaled(factor: float | np.float32, a: Field, out: Field) -> None:
    """``out += factor a``."""
    kernels.add_scaled(factor, _rows(a), _rows(out))


def scale_and_add(factor: float | np.float32, a: Field, out: Field) -> None:
    """``out = a + factor out``; what `out` held does not count where the factor is 0."""
    kernels.scale_and_add(factor, _rows(a), _rows(out))


def _rows(field: Field) -> Field:
    return field if field.ndim == 3 else field.reshape(-1, *field.shape[-2:])
