"""Slow, plain twins of the spring lattice's kernels, straight from the model's definition."""

from __future__ import annotations

from itertools import product

import numpy as np

NEIGHBOURS = [offset for offset in product((-1, 0, 1), repeat=3) if any(offset)]


def stiffness(modulus: np.ndarray, n: tuple, m: tuple) -> float:
    return float(min(modulus[n], modulus[m]))


def cell_stretch(modulus: np.ndarray, z: np.ndarray, cell: tuple) -> float | None:
    i, j, k = cell
    edges = []
    for a, b in product((0, 1), repeat=2):
        low, high = (i + a, j + b, k), (i + a, j + b, k + 1)
        if modulus[low] > 0 and modulus[high] > 0:
            edges.append(z[high] - z[low])
    return 1.0 / np.sqrt(max(np.mean(edges), 0.1)) if edges else None


def equilibrium_length(modulus: np.ndarray, z: np.ndarray, n: tuple, offset: tuple) -> np.ndarray:
    """(Dx, Dy, Dz) of the spring from n to n + offset."""
    m = tuple(np.add(n, offset))
    shared = []
    for cell in product(*[(index - 1, index) for index in n]):
        corners = set(product(*[(c, c + 1) for c in cell]))
        if n in corners and m in corners:
            stretch = cell_stretch(modulus, z, cell)
            if stretch is not None:
                shared.append(stretch)
    mean = np.mean(shared) if shared else 1.0
    return np.array([offset[0] * mean, offset[1] * mean, offset[2]])


def stiffened(modulus, stiffening, n: tuple, m: tuple, strain: float) -> tuple[float, float]:
    """Stiffness of a strained spring, and how much steeper than that its force is per strain."""
    grown = [(modulus[a] * np.exp(stiffening[a] * min(strain, 0.6)), stiffening[a]) for a in (n, m)]
    softer = min(grown, key=lambda pair: pair[0])
    return float(softer[0]), float(softer[1])


def spring_force(
    modulus, stiffening, places, n: tuple, offset: tuple
) -> tuple[np.ndarray, np.ndarray]:
    """Force of the spring from n to n + offset on n, and its slope along each axis."""
    m = tuple(np.add(n, offset))
    if modulus[m] == 0.0:
        return np.zeros(3), np.zeros(3)
    gap = places[(slice(None), *m)] - places[(slice(None), *n)]
    length = equilibrium_length(modulus, places[2], n, offset)
    if stiffening is None:
        w = stiffness(modulus, n, m)
        return w * (gap - length), np.full(3, w)
    reach, at_rest = np.linalg.norm(gap), np.linalg.norm(length)
    w, rise = stiffened(modulus, stiffening, n, m, abs(reach / at_rest - 1.0))
    return w * (gap - length), w + w * rise * np.abs(gap * (gap - length)) / (reach * at_rest)


def net_force(modulus: np.ndarray, places: np.ndarray, n: tuple, stiffening=None) -> np.ndarray:
    """Net force on node n; `places` is [component, x, y, z]."""
    return sum(spring_force(modulus, stiffening, places, n, offset)[0] for offset in NEIGHBOURS)


def foremost(problem, z: float) -> float:
    """Largest x at height z that is not within a plate whose edge is rounded."""
    r, beyond = problem.edge_radius, max(z - problem.upper, problem.lower - z)
    if beyond <= 0.0:
        return np.inf
    # The rounding is a quarter of a circle about (edge + r, face + r).
    return problem.edge + r - np.sqrt(r**2 - max(r - beyond, 0.0) ** 2)


def sweep(problem, places, orders, stiffening=None, force=(None,) * 3) -> np.ndarray:
    """The thesis' sweep, in place; returns the summed |dx|, |dy|, |dz| and their number."""
    modulus, sums = problem.modulus, np.zeros(4)
    for n in product(*orders):
        if modulus[n] == 0 or problem.fixed[n]:
            continue
        pulls = [spring_force(modulus, stiffening, places, n, offset) for offset in NEIGHBOURS]
        total = sum(pull for pull, _ in pulls)
        outer = np.array([0.0 if field is None else field[n] for field in force])
        move = (total + outer) / (modulus[n] + sum(slope for _, slope in pulls))
        x, y, z = (places[(axis, *n)] + move[axis] for axis in range(3))
        between = n[0] > problem.edge
        if between:
            z = np.clip(z, problem.lower, problem.upper)
        else:
            x = min(x, foremost(problem, z))
        places[(slice(None), *n)] = max(x, 1.0), y, z
        if between and problem.lower < z < problem.upper:
            sums += [*np.abs(move), 1.0]
    return sums
