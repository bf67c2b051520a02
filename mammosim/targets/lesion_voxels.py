"""The voxels of each lesion, and which lesions touch."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from mammosim.phantom import BreastPhantom, label_counts


def lesion_voxels(phantom: BreastPhantom) -> dict[int, NDArray[np.intp]]:
    """Indices (n, 3) of each lesion's voxels, by the lesion's label; n may be 0."""
    if not phantom.lesions:
        return {}
    counts = label_counts(phantom)
    found = {}
    for lesion in phantom.lesions:
        x = np.flatnonzero(counts[:, lesion.label])
        index = np.empty((0, 3), np.intp)
        if x.size:
            index = np.argwhere(phantom.labels[x[0] : x[-1] + 1] == lesion.label)
            index[:, 0] += x[0]
        found[lesion.label] = index
    return found


def touching_lesions(phantom: BreastPhantom) -> tuple[str, ...]:
    """One sentence for each pair of lesions that touch: voxels share a face, an edge or a corner.

    Parameters
    ----------
    phantom : BreastPhantom

    Returns
    -------
    tuple of str

    Notes
    -----
    They keep a label, a mask and a row of the table each; what a reader of the picture would take
    for one lesion, the table has as two.
    """
    voxels = lesion_voxels(phantom)
    trees = {label: KDTree(index) for label, index in voxels.items() if len(index)}
    here = [lesion for lesion in phantom.lesions if lesion.label in trees]
    notes = []
    for one, other in combinations(here, 2):
        pair = (trees[one.label], trees[other.label])
        apart = np.maximum(pair[0].mins - pair[1].maxes, pair[1].mins - pair[0].maxes).max()
        # Boxes that are more than a voxel apart need no search.
        if apart <= 1.0 and pair[0].count_neighbors(pair[1], 1.0, p=np.inf):
            notes.append(
                f"lesions '{one.name}' and '{other.name}' touch: each has its own row, but the "
                f"image may show them as one"
            )
    return tuple(notes)
