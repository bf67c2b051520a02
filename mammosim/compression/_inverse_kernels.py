"""Kernel that turns a displacement field round: where each point of the compressed breast was."""

import numpy as np

from mammosim._jit import kernel, parallel_kernel, share

_EDGE_SLACK = 1e-9
"""Barycentric coordinates this far below 0 still count as inside, so that no point falls between
two tetrahedra."""

_NEWTON_STEPS = 4
"""Most Newton steps to the inverse of the trilinear field; two are enough where nothing folds."""

_CLOSE_SQUARED = 1e-6
"""Square of the distance at which they stop: a thousandth of a cell."""

# The six tetrahedra of a cube that share its diagonal 0-7 (Kuhn 1960); corner = 4 a + 2 b + c.
# Corners are in such an order that the volume of each is positive.
KUHN_TETRAHEDRA = np.array(
    [[0, 4, 6, 7], [0, 5, 4, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 1, 5, 7], [0, 3, 1, 7]]
)

MAX_DEPTH = 7
"""Largest depth below the surface that is told apart, in cells."""


@kernel
def rasterise_inverse(displacement, depth, per_cell, shift, tetrahedra, original, rank):
    """Write the place at rest of every grid point that a deformed cell covers.

    Places, `original` [axis, x, y, z], are in lattice units. There are `per_cell` grid points per
    lattice unit: grid point [i, j, k] lies at ``([i, j, k] + shift) / per_cell``. `depth` is how
    deep a node lies in the tissue, 1 at its surface and 0 in air, up to `MAX_DEPTH`; cells with at
    least one tissue node take part. Where tetrahedra overlap, the one of the deepest cell wins, by
    the sum over its nodes: a cell of skin that folds at a plate's edge may reach several cells
    deep. Of equals, one that is not turned inside out wins, then the first. `rank` is twice that
    sum for the cell that wrote a point, and 1 more if its tetrahedron is not inside out; 0 where
    none did.
    """
    nx, ny, nz = depth.shape
    corners = np.empty((8, 3))
    rest = np.empty((8, 3))
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                below = np.intp(0)
                for n in range(8):
                    a, b, c = i + n // 4, j + (n // 2) % 2, k + n % 2
                    below += depth[a, b, c]
                if below == 0:
                    continue
                for n in range(8):
                    a, b, c = i + n // 4, j + (n // 2) % 2, k + n % 2
                    rest[n, 0], rest[n, 1], rest[n, 2] = a, b, c
                    for d in range(3):
                        place = rest[n, d] + displacement[a, b, c, d]
                        corners[n, d] = per_cell * place - shift[d]
                for t in range(6):
                    _fill_tetrahedron(corners, rest, tetrahedra[t], below, original, rank)


@kernel
def _fill_tetrahedron(corners, rest, tetrahedron, below, original, rank):
    """Write the grid points inside one deformed tetrahedron of a cell `below` the surface."""
    p, q, r, s = tetrahedron
    edges = np.empty((3, 3))
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for d in range(3):
        edges[d, 0] = corners[q, d] - corners[p, d]
        edges[d, 1] = corners[r, d] - corners[p, d]
        edges[d, 2] = corners[s, d] - corners[p, d]
        smallest = min(corners[p, d], corners[q, d], corners[r, d], corners[s, d])
        largest = max(corners[p, d], corners[q, d], corners[r, d], corners[s, d])
        low[d] = max(int(np.ceil(smallest - _EDGE_SLACK)), 0)
        high[d] = min(int(np.floor(largest + _EDGE_SLACK)), rank.shape[d] - 1)
    inverse = np.empty((3, 3))
    determinant = _invert(edges, inverse)
    if determinant == 0.0:
        return
    own = 2 * below + 1 if determinant > 0.0 else 2 * below
    for a in range(low[0], high[0] + 1):
        for b in range(low[1], high[1] + 1):
            for c in range(low[2], high[2] + 1):
                if rank[a, b, c] >= own:
                    continue
                u, v, w = a - corners[p, 0], b - corners[p, 1], c - corners[p, 2]
                first = inverse[0, 0] * u + inverse[0, 1] * v + inverse[0, 2] * w
                second = inverse[1, 0] * u + inverse[1, 1] * v + inverse[1, 2] * w
                third = inverse[2, 0] * u + inverse[2, 1] * v + inverse[2, 2] * w
                zeroth = 1.0 - first - second - third
                if min(zeroth, first, second, third) >= -_EDGE_SLACK:
                    rank[a, b, c] = own
                    for d in range(3):
                        original[d, a, b, c] = (
                            zeroth * rest[p, d]
                            + first * rest[q, d]
                            + second * rest[r, d]
                            + third * rest[s, d]
                        )


