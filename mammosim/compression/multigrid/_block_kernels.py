"""Kernels of symmetric 27-point stencils of 3 x 3 blocks: inverse blocks, Galerkin coarsening.

The layout is that of `_tangent_kernels`; vectors are ``[3, x, y, z]`` with one empty layer around.
Loops over a block's entries end where an array's shape says: the compiler would write out those
whose end it knows, which takes it several times as long and is no faster.
"""

import numpy as np

from mammosim._jit import contracting_kernel, merged_kernel, share, sized_kernel

_ONE = np.uint64(1)


@sized_kernel
def block_scaled(thread, inverse, span, load, gain, out):
    """``out = gain D^-1 load``."""
    for i in share(thread, 1, load.shape[1] - 1):
        for j in range(1, load.shape[2] - 1):
            first, last = span[i, j, 0], span[i, j, 1]
            if first < last:
                for r in range(3):
                    target = out[r, i, j]
                    for k in range(first, last):
                        target[k] = np.float32(0.0)
                    _row_step(
                        inverse, load[:, i, j], i, j, r, first, last, np.float32(0.0), gain, target
                    )


@merged_kernel
def _row_step(inverse, force, i, j, r, first, last, keep, gain, step):
    """``step = keep step + gain (D^-1 force)[r]``; `inverse` is [xx, xy, xz, yy, yz, zz]."""
    a = inverse[i, j, r]
    b = inverse[i, j, (1, 3, 4)[r]]
    c = inverse[i, j, (2, 4, 5)[r]]
    x, y, z = force[0], force[1], force[2]
    for k in range(np.uint64(first), np.uint64(last)):
        step[k] = keep * step[k] + gain * (a[k] * x[k] + b[k] * y[k] + c[k] * z[k])


@sized_kernel
def invert_blocks(thread, stencil, span, out):
    """Inverse of each node's own block, six entries; 0 where a displacement has no stiffness.

    A block that is not positive definite is replaced by its absolute row sums.
    """
    for i in share(thread, 1, out.shape[0] - 1):
        for j in range(1, out.shape[1] - 1):
            for k in range(span[i, j, 0], span[i, j, 1]):
                _invert_block(stencil[i, j, :, k], out[i, j, :, k])


@merged_kernel
def _invert_block(block, out):
    """Inverse of one symmetric block; rows with an empty diagonal stay empty."""
    xx, xy, xz, yy, yz, zz = block[0], block[1], block[2], block[4], block[5], block[8]
    has_x, has_y, has_z = xx != 0.0, yy != 0.0, zz != 0.0
    if not has_x:
        xx = np.float32(1.0)
    if not has_y:
        yy = np.float32(1.0)
    if not has_z:
        zz = np.float32(1.0)
    minor = xx * yy - xy * xy
    whole = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    if xx <= 0.0 or minor <= 0.0 or whole <= np.float32(1e-6) * xx * minor:
        xx = abs(xx) + abs(xy) + abs(xz)
        yy = abs(xy) + abs(yy) + abs(yz)
        zz = abs(xz) + abs(yz) + abs(zz)
        xy = xz = yz = np.float32(0.0)
        minor, whole = xx * yy, xx * yy * zz
    part = np.float32(1.0) / whole
    out[0] = part * (yy * zz - yz * yz) if has_x else np.float32(0.0)
    out[1] = part * (xz * yz - xy * zz)
    out[2] = part * (xy * yz - xz * yy)
    out[3] = part * (xx * zz - xz * xz) if has_y else np.float32(0.0)
    out[4] = part * (xy * xz - xx * yz)
    out[5] = part * minor if has_z else np.float32(0.0)


@sized_kernel
def clear(thread, span, out_stencil):
    """Empty the part of a stencil that `span` holds."""
    for i in share(thread, 0, out_stencil.shape[0]):
        for j in range(out_stencil.shape[1]):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first < last:
                for entry in range(out_stencil.shape[2]):
                    row = out_stencil[i, j, entry]
                    for k in range(first, last):
                        row[k] = np.float32(0.0)


@sized_kernel
def hold(thread, stencil, span, free, held):
    """Empty the rows and columns of held displacements; `free` is [3, x, y, z], 1 or 0.

    Nothing couples nodes outside `span`. ``held[x, y]``: whether a row has held displacements.
    """
    for i in share(thread, 1, free.shape[1] - 1):
        for j in range(1, free.shape[2] - 1):
            first, last = np.uint64(span[i, j, 0]), np.uint64(span[i, j, 1])
            if first >= last:
                continue
            for offset in range(14):
                flat = offset + 13
                di, dj, shift = flat // 9 - 1, (flat // 3) % 3 - 1, np.uint64(flat % 3)
                if not (held[i, j] or held[i + di, j + dj]):
                    continue
                for r in range(free.shape[0]):
                    own = free[r, i, j]
                    for c in range(free.shape[0]):
                        other, row = free[c, i + di, j + dj], stencil[i, j, 9 * offset + 3 * r + c]
                        for k in range(first, last):
                            row[k] *= own[k] * other[k + shift - _ONE]


