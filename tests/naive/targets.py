"""Slow twins of the targets' kernels."""

from __future__ import annotations

import numpy as np


def nearest_air_mm(labels, first_x, index, spacing_mm):
    """Distance to the nearest cube of air among all voxels, and to the array's faces, mm.

    What lies before plane `first_x` does not count.
    """
    padded = np.pad(labels, [(0, 1), (1, 1), (1, 1)])
    air = np.argwhere(padded == 0) - [0, 1, 1]
    air = air[air[:, 0] >= first_x]
    gap = np.maximum(np.abs(air - index) - 0.5, 0.0) * spacing_mm
    return np.sqrt((gap**2).sum(axis=1).min())


def outwards(at, turns, spacing_mm):
    """The voxels nearest to a fractional index, each with its squared distance, mm2."""
    around = np.arange(int(np.floor(at)) - turns, int(np.ceil(at)) + turns + 1)
    gaps = (np.maximum(np.abs(around - at) - 0.5, 0.0) * spacing_mm) ** 2
    # Of two that are equally near, the one that holds the index: its centre is half a voxel below.
    order = np.lexsort((-around, gaps))[:turns]
    return [(int(around[n]), float(gaps[n])) for n in order]
