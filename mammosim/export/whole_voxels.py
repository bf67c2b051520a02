"""Voxels of one tissue each, for programs that know no mixtures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.tissues import TISSUES

GOLDEN = 0.6180339887498949
"""Step of a sequence of low discrepancy: any few voxels in a row keep their mean."""


def to_whole_voxels(labels: NDArray[np.uint8]) -> None:
    """Replace mixtures by their tissues, voxel by voxel, so that each keeps its volume; in place.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        Labels of the tissue table.

    Notes
    -----
    The n-th voxel of a mixture in each x layer takes the tissue in whose share the fraction of
    n (sqrt(5) - 1) / 2 + a layer's own start lies. The result does not depend on anything else.
    """
    mixtures = [tissue for tissue in TISSUES.values() if tissue.mixture]
    for layer, plane in enumerate(labels):
        for tissue in mixtures:
            rows = np.nonzero(plane == tissue.label)
            if rows[0].size == 0:
                continue
            lot = (GOLDEN * np.arange(rows[0].size) + 0.7548776662466927 * layer) % 1.0
            ends = np.cumsum(list(tissue.mixture.values()))
            whole = np.array([TISSUES[name].label for name in tissue.mixture], np.uint8)
            at = np.minimum(np.searchsorted(ends, lot, side="right"), whole.size - 1)
            plane[rows] = whole[at]
