"""Slow, plain twin of the skin's membrane, from its definition."""

from __future__ import annotations

import numpy as np
from scipy import optimize


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


def sheet_energy(longer, wider):
    """(l1^2 + l2^2 + 1 / (l1 l2)^2 - 3) / 2 of the width that costs least and is not exceeded."""

    def taut(first, second):
        return 0.5 * (first**2 + second**2 + 1.0 / (first * second) ** 2 - 3.0)

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
        stiffness * sheet_energy(*stretches(gradient))
        for stiffness, gradient in zip(membrane.stiffness, gradients(u, membrane), strict=True)
    )


def membrane_force(u, membrane, step=1e-6):
    """Derivative of the energy by each displacement, by central differences."""
    force = np.zeros_like(u)
    for place in np.ndindex(u.shape):
        if not any(
            all(c <= n <= c + 1 for c, n in zip(cell, place[1:], strict=True))
            for cell in membrane.cells
        ):
            continue
        moved = u.copy()
        moved[place] += step
        ahead = membrane_energy(moved, membrane)
        moved[place] -= 2.0 * step
        force[place] = (ahead - membrane_energy(moved, membrane)) / (2.0 * step)
    return force
