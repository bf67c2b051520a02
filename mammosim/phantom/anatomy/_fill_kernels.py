"""From the part of a voxel that ligament fills to its label, and back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel, merged_kernel
from mammosim.phantom.anatomy._block_kernels import ADIPOSE, EIGHTH, HALF, LIGAMENT, QUARTER


@kernel
def fill_step(fill: float, lot: float) -> int:
    """Place in `Paint.labels` of a filling: the step below or above, so that its mean is right."""
    if fill < 0.125:
        return EIGHTH if lot < fill / 0.125 else ADIPOSE
    if fill < 0.25:
        return QUARTER if lot < (fill - 0.125) / 0.125 else EIGHTH
    if fill < 0.5:
        return HALF if lot < (fill - 0.25) / 0.25 else QUARTER
    return LIGAMENT if lot < (fill - 0.5) / 0.5 else HALF


@merged_kernel
def fill_of(label: int, name: NDArray[np.uint8]) -> float:
    """Part of a voxel that is ligament by its label; 0 for any other tissue."""
    fill = 0.0
    if label == name[EIGHTH]:
        fill = 0.125
    elif label == name[QUARTER]:
        fill = 0.25
    elif label == name[HALF]:
        fill = 0.5
    elif label == name[LIGAMENT]:
        fill = 1.0
    return fill
