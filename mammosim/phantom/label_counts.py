"""How many voxels of each label a breast's layers hold, counted once per breast."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mammosim.phantom._count_kernels import count_labels
from mammosim.phantom.breast import BreastPhantom

_counted: WeakKeyDictionary[BreastPhantom, NDArray[np.int64]] = WeakKeyDictionary()


def label_counts(breast: BreastPhantom) -> NDArray[np.int64]:
    """Number of voxels of each label in each layer of constant x, [x, 256].

    Parameters
    ----------
    breast : BreastPhantom
        Its labels do not change any more: volume, extent, materials and lesions of one breast are
        asked for many times, and it is counted the first time.
    """
    counts = _counted.get(breast)
    if counts is None:
        counts = np.zeros((breast.labels.shape[0], 256), np.int64)
        if breast.labels.size:
            count_labels(breast.labels, counts)
        _counted[breast] = counts
    return counts
