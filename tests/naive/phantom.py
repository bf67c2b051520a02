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


def lobules(points, strength, place):
    """Pull of the nearest of all points (n, 3), and distance to the plane half way to the next."""
    distance = np.linalg.norm(points - place, axis=1)
    first, second = np.argsort(distance)[:2]
    normal = points[second] - points[first]
    middle = 0.5 * (points[first] + points[second])
    wall = (middle - place) @ normal / np.linalg.norm(normal)
    return strength[first] * max(0.0, 1 - distance[first] ** 2 / 0.36), wall


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
