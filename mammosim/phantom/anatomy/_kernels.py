"""Kernels of the generator: noise, fat lobules, tubes, and the tissue of each voxel."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mammosim._jit import kernel, parallel_kernel

SKIN_DEPTH, MUSCLE_DEPTH, ENVELOPE, WARP, SEPTUM = 0, 1, 2, 3, 6
"""Channels of the coarse fields; WARP takes three."""


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
    """Labels and thicknesses that the last step needs."""

    skin_mm: float
    nipple_mm: NDArray[np.float64]
    cover_mm: float
    threshold: float
    adipose: int
    skin: int
    gland: int
    nipple: int
    muscle: int
    ligament: int


@kernel
def lattice_hash(i: int, j: int, k: int, key: int) -> int:
    """32 well mixed bits of a lattice point; all products stay below 2^63."""
    h = (i * 73856093 ^ j * 19349663 ^ k * 83492791 ^ key * 2654435) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    h = ((h ^ (h >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return h ^ (h >> 15)


@kernel
def _corner(i: int, j: int, k: int, key: int, x: float, y: float, z: float) -> float:
    h = lattice_hash(i, j, k, key)
    return (
        ((h & 1023) - 511.5) * x + (((h >> 10) & 1023) - 511.5) * y
        + (((h >> 20) & 1023) - 511.5) * z
    ) * (5.24 / 512.0)  # fmt: skip


@kernel
def gradient_noise(x: float, y: float, z: float, key: int) -> float:
    """Gradient noise (Perlin 2002, ACM Trans Graph 21:681-682) of mean 0 and variance about 1.

    Lattice gradients are uniform in a cube instead of along its edges, and the sum is scaled so
    that the variance over space is one.
    """
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    x, y, z = x - i, y - j, z - k
    u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    v = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    w = z * z * z * (z * (z * 6.0 - 15.0) + 10.0)
    total = 0.0
    for a in range(2):
        wu = u if a == 1 else 1.0 - u
        for b in range(2):
            wv = v if b == 1 else 1.0 - v
            low = _corner(i + a, j + b, k, key, x - a, y - b, z)
            high = _corner(i + a, j + b, k + 1, key, x - a, y - b, z - 1.0)
            total += wu * wv * (low + w * (high - low))
    return total


@kernel
def _interpolate(
    fields: NDArray[np.float32], x: float, y: float, z: float, out: NDArray[np.float64]
) -> None:
    """Trilinear value of every channel at fractional coarse indices that lie inside."""
    i, j, k = int(x), int(y), int(z)
    x, y, z = x - i, y - j, z - k
    out[:] = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                weight = (
                    (x if a == 1 else 1.0 - x) * (y if b == 1 else 1.0 - y)
                    * (z if c == 1 else 1.0 - z)
                )  # fmt: skip
                for channel in range(out.size):
                    out[channel] += weight * fields[i + a, j + b, k + c, channel]


@kernel
def _lobules(texture: Texture, x: float, y: float, z: float) -> tuple[float, float]:
    """Pull of the nearest fat lobule, and distance to the wall between it and the next, mm.

    The lobules are Voronoi cells of jittered points (Worley 1996, SIGGRAPH 291-294).
    """
    u = (x - texture.seed_origin_mm[0]) / texture.cell_mm
    v = (y - texture.seed_origin_mm[1]) / texture.cell_mm
    w = (z - texture.seed_origin_mm[2]) / texture.cell_mm
    i, j, k = int(u), int(v), int(w)
    first, second = 1e9, 1e9
    fx = fy = fz = sx = sy = sz = strength = 0.0
    for a in range(max(i - 1, 0), min(i + 2, texture.seeds.shape[0])):
        for b in range(max(j - 1, 0), min(j + 2, texture.seeds.shape[1])):
            for c in range(max(k - 1, 0), min(k + 2, texture.seeds.shape[2])):
                px = a + texture.seeds[a, b, c, 0]
                py = b + texture.seeds[a, b, c, 1]
                pz = c + texture.seeds[a, b, c, 2]
                squared = (px - u) ** 2 + (py - v) ** 2 + (pz - w) ** 2
                if squared < first:
                    second, sx, sy, sz = first, fx, fy, fz
                    first, fx, fy, fz = squared, px, py, pz
                    strength = texture.seeds[a, b, c, 3]
                elif squared < second:
                    second, sx, sy, sz = squared, px, py, pz
    between = np.sqrt((fx - sx) ** 2 + (fy - sy) ** 2 + (fz - sz) ** 2)
    wall = 0.5 * (second - first) / max(between, 1e-3) * texture.cell_mm
    pull = strength * max(0.0, 1.0 - first / 0.36)
    return pull, wall


@kernel
def _potential(
    texture: Texture, x: float, y: float, z: float, at: NDArray[np.float64]
) -> tuple[float, float]:
    """Potential of glandular tissue at a point, and its distance to a lobule's wall, mm."""
    x, y, z = x + at[WARP], y + at[WARP + 1], z + at[WARP + 2]
    pull, wall = _lobules(texture, x, y, z)
    total = at[ENVELOPE] - texture.lobule_amplitude * pull
    dx, dy, dz = texture.apex_mm[0] - x, y - texture.apex_mm[1], z - texture.apex_mm[2]
    r = np.sqrt(dx * dx + dy * dy + dz * dz) + 1.0
    for octave in range(texture.fan_amplitude.size):
        # Strands run towards the nipple: noise in direction and, five times slower, distance.
        per = texture.fan_per_radian[octave]
        total += texture.fan_amplitude[octave] * gradient_noise(
            np.log(r) * per / 5.0, dy / r * per, dz / r * per, texture.key + octave
        )
    for octave in range(texture.grain_amplitude.size):
        s = 1.0 / texture.grain_mm[octave]
        total += texture.grain_amplitude[octave] * gradient_noise(
            x * s, y * s, z * s, texture.key + 64 + octave
        )
    return total, wall