@kernel
def _invert(m, out):
    """Write the inverse of a 3 x 3 matrix; returns its determinant, 0 where it has no inverse."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    determinant = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    if abs(determinant) < 1e-12:
        return 0.0
    out[0, 0] = c00 / determinant
    out[1, 0] = c01 / determinant
    out[2, 0] = c02 / determinant
    out[0, 1] = (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]) / determinant
    out[1, 1] = (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]) / determinant
    out[2, 1] = (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]) / determinant
    out[0, 2] = (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]) / determinant
    out[1, 2] = (m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]) / determinant
    out[2, 2] = (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) / determinant
    return determinant


@parallel_kernel
def refine_inverse(thread, displacement, per_cell, shift, rank, original):
    """Take places of `rasterise_inverse` to the inverse of the trilinear field by Newton steps.

    They end before a step that comes no closer, as where cells are folded.
    """
    for i in share(thread, 0, rank.shape[0]):
        wanted = np.empty(3)
        place = np.empty(3)
        miss = np.empty(3)
        gradient = np.empty((3, 3))
        inverse = np.empty((3, 3))
        for j in range(rank.shape[1]):
            for k in range(rank.shape[2]):
                if rank[i, j, k] == 0:
                    continue
                wanted[0] = (i + shift[0]) / per_cell
                wanted[1] = (j + shift[1]) / per_cell
                wanted[2] = (k + shift[2]) / per_cell
                for d in range(3):
                    place[d] = original[d, i, j, k]
                least = np.inf
                for _ in range(_NEWTON_STEPS):
                    _miss_and_gradient(displacement, place, wanted, miss, gradient)
                    square = miss[0] ** 2 + miss[1] ** 2 + miss[2] ** 2
                    if square >= least:
                        break
                    least = square
                    for d in range(3):
                        original[d, i, j, k] = place[d]
                    if square < _CLOSE_SQUARED or _invert(gradient, inverse) == 0.0:
                        break
                    for d in range(3):
                        for e in range(3):
                            place[d] -= inverse[d, e] * miss[e]


@kernel
def _miss_and_gradient(displacement, place, wanted, miss, gradient):
    """How far the trilinear field brings a place beyond a wanted point, and the gradient of that.

    Beyond the lattice the field goes on as in its outermost cells.
    """
    nx, ny, nz, _ = displacement.shape
    i = min(max(int(np.floor(place[0])), 0), nx - 2)
    j = min(max(int(np.floor(place[1])), 0), ny - 2)
    k = min(max(int(np.floor(place[2])), 0), nz - 2)
    fx, fy, fz = place[0] - i, place[1] - j, place[2] - k
    for d in range(3):
        here = place[d] - wanted[d]
        along_x = 1.0 if d == 0 else 0.0
        along_y = 1.0 if d == 1 else 0.0
        along_z = 1.0 if d == 2 else 0.0
        for a in range(2):
            x, to_x = (fx, 1.0) if a else (1.0 - fx, -1.0)
            for b in range(2):
                y, to_y = (fy, 1.0) if b else (1.0 - fy, -1.0)
                for c in range(2):
                    z, to_z = (fz, 1.0) if c else (1.0 - fz, -1.0)
                    value = displacement[i + a, j + b, k + c, d]
                    here += x * y * z * value
                    along_x += to_x * y * z * value
                    along_y += x * to_y * z * value
                    along_z += x * y * to_z * value
        miss[d] = here
        gradient[d, 0], gradient[d, 1], gradient[d, 2] = along_x, along_y, along_z


@parallel_kernel
def shifts_back(thread, original, rank, per_cell, shift):
    """Turn places at rest [axis, x, y, z] into shifts from the grid's points; 0 if not covered."""
    for i in share(thread, 0, rank.shape[0]):
        for j in range(rank.shape[1]):
            for k in range(rank.shape[2]):
                if rank[i, j, k] > 0:
                    original[0, i, j, k] -= (i + shift[0]) / per_cell
                    original[1, i, j, k] -= (j + shift[1]) / per_cell
                    original[2, i, j, k] -= (k + shift[2]) / per_cell
                else:
                    original[0, i, j, k] = original[1, i, j, k] = original[2, i, j, k] = 0.0


@parallel_kernel
def places_before(thread, back, layer, per_cell, shift, origin_mm, spacing_mm, out):
    """``out`` [x, y, z, axis]: place at rest, mm, of each grid point that has a layer; else NaN."""
    for i in share(thread, 0, layer.shape[0]):
        for j in range(layer.shape[1]):
            for k in range(layer.shape[2]):
                if layer[i, j, k] == 0:
                    out[i, j, k, 0] = out[i, j, k, 1] = out[i, j, k, 2] = np.nan
                    continue
                x = (i + shift[0]) / per_cell + back[0, i, j, k]
                y = (j + shift[1]) / per_cell + back[1, i, j, k]
                z = (k + shift[2]) / per_cell + back[2, i, j, k]
                out[i, j, k, 0] = origin_mm[0] + x * spacing_mm[0]
                out[i, j, k, 1] = origin_mm[1] + y * spacing_mm[1]
                out[i, j, k, 2] = origin_mm[2] + z * spacing_mm[2]
