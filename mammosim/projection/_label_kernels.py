"""Compiled search for the labels that occur, plane by plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, parallel_kernel, share

Labels = NDArray[np.uint8]
Words = NDArray[np.uint64]

LABELS_PER_WORD = 8
"""Labels that are looked at together, as one 64-bit word of a little-endian machine."""

_BYTE, _LOWEST_BYTE = np.uint64(8), np.uint64(0xFF)


@parallel_kernel
def planes_of_labels(thread: Thread, labels: Labels, out_present: NDArray[np.bool_]) -> None:
    """Mark in `out_present` [x, 256] which labels occur in each x plane."""
    nx, ny, nz = labels.shape
    for x in share(thread, 0, nx):
        last = -1
        for y in range(ny):
            for z in range(nz):
                label = int(labels[x, y, z])
                if label != last:
                    out_present[x, label] = True
                    last = label


@parallel_kernel
def planes_of_words(thread: Thread, words: Words, out_present: NDArray[np.bool_]) -> None:
    """The same for planes [x, word]; a word like the one before it is passed over."""
    for x in share(thread, 0, words.shape[0]):
        last = ~words[x, 0]
        for at in range(words.shape[1]):
            word = words[x, at]
            if word != last:
                last = word
                for _ in range(LABELS_PER_WORD):
                    out_present[x, word & _LOWEST_BYTE] = True
                    word >>= _BYTE
