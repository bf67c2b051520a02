"""Slow twins of the kernels that both mechanical models share."""

from __future__ import annotations

from itertools import product

import numpy as np


def blocks(labels, modulus_of, muscle_of, to_voxel, samples, shape):
    """Tissue fraction, mean modulus of the tissue and muscle's part of it, of each node's block."""
    out = np.zeros((3, *shape))
    inner = (np.arange(samples) + 0.5) / samples - 0.5
    for node in np.ndindex(*shape):
        found = []
        for offset in product(inner, repeat=3):
            place = to_voxel @ [*np.add(node, offset), 1.0]
            voxel = np.floor(place + 0.5).astype(int)
            if ((voxel >= 0) & (voxel < labels.shape)).all():
                found.append(labels[tuple(voxel)])
        tissue = [label for label in found if modulus_of[label] > 0]
        if tissue:
            moduli, muscles = modulus_of[tissue], muscle_of[tissue]
            out[(slice(None), *node)] = len(tissue) / samples**3, moduli.mean(), muscles.mean()
    return out


def neighbours(node, shape):
    """Indices of the up to 26 nodes around a node."""
    around = (tuple(np.add(node, offset)) for offset in product((-1, 0, 1), repeat=3))
    return [
        n
        for n in around
        if n != node and all(0 <= i < size for i, size in zip(n, shape, strict=True))
    ]


def one_layer(field, known):
    """Mean of the known neighbours at nodes that touch one; the field and what is known then."""
    field, then = field.copy(), known.copy()
    for node in np.ndindex(*known.shape):
        near = [n for n in neighbours(node, known.shape) if known[n]]
        if not known[node] and near:
            field[(slice(None), *node)] = np.mean([field[(slice(None), *n)] for n in near], axis=0)
            then[node] = True
    return field, then


def one_straight_layer(field, known):
    """Mean of what lines of two known nodes along the axes lead to."""
    field, then = field.copy(), known.copy()
    for node in np.ndindex(*known.shape):
        ends = []
        for axis, step in product(range(3), (1, -1)):
            direction = step * np.eye(3, dtype=int)[axis]
            near, far = tuple(node + direction), tuple(node + 2 * direction)
            inside = all(0 <= i < size for i, size in zip(far, known.shape, strict=True))
            if inside and known[near] and known[far]:
                ends.append(2 * field[(slice(None), *near)] - field[(slice(None), *far)])
        if not known[node] and ends:
            field[(slice(None), *node)] = np.mean(ends, axis=0)
            then[node] = True
    return field, then


def place_at_rest(displacement, depth, point):
    """Where a point of the deformed lattice was, in lattice units; None where nothing came.

    Each cell is cut into six tetrahedra around the diagonal from its first to its last corner: one
    for each order in which the three axes can be walked. Of those that cover the point the one
    in the deepest cell wins, then one that is not turned inside out, then the first.
    """
    best, answer = (0, False), None
    orders = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    for cell in np.ndindex(*(size - 1 for size in depth.shape)):
        part = tuple(slice(c, c + 2) for c in cell)
        below = int(depth[part].sum())
        if below == 0:
            continue
        for order in orders:
            corners = [np.array(cell)]
            for axis in order:
                corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
            moved = np.array([corner + displacement[tuple(corner)] for corner in corners])
            matrix = np.vstack([moved.T, np.ones(4)])
            volume = np.linalg.det(moved[1:] - moved[0])
            upright = volume * np.linalg.det(np.eye(3)[list(order)]) > 0.0
            if abs(volume) < 1e-12 or (below, upright) <= best:
                continue
            weights = np.linalg.solve(matrix, [*point, 1.0])
            if weights.min() >= -1e-9:
                best, answer = (below, upright), weights @ np.array(corners)
    return answer
