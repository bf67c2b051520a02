"""Compiled loops over the grid of the inverse map: what lies at a point, and how it was compressed.

Everything here is in grid units. The *grid* is that of the inverse map (compression frame); its
nodes carry four numbers: the fractional voxel of the phantom that came to lie there, counted so
that voxel i covers [i, i + 1), and the density that compression leaves. A node where no tissue
came to lie holds NaN.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, borrowing_kernel, kernel, parallel_kernel, share

Floats = NDArray[np.float64]
Labels = NDArray[np.uint8]
Nodes = NDArray[np.float32]
Words = NDArray[np.uint64]

Place = tuple[float, float, float, float]
"""A fractional voxel x, y, z and the density there."""

NOWHERE = (math.nan, math.nan, math.nan, math.nan)

# Two-point Gauss rule on [0, 1]: exact for the volume of a trilinear cell, whose determinant is
# quadratic in each coordinate.
_GAUSS = (0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0))


@borrowing_kernel
def value_on_plane(nodes: Nodes, u: float, v: float, k: int) -> Place:
    """Bilinear value of the nodes on plane k; NaN where a corner has none."""
    i = min(max(int(u), 0), nodes.shape[0] - 2)
    j = min(max(int(v), 0), nodes.shape[1] - 2)
    a, b = np.uint64(i), np.uint64(j)
    a1, b1, c = np.uint64(i + 1), np.uint64(j + 1), np.uint64(k)
    n00, n01, n10, n11 = nodes[a, b, c], nodes[a, b1, c], nodes[a1, b, c], nodes[a1, b1, c]
    if math.isnan(n00[0] + n01[0] + n10[0] + n11[0]):
        return NOWHERE
    fu, fv = u - i, v - j
    w00, w01 = (1.0 - fu) * (1.0 - fv), (1.0 - fu) * fv
    w10, w11 = fu * (1.0 - fv), fu * fv
    return (
        w00 * n00[0] + w01 * n01[0] + w10 * n10[0] + w11 * n11[0],
        w00 * n00[1] + w01 * n01[1] + w10 * n10[1] + w11 * n11[1],
        w00 * n00[2] + w01 * n01[2] + w10 * n10[2] + w11 * n11[2],
        w00 * n00[3] + w01 * n01[3] + w10 * n10[3] + w11 * n11[3],
    )


@parallel_kernel
def measure_cells(
    thread: Thread, nodes: Nodes, labels: Labels, out_density: Floats, out_tissue: NDArray[np.uint8]
) -> None:
    """Volume ratio (original to compressed) and tissue samples of each cell of the grid.

    `out_density` [x, y, z] gets the determinant of the nodes' gradient averaged over the cell, in
    voxels per cell, NaN where a corner is missing; `out_tissue` [x, y, z] how many of the eight
    points of the Gauss rule fall on tissue.
    """
    nu, nv, nk = out_density.shape
    for i in share(thread, 0, nu):
        gradient = np.empty((3, 3))
        place = np.empty(3)
        for j in range(nv):
            for k in range(nk):
                corners = nodes[i : i + 2, j : j + 2, k : k + 2]
                total = 0.0
                inside = 0
                for point in range(8):
                    fu, fv, fk = _GAUSS[point // 4], _GAUSS[point // 2 % 2], _GAUSS[point % 2]
                    _trilinear(corners, fu, fv, fk, place, gradient)
                    total += _determinant(gradient)
                    inside += _label_at(place, labels) != 0
                out_density[i, j, k] = total / 8.0
                out_tissue[i, j, k] = inside


@kernel
def _trilinear(
    corners: Nodes, fu: float, fv: float, fk: float, out_place: Floats, out_gradient: Floats
) -> None:
    """Voxel (3,) at (fu, fv, fk) in [0, 1]^3 of a cell and its gradient [node, voxel axis]."""
    out_place[:] = 0.0
    out_gradient[:] = 0.0
    for a in range(2):
        wa = fu if a else 1.0 - fu
        for b in range(2):
            wb = fv if b else 1.0 - fv
            for c in range(2):
                wc = fk if c else 1.0 - fk
                for part in range(3):
                    value = corners[a, b, c, part]
                    out_place[part] += wa * wb * wc * value
                    out_gradient[0, part] += (2 * a - 1) * wb * wc * value
                    out_gradient[1, part] += wa * (2 * b - 1) * wc * value
                    out_gradient[2, part] += wa * wb * (2 * c - 1) * value


@kernel
def _determinant(m: Floats) -> float:
    """Determinant of a 3 x 3 matrix."""
    return (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@kernel
def _label_at(place: Floats, labels: Labels) -> int:
    """Label of the voxel at `place`; air outside the array and where `place` is NaN."""
    nx, ny, nz = labels.shape
    x, y, z = place[0], place[1], place[2]
    if not (0.0 <= x < nx and 0.0 <= y < ny and 0.0 <= z < nz):
        return 0
    return int(labels[int(x), int(y), int(z)])


@parallel_kernel
def carry_labels(
    thread: Thread,
    axis_u: Floats,
    axis_v: Floats,
    axis_k: Floats,
    nodes: Nodes,
    labels: Labels,
    out_labels: Labels,
) -> None:
    """Label that came to lie at each point of a regular grid.

    `axis_u`, `axis_v`, `axis_k` are the points' coordinates as fractional nodes, none outside the
    grid. The nodes are interpolated trilinearly; air where a corner is missing.
    """
    nk = nodes.shape[2]
    nx, ny, nz = labels.shape
    below = np.empty(axis_k.size, np.int64)
    part = np.empty(axis_k.size)
    for c in range(axis_k.size):
        below[c] = min(int(axis_k[c]), nk - 2)
        part[c] = axis_k[c] - below[c]
    for a in share(thread, 0, axis_u.size):
        line = np.empty((nk, 3))
        for b in range(axis_v.size):
            low, high = _column_of_nodes(nodes, axis_u[a], axis_v[b], line)
            for c in range(axis_k.size):
                k = np.uint64(below[c])
                label = np.uint8(0)
                if low <= below[c] < high:
                    after, fk = k + np.uint64(1), part[c]
                    x = (1.0 - fk) * line[k, 0] + fk * line[after, 0]
                    y = (1.0 - fk) * line[k, 1] + fk * line[after, 1]
                    z = (1.0 - fk) * line[k, 2] + fk * line[after, 2]
                    if 0.0 <= x < nx and 0.0 <= y < ny and 0.0 <= z < nz:
                        label = labels[np.uint64(int(x)), np.uint64(int(y)), np.uint64(int(z))]
                out_labels[a, b, c] = label


@borrowing_kernel
def _column_of_nodes(nodes: Nodes, u: float, v: float, out_line: Floats) -> tuple[int, int]:
    """Bilinear voxel (x, y, z) at (u, v) on each plane of nodes; NaN where a corner has none.

    Returns the first and the last plane of those that have one; the last first without any.
    """
    i = min(max(int(u), 0), nodes.shape[0] - 2)
    j = min(max(int(v), 0), nodes.shape[1] - 2)
    n00, n01, n10, n11 = nodes[i, j], nodes[i, j + 1], nodes[i + 1, j], nodes[i + 1, j + 1]
    fu, fv = u - i, v - j
    w00, w01 = (1.0 - fu) * (1.0 - fv), (1.0 - fu) * fv
    w10, w11 = fu * (1.0 - fv), fu * fv
    low, high = nodes.shape[2], 0
    for k in range(nodes.shape[2]):
        if math.isnan(n00[k, 0] + n01[k, 0] + n10[k, 0] + n11[k, 0]):
            out_line[k, 0] = math.nan
            continue
        for d in range(3):
            out_line[k, d] = w00 * n00[k, d] + w01 * n01[k, d] + w10 * n10[k, d] + w11 * n11[k, d]
        low, high = min(low, k), k
    return low, high
