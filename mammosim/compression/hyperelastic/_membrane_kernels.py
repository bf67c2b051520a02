"""Kernels of the skin: a membrane on the breast's surface that carries tension only.

Surface point n stands for a patch of the membrane. ``gradients[n, a]`` is the derivative of the
shape function of its element's node a along two orthogonal tangents of the surface, so that the
membrane's deformation gradient is ``F = tangents + sum_a u_a gradients[n, a]``, 3 x 2, its columns
f and g. Lengths are in lattice units; ``stiffness[n]`` is shear modulus times thickness times area.

The energy is ``stiffness / 2 (I + stiffening I^2 / 2)``, where I is that of a relaxed neo-Hookean
membrane (Pipkin 1986, IMA J Appl Math 36:85-99): zero where it is slack, that of uniaxial tension
where it wrinkles, ``|F|^2 + 1 / det C - 3`` where it is taut. I is convex in F, and so is the
energy.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel
from mammosim.compression.hyperelastic._corner_kernels import neighbour

SLACK, WRINKLED, TAUT = 0, 1, 2
"""State of the membrane at a point."""


@inlined_kernel
def _columns(u, cells, gradients, tangents, n):
    """Columns of the membrane's deformation gradient at a point."""
    f0, f1, f2 = tangents[n, 0, 0], tangents[n, 0, 1], tangents[n, 0, 2]
    g0, g1, g2 = tangents[n, 1, 0], tangents[n, 1, 1], tangents[n, 1, 2]
    for node in range(8):
        i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
        k, a, b = cells[n, 2] + node % 2, gradients[n, node, 0], gradients[n, node, 1]
        f0 += a * u[0, i, j, k]
        f1 += a * u[1, i, j, k]
        f2 += a * u[2, i, j, k]
        g0 += b * u[0, i, j, k]
        g1 += b * u[1, i, j, k]
        g2 += b * u[2, i, j, k]
    return (f0, f1, f2), (g0, g1, g2)


@inlined_kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined_kernel
def _strain(f, g):
    """C = F^T F and its eigenvalues: ``c_ff, c_fg, c_gg, larger, smaller``."""
    ff, fg, gg = _dot(f, f), _dot(f, g), _dot(g, g)
    mean, half = 0.5 * (ff + gg), 0.5 * (ff - gg)
    radius = np.sqrt(half * half + fg * fg)
    return ff, fg, gg, mean + radius, max(mean - radius, 0.0)


@inlined_kernel
def _state(larger, smaller):
    """Slack where no stretch passes 1, wrinkled where the width is below its natural one."""
    if larger <= 1.0:
        return SLACK
    return TAUT if smaller * smaller * larger >= 1.0 else WRINKLED


@inlined_kernel
def _direction(ff, fg, gg, larger):
    """Unit eigenvector (c, s) of C that belongs to its larger eigenvalue."""
    if ff >= gg:
        x, y = larger - gg, fg
    else:
        x, y = fg, larger - ff
    size = np.sqrt(x * x + y * y)
    if size < 1e-12:
        return 1.0, 0.0
    return x / size, y / size


@inlined_kernel
def _stretched(state, ff, fg, gg, larger):
    """I of a membrane that is not slack, and half its derivative by C: ``own_f, both, own_g``."""
    if state == TAUT:
        inverse = 1.0 / (ff * gg - fg * fg)
        square = inverse * inverse
        return ff + gg + inverse - 3.0, 1.0 - square * gg, square * fg, 1.0 - square * ff
    root = 1.0 / np.sqrt(larger)
    c, s = _direction(ff, fg, gg, larger)
    pull = 1.0 - root * root * root
    return larger + 2.0 * root - 3.0, pull * c * c, pull * c * s, pull * s * s


@contracting_kernel
def membrane_forces(u, cells, gradients, tangents, stiffness, stiffening, out_force):
    """Add the energy's derivative by each node's displacement to `out_force`; the energy."""
    energy = 0.0
    for n in range(cells.shape[0]):
        f, g = _columns(u, cells, gradients, tangents, n)
        ff, fg, gg, larger, smaller = _strain(f, g)
        state = _state(larger, smaller)
        if state == SLACK:
            continue
        size, own_f, both, own_g = _stretched(state, ff, fg, gg, larger)
        energy += 0.5 * stiffness[n] * size * (1.0 + 0.5 * stiffening * size)
        tension = stiffness[n] * (1.0 + stiffening * size)
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k, a, b = cells[n, 2] + node % 2, gradients[n, node, 0], gradients[n, node, 1]
            along_f = tension * (own_f * a + both * b)
            along_g = tension * (both * a + own_g * b)
            for d in range(3):
                out_force[d, i, j, k] += along_f * f[d] + along_g * g[d]
    return energy