@kernel
def _nipple_distance(x: float, y: float, z: float, nipple_mm: NDArray[np.float64]) -> float:
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


@parallel_kernel
def sample_potential(
    labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint, stride: int,
    out_potential: NDArray[np.float32], out_state: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Potential at every `stride`-th voxel, and what the voxel is whatever the threshold.

    `out_state`: 0 not within the skin or muscle, 1 gland or fat, 2 gland or ligament, 3 tube.
    """
    nx, ny, nz = out_potential.shape
    for i in numba.prange(nx):
        at = np.empty(texture.fields.shape[3])
        x = lattice.x_mm[i * stride]
        for j in range(ny):
            y = lattice.lateral_mm[j * stride]
            for k in range(nz):
                z = lattice.superior_mm[k * stride]
                _interpolate(
                    texture.fields, (x - lattice.coarse_origin_mm[0]) / lattice.coarse_mm,
                    (y - lattice.coarse_origin_mm[1]) / lattice.coarse_mm,
                    (z - lattice.coarse_origin_mm[2]) / lattice.coarse_mm, at,
                )  # fmt: skip
                out_state[i, j, k] = 0
                if (
                    at[SKIN_DEPTH] < paint.skin_mm
                    or (at[MUSCLE_DEPTH] > 0.0 and at[SKIN_DEPTH] > paint.cover_mm)
                    or _nipple_distance(x, y, z, paint.nipple_mm) < 0.0
                ):
                    continue
                out_potential[i, j, k], wall = _potential(texture, x, y, z, at)
                out_state[i, j, k] = 2 if wall < 0.5 * at[SEPTUM] else 1
                if labels[i * stride, j * stride, k * stride] != 0:
                    out_state[i, j, k] = 3


@parallel_kernel
def paint_tissue(
    labels: NDArray[np.uint8], lattice: Lattice, texture: Texture, paint: Paint
) -> None:
    """Give every voxel its label; tubes already there stay where they are inside the breast."""
    nx, ny, nz = labels.shape
    for i in numba.prange(nx):
        at = np.empty(texture.fields.shape[3])
        x = lattice.x_mm[i]
        for j in range(ny):
            y = lattice.lateral_mm[j]
            for k in range(nz):
                z = lattice.superior_mm[k]
                _interpolate(
                    texture.fields, (x - lattice.coarse_origin_mm[0]) / lattice.coarse_mm,
                    (y - lattice.coarse_origin_mm[1]) / lattice.coarse_mm,
                    (z - lattice.coarse_origin_mm[2]) / lattice.coarse_mm, at,
                )  # fmt: skip
                depth, tube = at[SKIN_DEPTH], labels[i, j, k]
                if _nipple_distance(x, y, z, paint.nipple_mm) < 0.0:
                    label = tube if tube != 0 else paint.nipple
                elif depth < 0.0:
                    label = 0
                elif depth < paint.skin_mm:
                    label = paint.skin
                elif at[MUSCLE_DEPTH] > 0.0 and depth > paint.cover_mm:
                    label = paint.muscle
                elif tube != 0:
                    label = tube
                else:
                    potential, wall = _potential(texture, x, y, z, at)
                    label = paint.adipose
                    if potential > paint.threshold:
                        label = paint.gland
                    elif wall < 0.5 * at[SEPTUM]:
                        label = paint.ligament
                labels[i, j, k] = label


@kernel
def paint_tubes(
    labels: NDArray[np.uint8], lattice: Lattice, ends_mm: NDArray[np.float64],
    radius_mm: NDArray[np.float64], label: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Paint straight round pieces: ends (n, 2, 3) and radii (n, 2) at both ends, mm.

    Besides the voxels whose centre lies in it, a piece gets those that its axis goes through, one
    a step along its longest side, so that a thin one does not break up.
    """
    step = lattice.x_mm[1] - lattice.x_mm[0]
    for n in range(ends_mm.shape[0]):
        a, b = ends_mm[n, 0], ends_mm[n, 1]
        widest = max(radius_mm[n, 0], radius_mm[n, 1])
        low, high = np.minimum(a, b) - widest, np.maximum(a, b) + widest
        squared = max(((b - a) ** 2).sum(), 1e-9)
        i0, i1 = np.searchsorted(lattice.x_mm, low[0]), np.searchsorted(lattice.x_mm, high[0])
        j0 = np.searchsorted(lattice.lateral_mm, low[1])
        j1 = np.searchsorted(lattice.lateral_mm, high[1])
        k0 = np.searchsorted(lattice.superior_mm, low[2])
        k1 = np.searchsorted(lattice.superior_mm, high[2])
        for i in range(i0, i1):
            dx = lattice.x_mm[i] - a[0]
            for j in range(j0, j1):
                dy = lattice.lateral_mm[j] - a[1]
                for k in range(k0, k1):
                    dz = lattice.superior_mm[k] - a[2]
                    t = (dx * (b[0] - a[0]) + dy * (b[1] - a[1]) + dz * (b[2] - a[2])) / squared
                    t = min(max(t, 0.0), 1.0)
                    gap = (
                        (dx - t * (b[0] - a[0])) ** 2 + (dy - t * (b[1] - a[1])) ** 2
                        + (dz - t * (b[2] - a[2])) ** 2
                    )  # fmt: skip
                    radius = radius_mm[n, 0] + t * (radius_mm[n, 1] - radius_mm[n, 0])
                    if gap <= radius * radius:
                        labels[i, j, k] = label[n]
        steps = int(np.ceil(np.abs(b - a).max() / step))
        for turn in range(steps + 1):
            along = turn / max(steps, 1)
            i = int(np.rint((a[0] + along * (b[0] - a[0]) - lattice.x_mm[0]) / step))
            j = int(np.rint((a[1] + along * (b[1] - a[1]) - lattice.lateral_mm[0]) / step))
            k = int(np.rint((a[2] + along * (b[2] - a[2]) - lattice.superior_mm[0]) / step))
            within = 0 <= i < labels.shape[0] and 0 <= j < labels.shape[1]
            if within and 0 <= k < labels.shape[2]:
                labels[i, j, k] = label[n]