@sized_kernel
def galerkin_of_blocks(thread, stencil, span, out):
    """Stencil of ``P^T A P`` on the next coarse level, P being trilinear in each displacement.

    Of the fine rows around a coarse one, only what lies within their spans is summed.
    """
    entries = stencil.shape[2] // 14
    for i in share(thread, 1, out.shape[0] - 1):
        half = np.empty(135 * stencil.shape[3], np.float32)
        row = np.empty(9 * stencil.shape[3], np.float32)
        for j in range(1, out.shape[1] - 1):
            begin, end = _fine_window(span, i, j)
            if begin >= end:
                continue
            for k in range(np.uint64(135 * (end - begin))):
                half[k] = np.float32(0.0)
            for ti in range(-1, 2):
                for tj in range(-1, 2):
                    fi, fj = 2 * i - 1 + ti, 2 * j - 1 + tj
                    if not (0 < fi < stencil.shape[0] - 1 and 0 < fj < stencil.shape[1] - 1):
                        continue
                    if span[fi, fj, 0] < span[fi, fj, 1]:
                        _collapse_columns(
                            stencil, entries, fi, fj, ti, tj, begin, end - begin, row, half
                        )
            _collapse_row(half, entries, begin, end, out[i, j])


@merged_kernel
def _fine_window(span, i, j):
    """First and one past the last z index used in the nine fine rows around a coarse one."""
    begin, end = span.dtype.type(2**30), span.dtype.type(0)
    for fi in range(2 * i - 2, min(2 * i + 1, span.shape[0] - 1)):
        for fj in range(2 * j - 2, min(2 * j + 1, span.shape[1] - 1)):
            if span[fi, fj, 0] < span[fi, fj, 1]:
                begin, end = min(begin, span[fi, fj, 0]), max(end, span[fi, fj, 1])
    return begin, end


@merged_kernel
def _weight(reach, step):
    """Weight along an axis, at fine distance `reach`, of the coarse node `step` away."""
    return max(0.0, 1.0 - 0.5 * abs(reach - 2 * step))


@merged_kernel
def _collapse_columns(stencil, entries, fi, fj, ti, tj, begin, size, row, half):
    """Add one fine row's part to the coarse neighbours (dx, dy), still fine along z.

    Those before (0, 0) store their blocks themselves.

    Both buffers are flat, `size` numbers from z = `begin` on for each entry of a block: ``row[3 r +
    c]``, ``half[27 (3 dx + dy) + 9 (dz+1) + 3 r + c]``. So nine short loops are one.
    """
    own = (1.0 - 0.5 * abs(ti)) * (1.0 - 0.5 * abs(tj))
    for flat in range(27):
        di, dj = flat // 9 - 1, (flat // 3) % 3 - 1
        _block_row(stencil, entries, fi, fj, flat, begin, size, row)
        for step_x in range(2):
            for step_y in range(-1 if step_x else 0, 2):
                weight = np.float32(own * _weight(ti + di, step_x) * _weight(tj + dj, step_y))
                if weight > 0.0:
                    first = 27 * (3 * step_x + step_y) + 9 * (flat % 3)
                    start = np.uint64(first * size)
                    for k in range(np.uint64(0), np.uint64(entries * size)):
                        half[start + k] += weight * row[k]


@merged_kernel
def _block_row(stencil, entries, i, j, flat, begin, size, out):
    """Blocks that couple part of a row of nodes to its neighbours `flat` of 27."""
    first = np.uint64(begin)
    for entry in range(entries):
        r, c, start = entry // 3, entry % 3, np.uint64(entry * size)
        if flat >= 13:
            source = stencil[i, j, 9 * (flat - 13) + entry]
            for k in range(np.uint64(0), np.uint64(size)):
                out[start + k] = source[first + k]
        else:
            di, dj, shift = flat // 9 - 1, (flat // 3) % 3 - 1, np.uint64(flat % 3)
            source = stencil[i + di, j + dj, 9 * (13 - flat) + 3 * c + r]
            for k in range(np.uint64(0), np.uint64(size)):
                out[start + k] = source[first + k + shift - _ONE]


@merged_kernel
def _collapse_row(half, entries, begin, end, out):
    """Sum over fine z; store the 14 blocks of one coarse row, ``out[9 o + e, k]``."""
    size = end - begin
    for column in range(5):
        for reach in range(3):
            for step in range(3):
                offset = 3 * column + step - 1
                if offset < 0:
                    continue
                for t in range(-1, 2):
                    weight = np.float32((1.0 - 0.5 * abs(t)) * _weight(t + reach - 1, step - 1))
                    if weight == 0.0:
                        continue
                    lowest, beyond = (begin + 2 - t) // 2, (end + 2 - t) // 2
                    for entry in range(entries):
                        start = (27 * column + 9 * reach + entry) * size - begin
                        target = out[9 * offset + entry]
                        for k in range(lowest, beyond):
                            target[k] += weight * half[start + 2 * k - 1 + t]


@contracting_kernel
def dense_matrix(stencil, number, out):
    """The whole matrix among displacements that have a number of 0 or more, [3, x, y, z]."""
    for i in range(1, number.shape[1] - 1):
        for j in range(1, number.shape[2] - 1):
            for k in range(1, number.shape[3] - 1):
                for entry in range(126):
                    flat, r, c = entry // 9 + 13, (entry // 3) % 3, entry % 3
                    di, dj, dk = flat // 9 - 1, (flat // 3) % 3 - 1, flat % 3 - 1
                    own, other = number[r, i, j, k], number[c, i + di, j + dj, k + dk]
                    if own >= 0 and other >= 0:
                        out[own, other] = stencil[i, j, entry, k]
                        out[other, own] = stencil[i, j, entry, k]
