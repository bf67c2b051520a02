"""Slow twins of the phantom room's kernels: NumPy and SciPy, straight from the definitions."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import ndimage


def bodies(labels):
    """Number of bodies joined by faces, voxels apart from the largest, and its foremost layer."""
    pieces, count = ndimage.label(labels != 0)
    sizes = np.bincount(pieces.ravel())[1:]
    main = int(sizes.argmax()) + 1
    voxels = np.argwhere(pieces == main)
    foremost = voxels[voxels[:, 0] == voxels[:, 0].max()]
    return count, int(sizes.sum() - sizes[main - 1]), foremost.mean(axis=0)


def _hash(i, j, k, key):
    """The 32 bits of a lattice point, in Python's own whole numbers."""
    mask = 0xFFFFFFFF
    h = (i * 73856093 ^ j * 19349663 ^ k * 83492791 ^ key * 2654435) & mask
    h = ((h ^ (h >> 15)) * 0x2C1B3C6D) & mask
    h = ((h ^ (h >> 12)) * 0x297A2D39) & mask
    return h ^ (h >> 15)


def gradient_noise(point, key):
    """Sum over the eight corners of fade weight times gradient dot offset."""
    cell = np.floor(point).astype(int)
    inside = np.asarray(point) - cell
    fade = inside**3 * (inside * (inside * 6 - 15) + 10)
    total = 0.0
    for corner in itertools.product((0, 1), repeat=3):
        h = _hash(*(int(c) for c in cell + corner), key)
        gradient = (np.array([h & 1023, (h >> 10) & 1023, (h >> 20) & 1023]) - 511.5) / 512
        weight = np.prod(np.where(corner, fade, 1 - fade))
        total += weight * 5.24 * gradient @ (inside - corner)
    return total


def wall(net, place_mm, slope):
    """Distance to the nearest wall of a power diagram, real mm, and fatness of the cell there.

    `slope` takes real to net coordinates, so that a wall's normal n has a real gradient slope^T n.
    """
    cells = np.indices(net.seeds.shape[:3])
    there = net.seeds[..., 3] >= -5.0
    points = (np.moveaxis(cells, 0, -1) + net.seeds[..., :3])[there].astype(float)
    weight, fatness = net.seeds[..., 3][there].astype(float), net.seeds[..., 4][there]
    place = (np.asarray(place_mm) - net.origin_mm) / net.cell_mm
    power = ((points - place) ** 2).sum(axis=1) - weight
    own = int(power.argmin())
    steep = 2.0 * np.linalg.norm((points - points[own]) @ slope, axis=1) / net.cell_mm
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = (power - power[own]) / steep
    gap[own] = np.inf
    return np.sort(gap)[:2], fatness[own]


def rounded(gaps, rounding_mm):
    """Distance to the nearest wall, less where a second one is near: corners become round."""
    first, second = np.minimum(gaps, 1.1 * rounding_mm)
    return first - 0.25 * rounding_mm * max(1.0 - (second - first) / rounding_mm, 0.0) ** 2


def pushed(net, place_mm, slope, depth_mm):
    """How strongly the lobule at a place pushes gland aside."""
    gaps, fatness = wall(net, place_mm, slope)
    part = min(max(rounded(gaps, depth_mm) / depth_mm, 0.0), 1.0)
    return fatness * part * (2.0 - part)


def gland_potential(texture, origin_mm, coarse_mm, point_mm):
    """Potential at a point as voxels have it: interpolated on the sub-grid of its block."""
    at = (np.asarray(point_mm) - origin_mm) / coarse_mm
    block = np.floor(at).astype(int)
    sub = (at - block) * 4
    first = np.minimum(sub.astype(int), 3)
    corners = texture.fields[tuple(slice(n, n + 2) for n in block)].astype(float)
    total = 0.0
    for corner in itertools.product((0, 1), repeat=3):
        node = (first + corner) / 4
        weight = np.prod(np.where(corner, sub - first, 1 - (sub - first)))
        place = origin_mm + (block + node) * coarse_mm
        total += weight * _full_potential(texture, corners, node, place, coarse_mm)
    return total


