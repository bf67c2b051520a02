"""Compiled loops that fold the labels of a compressed breast into shares of coarse voxels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, parallel_kernel, share
from mammosim.projection._grid_kernels import Floats, Labels, Nodes, Words, value_on_plane

_BITS, _NO_SHARE = np.uint64(4), np.uint64(0)
_ONE = np.uint64(1)

# Steps of the additive recurrence that decides which samples of a partly filled lesion are lesion:
# powers of 1 / 1.2207440846, the root of x^4 = x + 1 (Roberts 2018, "The unreasonable
# effectiveness of quasirandom sequences"), so that any block of samples holds nearly the fraction.
_STEP_X, _STEP_Y, _STEP_Z = 0.8191725134, 0.6710436067, 0.5497004779


class SampledAs(NamedTuple):
    """What each of the 256 labels counts as.

    `material` is the place of its material in the shares, -1 for air; where only the fraction
    `fill` of a label's volume is its material, the rest is `host`.
    """

    material: NDArray[np.int64]
    host: NDArray[np.int64]
    fill: Floats


@parallel_kernel
def fold_labels(thread: Thread, labels: Labels, sampled: SampledAs, out_shares: Words) -> None:
    """Count the materials of each block of 2 x 2 x 2 labels.

    `out_shares` [x, y, z] gets four bits a material: how many of the eight are of it.
    """
    nx, ny, nz = out_shares.shape
    for x in share(thread, 0, nx):
        for y in range(ny):
            for z in range(nz):
                shares = _NO_SHARE
                for sample in range(8):
                    a, b, c = 2 * x + sample // 4, 2 * y + sample // 2 % 2, 2 * z + sample % 2
                    label = labels[a, b, c]
                    material = sampled.material[label]
                    if sampled.fill[label] < 1.0:
                        place = a * _STEP_X + b * _STEP_Y + c * _STEP_Z
                        if place - np.floor(place) >= sampled.fill[label]:
                            material = sampled.host[label]
                    if material >= 0:
                        shares += _ONE << (_BITS * np.uint64(material))
                out_shares[x, y, z] = shares


@parallel_kernel
def carry_density(
    thread: Thread,
    axis_u: Floats,
    axis_v: Floats,
    axis_k: Floats,
    nodes: Nodes,
    out_density: NDArray[np.float32],
) -> None:
    """Density against that before compression at each point of a grid; 1 where nothing lies.

    The axes are the points' coordinates as fractional nodes, none outside the grid.
    """
    nk = nodes.shape[2]
    for a in share(thread, 0, axis_u.size):
        line = np.empty(nk)
        for b in range(axis_v.size):
            for k in range(nk):
                line[k] = value_on_plane(nodes, axis_u[a], axis_v[b], k)[3]
            for c in range(axis_k.size):
                k = min(int(axis_k[c]), nk - 2)
                part = axis_k[c] - k
                density = (1.0 - part) * line[k] + part * line[k + 1]
                out_density[a, b, c] = 1.0 if np.isnan(density) else density
