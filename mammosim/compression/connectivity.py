"""Which tissue hangs together with what is held."""

from __future__ import annotations

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray


def held_together(tissue: NDArray[np.bool_], fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tissue that is connected, through 26-neighbours, to a fixed node."""
    parts, _ = scipy.ndimage.label(tissue, np.ones((3, 3, 3), bool))
    held = np.zeros(parts.max() + 1, bool)
    held[np.unique(parts[fixed & tissue])] = True
    held[0] = False
    connected: NDArray[np.bool_] = held[parts]
    return connected