def _full_potential(texture, corners, node, place, coarse_mm):
    weights = [np.prod(np.where(c, node, 1 - node)) for c in itertools.product((0, 1), repeat=3)]
    values = np.tensordot(weights, corners.reshape(8, -1), axes=1)
    slope = (
        np.stack(
            [
                (corners[1].mean((0, 1)) - corners[0].mean((0, 1)))[5:8],
                (corners[:, 1].mean((0, 1)) - corners[:, 0].mean((0, 1)))[5:8],
                (corners[:, :, 1].mean((0, 1)) - corners[:, :, 0].mean((0, 1)))[5:8],
            ],
            axis=1,
        )
        / coarse_mm
    )
    towards = texture.apex_mm - place
    r = np.linalg.norm(towards) + 1.0
    noise = 0.0
    for octave, (amplitude, per) in enumerate(
        zip(texture.fan_amplitude, texture.fan_per_radian, strict=True)
    ):
        seen = [np.log(r) / 3.0 * per, -towards[1] / r * per, -towards[2] / r * per]
        noise += amplitude * gradient_noise(seen, texture.key + octave)
    for octave, (amplitude, grain) in enumerate(
        zip(texture.grain_amplitude, texture.grain_mm, strict=True)
    ):
        noise += amplitude * gradient_noise(place / grain, texture.key + 64 + octave)
    pull = pushed(texture.lobules, values[5:8], slope, texture.lobule_mm)
    pull *= texture.lobule_amplitude
    return values[2] + np.clip(noise, -texture.noise_limit, texture.noise_limit) - pull


def grain(texture, origin_mm, coarse_mm, point_mm):
    """The grain of gland at a point: greatest where the noise of the tile is zero. Net coordinates
    give the tile's cell; the first points to the nipple."""
    at = (np.asarray(point_mm) - origin_mm) / coarse_mm
    block = np.floor(at).astype(int)
    corners = texture.fields[tuple(slice(n, n + 2) for n in block)].astype(float)
    weights = [
        np.prod(np.where(c, at - block, 1 - (at - block)))
        for c in itertools.product((0, 1), repeat=3)
    ]
    bent = np.tensordot(weights, corners.reshape(8, -1), axes=1)[5:8]
    cell = np.floor(np.array([1.8, 5.0, 1.5]) * bent).astype(int) % 128
    deviation = 127.0 / 2.6  # of the noise, which is cut off at 2.6 deviations
    magnitude = abs(texture.grain_tile[tuple(cell)] / deviation)
    ridge = (np.sqrt(2.0 / np.pi) - magnitude) / np.sqrt(1.0 - 2.0 / np.pi)
    return texture.gland_scale * deviation * ridge


def thread_fill(gap_mm, radius_mm, voxel_mm):
    """A cone that holds the cross-section of a thread, a voxel or more wide."""
    wide = max(voxel_mm, np.sqrt(3.0) * radius_mm)
    return max(np.pi * radius_mm**2 / (np.pi * wide**2 / 3.0) * (1.0 - gap_mm / wide), 0.0)


def in_cone(point, start, end, radius):
    """Whether a point lies in a straight piece whose radius changes from end to end."""
    axis = end - start
    t = np.clip((point - start) @ axis / max(axis @ axis, 1e-9), 0, 1)
    return np.linalg.norm(point - start - t * axis) <= radius[0] + t * (radius[1] - radius[0])


def on_axis(point, start, end, step):
    """Whether a point is the nearest of its grid to one of the places a step apart on a line."""
    steps = int(np.ceil(np.abs(end - start).max() / step))
    places = start + np.linspace(0, 1, steps + 1)[:, None] * (end - start)
    return (np.abs(np.rint(places / step) * step - point) < 1e-9).all(axis=1).any()


def left_out(
    labels: np.ndarray, coarse, box: np.ndarray, voxel_mm: float, cover_mm: float,
    standing: float, skin: int, nipple: int, muscle: int, fat: int,
) -> np.ndarray:  # fmt: skip
    """Labels with air, skin and fat over muscle where a coarse depth, trilinear, puts them.

    Of each column's muscle only a part stands.
    """
    held = labels.copy()
    for i, j, k in np.argwhere((labels != 0) & (labels != nipple)):
        shift = (0.7548776662466927 * i + 0.5698402909980532 * j) % 1.0 - 0.5
        if labels[i, j, k] == muscle:
            foremost = np.flatnonzero(labels[:, j, k] == muscle)[-1]
            if i + 0.5 + shift > standing * (foremost + 1):
                held[i, j, k] = fat
        if not all(low <= at < high for at, (low, high) in zip((i, j, k), box, strict=True)):
            continue
        depth = 0.0
        for corner in np.ndindex(2, 2, 2):
            cell = coarse.cells_x[i], coarse.cells_y[j], coarse.cells_z[k]
            part = coarse.part_x[i], coarse.part_y[j], coarse.part_z[k]
            weight = np.prod([p if a else 1.0 - p for a, p in zip(corner, part, strict=True)])
            depth += weight * coarse.mm[tuple(np.add(cell, corner))]
        depth += voxel_mm * shift
        if depth < 0.0:
            held[i, j, k] = 0
        elif depth < coarse.skin_mm:
            held[i, j, k] = skin
        elif depth < cover_mm and labels[i, j, k] == muscle:
            held[i, j, k] = fat
    return held
