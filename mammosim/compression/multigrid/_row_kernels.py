"""Rows of a lattice along z: which part of one is visited, and how stiff its springs are.

Arrays are [x, y, z] with one empty layer around; ``span[i, j]`` holds the first and one past the
last z index of a row. `springs` is either the modulus of each node [x, y, z], 0 in air, a spring
having the smaller of its two; or the stiffness of each spring [13, x, y, z], from a node to those
of its neighbours that lie ahead in the order ``9 (dx+1) + 3 (dy+1) + (dz+1)``. The compiler sees
which from the number of axes. Indices are unsigned, which spares the test for negative ones.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel

_ONE = np.uint64(1)

VECTOR = 16
"""Nodes of a row that are visited together: single-precision numbers in the widest registers."""


@inlined_kernel
def visited(span, i, j, size):
    """First and one past the last z index of a column, widened to whole vectors if there is room.

    `size` is that of the array along z.
    """
    first, last = span[i, j, 0], span[i, j, 1]
    if first >= last:
        return np.uint64(0), np.uint64(0)
    count = min(-(-(last - first) // VECTOR) * VECTOR, size - 2)
    first = min(first, size - 1 - count)
    return np.uint64(first), np.uint64(first + count)


@contracting_kernel
def column_stiffness(springs, i, j, di, dj, first, last, out):
    """Stiffness of the springs (di, dj, -1 .. 1) of each node of a column, `out` being [3, z].

    The spring of a node to itself is 0.
    """
    if springs.ndim == 3:
        own, other = springs[i, j], springs[i + di, j + dj]
        for k in range(first, last):
            e = own[k]
            out[0, k] = min(e, other[k - _ONE])
            out[1, k] = min(e, other[k])
            out[2, k] = min(e, other[k + _ONE])
    else:
        for step in range(3):
            flat = 9 * (di + 1) + 3 * (dj + 1) + step
            row = out[step]
            if flat > 13:
                own = springs[flat - 14, i, j]
                for k in range(first, last):
                    row[k] = own[k]
            elif flat < 13:
                other, shift = springs[12 - flat, i + di, j + dj], np.uint64(step)
                for k in range(first, last):
                    row[k] = other[k + shift - _ONE]
    if di == 0 and dj == 0:
        out[1, first:last] = 0.0
