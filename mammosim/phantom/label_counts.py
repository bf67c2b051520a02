"""How many voxels of each label a breast's layers hold, counted once per breast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._derived import Derived
from mammosim.phantom._count_kernels import count_labels
from mammosim.phantom.breast import BreastPhantom

_counted: Derived[BreastPhantom, NDArray[np.int64]] = Derived()


def label_counts(breast: BreastPhantom) -> NDArray[np.int64]:
    """Number of voxels of each label in each layer of constant x, [x, 256].

    Parameters
    ----------
    breast : BreastPhantom
        Its labels do not change any more: volume, extent, materials and lesions of one breast are
        asked for many times, and it is counted the first time.
    """
    return _counted.of(breast, lambda: _count(breast.labels))


def _count(labels: NDArray[np.uint8]) -> NDArray[np.int64]:
    counts = np.zeros((labels.shape[0], 256), np.int64)
    if labels.size:
        count_labels(labels, counts)
    return counts