@inlined_kernel
def _taut_blocks(f, g, ff, fg, gg, out):
    """Half the second derivative of I by the columns of a taut membrane.

    With D = det C: ``I = |f|^2 + |g|^2 + 1 / D - 3``, and ``I'' / 2 = 1 + D'D'^T / D^3 - D'' / (2
    D^2)``.
    """
    inverse = 1.0 / (ff * gg - fg * fg)
    p, q = inverse * inverse * inverse, inverse * inverse
    for r in range(3):
        x, y = 2.0 * (gg * f[r] - fg * g[r]), 2.0 * (ff * g[r] - fg * f[r])
        for c in range(3):
            v, w = 2.0 * (gg * f[c] - fg * g[c]), 2.0 * (ff * g[c] - fg * f[c])
            one = 1.0 if r == c else 0.0
            out[0, r, c] = one + p * x * v - q * (gg * one - g[r] * g[c])
            out[1, r, c] = p * x * w - q * (2.0 * f[r] * g[c] - g[r] * f[c] - fg * one)
            out[2, r, c] = one + p * y * w - q * (ff * one - f[r] * f[c])


@inlined_kernel
def _wrinkled_blocks(f, g, ff, fg, gg, larger, smaller, out):
    """Half the second derivative of a wrinkled membrane's ``I = L + 2 / sqrt(L) - 3``.

    Along its eigenvectors v and w, L = |F v|^2 has the derivatives 2 Fv and, beside that of |F v|^2
    at fixed v, the turning of v: 2 (v^T dC w)^2 / (L - S).
    """
    c, s = _direction(ff, fg, gg, larger)
    root = 1.0 / np.sqrt(larger)
    pull, change = 1.0 - root * root * root, 3.0 * root**5
    turn = pull / max(larger - smaller, 1e-9)
    for r in range(3):
        along, across = c * f[r] + s * g[r], c * g[r] - s * f[r]
        for e in range(3):
            ahead, aside = c * f[e] + s * g[e], c * g[e] - s * f[e]
            one = 1.0 if r == e else 0.0
            vv = pull * one + change * along * ahead + turn * across * aside
            vw, wv, ww = turn * across * ahead, turn * along * aside, turn * along * ahead
            out[0, r, e] = c * c * vv - c * s * (vw + wv) + s * s * ww
            out[1, r, e] = c * s * vv + c * c * vw - s * s * wv - c * s * ww
            out[2, r, e] = s * s * vv + c * s * (vw + wv) + c * c * ww


@inlined_kernel
def _stiffen(f, g, size, own_f, both, own_g, stiffening, out):
    """From ``I'' / 2`` to the energy's second derivative, ``(1 + b I) I'' / 2 + b I'I'^T / 2``."""
    factor, twice = 1.0 + stiffening * size, 2.0 * stiffening
    for r in range(3):
        along_f, along_g = own_f * f[r] + both * g[r], both * f[r] + own_g * g[r]
        for c in range(3):
            ahead_f, ahead_g = own_f * f[c] + both * g[c], both * f[c] + own_g * g[c]
            out[0, r, c] = factor * out[0, r, c] + twice * along_f * ahead_f
            out[1, r, c] = factor * out[1, r, c] + twice * along_f * ahead_g
            out[2, r, c] = factor * out[2, r, c] + twice * along_g * ahead_g


@contracting_kernel
def add_membrane_stiffness(u, cells, gradients, tangents, stiffness, stiffening, out_stencil):
    """Add the second derivative of the energy to a block stencil."""
    blocks = np.empty((3, 3, 3))
    for n in range(cells.shape[0]):
        f, g = _columns(u, cells, gradients, tangents, n)
        ff, fg, gg, larger, smaller = _strain(f, g)
        state = _state(larger, smaller)
        if state == SLACK:
            continue
        if state == TAUT:
            _taut_blocks(f, g, ff, fg, gg, blocks)
        else:
            _wrinkled_blocks(f, g, ff, fg, gg, larger, smaller, blocks)
        _stiffen(f, g, *_stretched(state, ff, fg, gg, larger), stiffening, blocks)
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k, a, b = cells[n, 2] + node % 2, gradients[n, node, 0], gradients[n, node, 1]
            a, b = stiffness[n] * a, stiffness[n] * b
            for other in range(node, 8):
                offset = neighbour(node, other)
                p, q = gradients[n, other, 0], gradients[n, other, 1]
                for r in range(3):
                    for c in range(3):
                        out_stencil[i, j, 9 * offset + 3 * r + c, k] += (
                            a * p * blocks[0, r, c]
                            + a * q * blocks[1, r, c]
                            + b * p * blocks[1, c, r]
                            + b * q * blocks[2, r, c]
                        )
