"""The breast's surface: skin without a staircase, nipple, areola, and the cut of the open end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import borrowing_kernel, merged_kernel
from mammosim.phantom.anatomy._block_kernels import SKIN_DEPTH, Paint
from mammosim.phantom.anatomy._noise_kernels import MOST_NOISE, gradient_noise

FLARE_MM, FLARE_HEIGHT_MM = 2.2, 1.0
"""How much wider a nipple is at its foot, where it merges into the areola, and the height over
which that is lost, mm. Chosen by eye."""

FRAY = 0.35
"""How unevenly the nipple's root ends, in its radii. Chosen by eye."""

LUMPS_KEY, FRAY_KEY = np.intp(17), np.intp(18)
"""Of the noise of both."""


@merged_kernel
def _face(corner: NDArray[np.float64], a: int, b: int, c: int, d: int) -> float:
    """Sum over four corners of a block, one of its faces."""
    return corner[a] + corner[b] + corner[c] + corner[d]


@merged_kernel
def even_shift(first: int, second: int) -> float:
    """Shift from -0.5 to 0.5 of a column of voxels: a sequence of low discrepancy (the golden ratio
    in two dimensions), so that the mean over any few columns is close to 0."""
    turn = 0.7548776662466927 * first + 0.5698402909980532 * second
    return turn - np.floor(turn) - 0.5


@borrowing_kernel
def dither(i: int, j: int, k: int, corners: NDArray[np.float64]) -> float:
    """Shift of a surface at a voxel, in voxels along its normal, that hides the staircase.

    The surface's normal is the gradient over the coarse cell's corners. Along the axis nearest to
    it all voxels of a column are shifted alike, so that layers keep their thickness and stay
    whole; from column to column shifts are spread evenly, so that the mean of any few columns is
    the surface's true place. Half a voxel along that axis is the most.
    """
    c = corners[SKIN_DEPTH]
    gx = _face(c, 4, 5, 6, 7) - _face(c, 0, 1, 2, 3)
    gy = _face(c, 2, 3, 6, 7) - _face(c, 0, 1, 4, 5)
    gz = _face(c, 1, 3, 5, 7) - _face(c, 0, 2, 4, 6)
    ax, ay, az = abs(gx), abs(gy), abs(gz)
    if ax >= ay and ax >= az:
        most, first, second, sign = ax, j, k, gx
    elif ay >= az:
        most, first, second, sign = ay, i, k, gy
    else:
        most, first, second, sign = az, i, j, gz
    shift = even_shift(first, second) * most / np.sqrt(gx * gx + gy * gy + gz * gz + 1e-12)
    return shift if sign > 0.0 else -shift


@merged_kernel
def beyond_cut(paint: Paint, y: float, z: float) -> bool:
    return y * paint.cut[0] + z * paint.cut[1] > paint.cut[2]


@borrowing_kernel
def in_nipple(
    x: float, y: float, z: float, depth: float, thick: float, nipple: NDArray[np.float64]
) -> bool:
    """Whether a point lies in the nipple: an irregular, blunt and tilted cone on the areola.

    `nipple` is foot x, height, radius at the foot, part of the radius lost at the tip, tilt
    (lateral and superior, mm a mm of height), exponent of the dome, amplitude of lumps (mm), their
    place in the noise, and depth of the root (mm). It stands on the skin's surface, wherever that
    is, and goes as deep as the skin; below is its root.
    """
    height = max(nipple[1], 0.2)
    above = max(x - nipple[0], -depth)
    rise = min(max(above, 0.0), height)
    across = y - nipple[4] * rise
    up = z - nipple[5] * rise
    widest = nipple[2] + MOST_NOISE * abs(nipple[7]) + FLARE_MM
    if across * across + up * up > widest * widest:
        return False
    lumps = nipple[7] * gradient_noise(x / 6.0, y / 6.0, z / 6.0 + nipple[8], LUMPS_KEY)
    wide = nipple[2] * (1.0 - nipple[3] * rise / height) + lumps
    if depth > 0.0:
        return depth < thick and across * across + up * up < wide * wide
    if above > height:
        return False
    wide = wide * np.sqrt(1.0 - (rise / height) ** nipple[6]) + FLARE_MM * np.exp(
        -above / FLARE_HEIGHT_MM
    )
    return wide > 0.0 and across * across + up * up < wide * wide


@borrowing_kernel
def in_root(x: float, y: float, z: float, below: float, nipple: NDArray[np.float64]) -> bool:
    """Whether a point below the skin lies in the nipple's root, which frays as it narrows."""
    root = nipple[9]
    squared = y * y + z * z
    if below >= root or squared > 4.0 * nipple[2] * nipple[2]:
        return False
    part = below / root
    frayed = FRAY * gradient_noise(x / 5.0, y / 2.5, z / 2.5 + nipple[8], FRAY_KEY)
    wide = nipple[2] * (np.sqrt(1.0 - part) + part * frayed)
    return wide > 0.0 and squared < wide * wide


@merged_kernel
def areola(paint: Paint, y: float, z: float) -> float:
    """Extra thickness of the skin at the areola, mm."""
    near = (y * y + z * z) / (paint.areola_mm[1] * paint.areola_mm[1])
    return paint.areola_mm[0] * np.exp(-near)
