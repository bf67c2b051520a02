"""Connected bodies of tissue: the breast, and specks that are apart from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom._body_kernels import count_runs, find_runs, join_runs


@dataclass(frozen=True, eq=False)
class Bodies:
    """The main body of tissue and what lies apart from it.

    Parameters
    ----------
    specks : int
        Number of bodies besides the largest.
    speck_voxels : int
        Voxels in them.
    second_share : float
        Voxels of the second largest body over those of the main one; 0 without another body.
    tip_index : ndarray, (3,)
        Fractional index of the centre of the main body's most anterior voxels.
    """

    specks: int
    speck_voxels: int
    second_share: float
    tip_index: NDArray[np.float64]


def find_bodies(labels: NDArray[np.uint8]) -> Bodies:
    """Tell the main body of tissue from specks.

    Works on runs of voxels, a few per column, so that 1e8 voxels need megabytes.

    Parameters
    ----------
    labels : ndarray of uint8, [x, y, z]
        0 is air; some tissue must be there. Voxels belong together if they share a face.
    """
    nx, ny, _ = labels.shape
    count = count_runs(labels)
    span, first = np.empty((count, 2), np.int32), np.empty(nx * ny + 1, np.int64)
    find_runs(labels, span, first)
    body = np.empty(count, np.int64)
    join_runs(span, first, nx, ny, body)
    voxels = np.bincount(body, weights=span[:, 1] - span[:, 0] + 1.0, minlength=count)
    main = int(voxels.argmax())
    runs = np.flatnonzero(body == main)
    column = np.searchsorted(first, runs, side="right") - 1
    front = column // ny == column.max() // ny
    lengths = span[runs[front], 1] - span[runs[front], 0] + 1.0
    middles = span[runs[front]].mean(axis=1)
    tip = [
        float(column.max() // ny),
        float(np.average(column[front] % ny, weights=lengths)),
        float(np.average(middles, weights=lengths)),
    ]
    specks = int((voxels > 0).sum()) - 1
    second_share = float(np.delete(voxels, main).max(initial=0.0) / voxels[main])
    return Bodies(specks, int(voxels.sum() - voxels[main]), second_share, np.array(tip))
