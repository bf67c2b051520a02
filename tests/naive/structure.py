"""Slow, plain twins of skin, fibres and the corners of surface cells, from their definitions."""

from __future__ import annotations

import numpy as np
from scipy import integrate, optimize


def gradients(u, membrane):
    """(n, 3, 2) deformation gradient of each patch."""
    out = []
    for cell, slope, tangents in zip(
        membrane.cells, membrane.gradients, membrane.tangents, strict=True
    ):
        gradient = tangents.T.copy()
        for node in range(8):
            corner = (node // 4, (node // 2) % 2, node % 2)
            gradient += np.outer(u[(slice(None), *np.add(cell, corner))], slope[node])
        out.append(gradient)
    return np.array(out)


def sheet_energy(longer, wider, stiffening=0.0):
    """(I + b I^2 / 2) / 2 of the width that costs least and is not exceeded.

    I = l1^2 + l2^2 + 1 / (l1 l2)^2 - 3.
    """

    def taut(first, second):
        size = first**2 + second**2 + 1.0 / (first * second) ** 2 - 3.0
        return 0.5 * (size + 0.5 * stiffening * size**2)

    if longer <= 1.0:
        return 0.0
    best = optimize.minimize_scalar(
        lambda width: taut(longer, width), bounds=(1e-3, longer), method="bounded",
        options={"xatol": 1e-12},
    ).x  # fmt: skip
    return taut(longer, max(wider, best))


def stretches(gradient):
    """Larger and smaller stretch."""
    return np.linalg.svd(gradient, compute_uv=False)


def states(u, membrane):
    """Slack, wrinkled or taut: each patch."""
    names = []
    for gradient in gradients(u, membrane):
        longer, wider = stretches(gradient)
        names.append("slack" if longer <= 1 else "taut" if wider > longer**-0.5 else "wrinkled")
    return names


def membrane_energy(u, membrane):
    """Energy of all patches."""
    return sum(
        stiffness * sheet_energy(*stretches(gradient), membrane.stiffening)
        for stiffness, gradient in zip(membrane.stiffness, gradients(u, membrane), strict=True)
    )


def fibre_energy(u, fibres):
    """Energy of all fibres: k (L - 1)^2 / 2, taking hold over 0.015 of stretch."""
    total = 0.0
    for cell, direction, stiffness in zip(
        fibres.cells, fibres.direction, fibres.stiffness, strict=True
    ):
        gradient = np.eye(3)
        for corner in np.ndindex(2, 2, 2):
            slope = 0.25 * (2.0 * np.array(corner) - 1.0)  # of a trilinear function, at the centre
            gradient += np.outer(u[(slice(None), *np.add(cell, corner))], slope)
        stretch = np.linalg.norm(gradient @ direction)
        curvature = integrate.quad(  # W'' rises from 0 to 1: W by two integrations
            lambda s, end=stretch: (end - s) * min(max(s - 1.0, 0.0) / 0.015, 1.0),
            1.0, max(stretch, 1.0), points=[1.015] if stretch > 1.015 else None,
            epsabs=1e-14, epsrel=1e-13,
        )[0]  # fmt: skip
        total += stiffness * curvature
    return total


def corner_energy(u, cells):
    """Half the stiffness times q + 4 q^2 / 2, q the square of what is no uniform deformation."""
    corners = np.array(list(np.ndindex(2, 2, 2)))
    uniform = np.column_stack([np.ones(8), corners])
    total = 0.0
    for cell, stiffness in zip(cells.cells, cells.stiffness, strict=True):
        moved = np.array([u[(slice(None), *(cell + corner))] for corner in corners])
        best, *_ = np.linalg.lstsq(uniform, moved, rcond=None)
        left = np.sum((moved - uniform @ best) ** 2)
        total += 0.5 * stiffness * (left + 2.0 * left**2)
    return total


def force_of(energy, u, cells, step=1e-6):
    """Derivative of an energy by each displacement that its cells hold, by central differences."""
    force = np.zeros_like(u)
    for place in np.ndindex(u.shape):
        if not any(
            all(c <= n <= c + 1 for c, n in zip(cell, place[1:], strict=True)) for cell in cells
        ):
            continue
        moved = u.copy()
        moved[place] += step
        ahead = energy(moved)
        moved[place] -= 2.0 * step
        force[place] = (ahead - energy(moved)) / (2.0 * step)
    return force


def membrane_force(u, membrane, step=1e-6):
    """Derivative of the membrane's energy by each displacement."""
    return force_of(lambda moved: membrane_energy(moved, membrane), u, membrane.cells, step)
