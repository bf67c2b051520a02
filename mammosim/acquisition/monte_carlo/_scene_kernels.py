"""Compiled loop that numbers the mixtures of a coarse breast and packs its voxels into words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel
from mammosim.acquisition.monte_carlo._detection_kernels import Turn
from mammosim.acquisition.monte_carlo._flight_kernels import DENSITY_STEPS, MIXTURE_BITS

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads keys over the table
_OUTSIDE = np.uint64(1 << 60)
_EMPTY = np.uint64(0xFFFFFFFFFFFFFFFF)


class Field(NamedTuple):
    """Grid of the breast (lowest corner and spacing); focal spot, detector and the field's bounds
    in the detector's frame, to which `turn` leads. All in mm.
    """

    origin: NDArray[np.float64]
    spacing: NDArray[np.float64]
    spot: NDArray[np.float64]
    detector_z: float
    bounds: NDArray[np.float64]
    turn: Turn


@kernel
def pack_voxels(
    shares: NDArray[np.uint64],
    density: NDArray[np.float32],
    field: Field,
    first: int,
    table: NDArray[np.uint64],
    numbers: NDArray[np.int64],
    out_keys: NDArray[np.uint64],
    out_words: NDArray[np.uint32],
) -> int:
    """Number the mixtures that occur, from `first` on, and write the words; how many there are.

    A mixture's key is a voxel's shares, with bit 60 set where the beam does not go. `table` (a
    power of two long, filled with ones) and `numbers` are a hash table; `out_keys` gets the key of
    each number. When it is full, -1 is returned.
    """
    nx, ny, nz = shares.shape
    found = 0
    mask = np.uint64(table.size - 1)
    turn = field.turn
    for i in range(nx):
        x = field.origin[0] + (i + 0.5) * field.spacing[0]
        for j in range(ny):
            y = field.origin[1] + (j + 0.5) * field.spacing[1]
            for k in range(nz):
                key = shares[i, j, k]
                if key == 0:
                    out_words[i, j, k] = np.uint32(DENSITY_STEPS) << MIXTURE_BITS
                    continue
                z = field.origin[2] + (k + 0.5) * field.spacing[2]
                across = turn.cosine * y - turn.sine * z + turn.y_mm
                above = turn.sine * y + turn.cosine * z + turn.z_mm
                far = (field.spot[2] - field.detector_z) / (field.spot[2] - above)
                u = field.spot[0] + (x - field.spot[0]) * far
                v = field.spot[1] + (across - field.spot[1]) * far
                inside = field.bounds[0] <= u <= field.bounds[1]
                if not (inside and field.bounds[2] <= v <= field.bounds[3]):
                    key |= _OUTSIDE
                at = (key * _GOLDEN) >> np.uint64(40) & mask
                while table[at] != key and table[at] != _EMPTY:
                    at = (at + np.uint64(1)) & mask
                if table[at] == _EMPTY:
                    if found == out_keys.size:
                        return -1
                    table[at] = key
                    numbers[at] = first + found
                    out_keys[found] = key
                    found += 1
                steps = np.uint32(density[i, j, k] * DENSITY_STEPS + 0.5)
                out_words[i, j, k] = np.uint32(numbers[at]) | (steps << MIXTURE_BITS)
    return found
