"""Kernels of the generator: the tissue of each voxel from coarse fields and fine structure."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, parallel_kernel, share
from mammosim.phantom.anatomy._noise_kernels import gradient_noise, lobules

SKIN_DEPTH, MUSCLE_DEPTH, POTENTIAL, WARP, SEPTUM = (np.intp(n) for n in (0, 1, 2, 3, 6))
"""Channels of the coarse fields; WARP takes three."""

CHANNELS = 7

NOT_COUNTED, FAT_OR_GLAND, WALL_OR_GLAND, TUBE, FAT = 0, 1, 2, 3, 4
"""What a sampled voxel is whatever the threshold; air, skin, nipple and muscle are not counted."""

NOISE_BOUND = 5.0
"""No octave of gradient noise is expected to count for more: of ten million values the largest was
4.6 standard deviations."""


class Lattice(NamedTuple):
    """Where voxels and coarse grid lie, in generator coordinates (x, lateral, superior), mm."""

    x_mm: NDArray[np.float64]
    lateral_mm: NDArray[np.float64]
    superior_mm: NDArray[np.float64]
    coarse_origin_mm: NDArray[np.float64]
    coarse_mm: float


class Texture(NamedTuple):
    """Everything that decides the fine structure.

    `fields` is (x, lateral, superior, channel); `seeds` is (nx, ny, nz, 4), a point of each
    lobule cell in cells and its strength; amplitudes are in units of the potential.
    """

    fields: NDArray[np.float32]
    seeds: NDArray[np.float32]
    seed_origin_mm: NDArray[np.float64]
    cell_mm: float
    apex_mm: NDArray[np.float64]
    fan_amplitude: NDArray[np.float64]
    fan_per_radian: NDArray[np.float64]
    grain_amplitude: NDArray[np.float64]
    grain_mm: NDArray[np.float64]
    lobule_amplitude: float
    key: int


class Paint(NamedTuple):
    """Labels and lengths that the last step needs.

    `nipple_mm` is foot x, height, radius; `areola_mm` is extra thickness of the skin at the
    nipple and the radius over which it is lost; `cut` is the direction out of the open end and its
    distance from the nipple's axis; `fibre_noise` is noise above which muscle is fat.
    """

    skin_mm: float
    nipple_mm: NDArray[np.float64]
    areola_mm: NDArray[np.float64]
    cut: NDArray[np.float64]
    cover_mm: float
    fibre_noise: float
    threshold: float
    labels: NDArray[np.uint8]


ADIPOSE, SKIN, GLAND, NIPPLE, MUSCLE, LIGAMENT = 0, 1, 2, 3, 4, 5
"""Places in `Paint.labels`."""


@kernel
def _corners(
    fields: NDArray[np.float32], i: int, j: int, k: int, channel: int, out: NDArray[np.float64]
) -> None:
    """A channel at the eight corners of a coarse cell, the last axis fastest."""
    for a in range(2):
        for b in range(2):
            out[4 * a + 2 * b] = fields[i + a, j + b, k, channel]
            out[4 * a + 2 * b + 1] = fields[i + a, j + b, k + 1, channel]


@kernel
def _trilinear(corner: NDArray[np.float64], u: float, v: float, w: float) -> float:
    low = (1.0 - v) * ((1.0 - w) * corner[0] + w * corner[1]) + v * (
        (1.0 - w) * corner[2] + w * corner[3]
    )
    high = (1.0 - v) * ((1.0 - w) * corner[4] + w * corner[5]) + v * (
        (1.0 - w) * corner[6] + w * corner[7]
    )
    return (1.0 - u) * low + u * high


@kernel
def _interpolate(
    fields: NDArray[np.float32], u: float, v: float, w: float, channel: int,
    corner: NDArray[np.float64],
) -> float:  # fmt: skip
    """Trilinear value of a channel at fractional coarse indices that lie inside."""
    i, j, k = int(u), int(v), int(w)
    _corners(fields, i, j, k, channel, corner)
    return _trilinear(corner, u - i, v - j, w - k)


@kernel
def dither(i: int, j: int, k: int, corner: NDArray[np.float64]) -> float:
    """Shift of a surface at a voxel, in voxels along its normal, that hides the staircase.

    The surface's normal is the gradient over the coarse cell's corners. Along the axis nearest to
    it all voxels of a column are shifted alike, so that layers keep their thickness and stay
    whole; from column to column the shift follows a sequence of low discrepancy (the golden ratio
    in two dimensions), so that the mean of any few columns is the surface's true place. Half a
    voxel along that axis is the most.
    """
    gx = corner[4] + corner[5] + corner[6] + corner[7]
    gx -= corner[0] + corner[1] + corner[2] + corner[3]
    gy = corner[2] + corner[3] + corner[6] + corner[7]
    gy -= corner[0] + corner[1] + corner[4] + corner[5]
    gz = corner[1] + corner[3] + corner[5] + corner[7]
    gz -= corner[0] + corner[2] + corner[4] + corner[6]
    ax, ay, az = abs(gx), abs(gy), abs(gz)
    if ax >= ay and ax >= az:
        most, first, second, sign = ax, j, k, gx
    elif ay >= az:
        most, first, second, sign = ay, i, k, gy
    else:
        most, first, second, sign = az, i, j, gz
    turn = 0.7548776662466927 * first + 0.5698402909980532 * second
    shift = (turn - np.floor(turn) - 0.5) * most / np.sqrt(gx * gx + gy * gy + gz * gz + 1e-12)
    return shift if sign > 0.0 else -shift


@kernel
def _fine(texture: Texture, x: float, y: float, z: float, start: float, threshold: float) -> float:
    """Potential with strands and grain; exact only near the threshold, else on its right side."""
    total, rest = start, 0.0
    for octave in range(texture.fan_amplitude.size):
        rest += NOISE_BOUND * texture.fan_amplitude[octave]
    for octave in range(texture.grain_amplitude.size):
        rest += NOISE_BOUND * texture.grain_amplitude[octave]
    if abs(total - threshold) > rest:
        return total
    dx, dy, dz = texture.apex_mm[0] - x, y - texture.apex_mm[1], z - texture.apex_mm[2]
    r = np.sqrt(dx * dx + dy * dy + dz * dz) + 1.0
    along = np.log(r) / 5.0
    for octave in range(texture.fan_amplitude.size):
        # Strands run towards the nipple: noise in direction and, five times slower, distance.
        per = texture.fan_per_radian[octave]
        total += texture.fan_amplitude[octave] * gradient_noise(
            along * per, dy / r * per, dz / r * per, texture.key + octave
        )
        rest -= NOISE_BOUND * texture.fan_amplitude[octave]
        if abs(total - threshold) > rest:
            return total
    for octave in range(texture.grain_amplitude.size):
        s = 1.0 / texture.grain_mm[octave]
        total += texture.grain_amplitude[octave] * gradient_noise(
            x * s, y * s, z * s, texture.key + 64 + octave
        )
        rest -= NOISE_BOUND * texture.grain_amplitude[octave]
        if abs(total - threshold) > rest:
            return total
    return total


@kernel
def _potential(
    texture: Texture, x: float, y: float, z: float, u: float, v: float, w: float,
    threshold: float, corner: NDArray[np.float64],
) -> tuple[float, float]:  # fmt: skip
    """Potential of glandular tissue at a point, and its distance to a lobule's wall, mm.

    x, y, z are in mm and u, v, w the same place in coarse cells. A threshold of NaN asks for the
    full potential.
    """
    x += _interpolate(texture.fields, u, v, w, WARP, corner)
    y += _interpolate(texture.fields, u, v, w, WARP + 1, corner)
    z += _interpolate(texture.fields, u, v, w, WARP + 2, corner)
    pull, wall = lobules(texture.seeds, texture.seed_origin_mm, texture.cell_mm, x, y, z)
    start = _interpolate(texture.fields, u, v, w, POTENTIAL, corner)
    return _fine(texture, x, y, z, start - texture.lobule_amplitude * pull, threshold), wall


@kernel
def nipple_distance(x: float, y: float, z: float, nipple_mm: NDArray[np.float64]) -> float:
    """Distance to the surface of a cylinder with a domed end on the x axis, negative inside.

    `nipple_mm` is foot x, height, radius; the cylinder reaches 3 mm into the areola.
    """
    foot, height, radius = nipple_mm[0], nipple_mm[1], nipple_mm[2]
    rounding = 0.85 * radius
    low, high = foot - 3.0, foot + height
    across = np.sqrt(y * y + z * z) - (radius - rounding)
    along = max(low - x, x - (high - rounding))
    outside = np.sqrt(max(across, 0.0) ** 2 + max(along, 0.0) ** 2)
    return outside + min(max(across, along), 0.0) - rounding


@kernel
def _skin_mm(paint: Paint, y: float, z: float) -> float:
    """Thickness of the skin: more at the areola than elsewhere, mm."""
    near = (y * y + z * z) / (paint.areola_mm[1] * paint.areola_mm[1])
    return paint.skin_mm + paint.areola_mm[0] * np.exp(-near * near)


@kernel
def _beyond_cut(paint: Paint, y: float, z: float) -> bool:
    return y * paint.cut[0] + z * paint.cut[1] > paint.cut[2]


@parallel_kernel
def sample_potential(
    thread: Thread, labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint,
    stride: int, out_potential: NDArray[np.float32], out_state: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Potential at every `stride`-th voxel, and what the voxel is whatever the threshold."""
    nx, ny, nz = out_potential.shape
    for i in share(thread, 0, nx):
        corner = np.empty(8)
        x = lattice.x_mm[i * stride]
        u = (x - lattice.coarse_origin_mm[0]) / lattice.coarse_mm
        for j in range(ny):
            y = lattice.lateral_mm[j * stride]
            v = (y - lattice.coarse_origin_mm[1]) / lattice.coarse_mm
            for k in range(nz):
                z = lattice.superior_mm[k * stride]
                w = (z - lattice.coarse_origin_mm[2]) / lattice.coarse_mm
                out_state[i, j, k] = NOT_COUNTED
                depth = _interpolate(texture.fields, u, v, w, SKIN_DEPTH, corner)
                if depth < _skin_mm(paint, y, z) or _beyond_cut(paint, y, z):
                    continue
                if nipple_distance(x, y, z, paint.nipple_mm) < 0.0:
                    continue
                muscle = _interpolate(texture.fields, u, v, w, MUSCLE_DEPTH, corner)
                if muscle > 0.0 and depth > paint.cover_mm:
                    if _is_fat_plane(texture, paint, muscle, depth, x, y, z):
                        out_state[i, j, k] = FAT
                    continue
                out_potential[i, j, k], wall = _potential(texture, x, y, z, u, v, w, np.nan, corner)
                half = 0.5 * _interpolate(texture.fields, u, v, w, SEPTUM, corner)
                out_state[i, j, k] = WALL_OR_GLAND if wall < half else FAT_OR_GLAND
                if labels[i * stride, j * stride, k * stride] != 0:
                    out_state[i, j, k] = TUBE


@kernel
def _is_fat_plane(
    texture: Texture, paint: Paint, muscle: float, depth: float, x: float, y: float, z: float
) -> bool:
    """Whether a point of the muscle lies in the fat between its bundles, which run to the arm."""
    if min(muscle, depth - paint.cover_mm) < 1.5:
        return False
    along = y * paint.cut[0] + z * paint.cut[1]
    across = z * paint.cut[0] - y * paint.cut[1]
    coarse = gradient_noise(along / 60.0, across / 9.0, x / 7.0, texture.key + 128)
    fine = gradient_noise(along / 35.0, across / 3.5, x / 3.0, texture.key + 129)
    return 0.75 * coarse + 0.66 * fine > paint.fibre_noise


@parallel_kernel
def paint_tissue(
    thread: Thread, labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint
) -> None:
    """Give every voxel its label; tubes already there stay where they are inside the breast."""
    nx, ny, nz = labels.shape
    voxel = lattice.x_mm[1] - lattice.x_mm[0]
    for i in share(thread, 0, nx):
        corner = np.empty(8)
        x = lattice.x_mm[i]
        u = (x - lattice.coarse_origin_mm[0]) / lattice.coarse_mm
        for j in range(ny):
            y = lattice.lateral_mm[j]
            v = (y - lattice.coarse_origin_mm[1]) / lattice.coarse_mm
            for k in range(nz):
                z = lattice.superior_mm[k]
                tube, label = labels[i, j, k], np.uint8(0)
                if _beyond_cut(paint, y, z):
                    labels[i, j, k] = label
                    continue
                w = (z - lattice.coarse_origin_mm[2]) / lattice.coarse_mm
                depth = _interpolate(texture.fields, u, v, w, SKIN_DEPTH, corner)
                thick = _skin_mm(paint, y, z)
                if abs(depth) < voxel or abs(depth - thick) < voxel:
                    depth += voxel * dither(i, j, k, corner)
                if depth < thick + 4.0 and nipple_distance(x, y, z, paint.nipple_mm) < 0.0:
                    label = tube if tube != 0 else paint.labels[NIPPLE]
                elif depth < 0.0:
                    label = np.uint8(0)
                elif depth < thick:
                    label = paint.labels[SKIN]
                else:
                    label = _within_skin(texture, paint, tube, depth, x, y, z, u, v, w, corner)
                labels[i, j, k] = label


@kernel
def _within_skin(
    texture: Texture, paint: Paint, tube: int, depth: float, x: float, y: float, z: float,
    u: float, v: float, w: float, corner: NDArray[np.float64],
) -> int:  # fmt: skip
    """Label of a voxel within the skin."""
    muscle = _interpolate(texture.fields, u, v, w, MUSCLE_DEPTH, corner)
    if muscle > 0.0 and depth > paint.cover_mm:
        if _is_fat_plane(texture, paint, muscle, depth, x, y, z):
            return paint.labels[ADIPOSE]
        return paint.labels[MUSCLE]
    if tube != 0:
        return tube
    potential, wall = _potential(texture, x, y, z, u, v, w, paint.threshold, corner)
    if potential > paint.threshold:
        return paint.labels[GLAND]
    if wall < 0.5 * _interpolate(texture.fields, u, v, w, SEPTUM, corner):
        return paint.labels[LIGAMENT]
    return paint.labels[ADIPOSE]
