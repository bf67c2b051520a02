"""Slow, plain twins of the kernels of elements, contact and block stencils."""

from __future__ import annotations

from itertools import product

import numpy as np

CORNERS = list(product((0, 1), repeat=3))
OFFSETS = [offset for offset in product((-1, 0, 1), repeat=3) if offset >= (0, 0, 0)]
"""The 14 neighbours that a stencil stores, the node itself first."""


# --- elements ---------------------------------------------------------------------------------


def continued(function, slope, curvature, volume, least):
    """A function of J, below `least` its own parabola; J may be complex."""
    if volume.real >= least:
        return function(volume)
    below = volume - least
    return function(least) + below * (slope(least) + 0.5 * below * curvature(least))


def neo_hookean(invariant, volume, shear, least):
    """mu/2 (J^(-2/3) I1 - 3)."""
    factor = continued(
        lambda j: j ** (-2 / 3),
        lambda j: -2 / 3 * j ** (-5 / 3),
        lambda j: 10 / 9 * j ** (-8 / 3),
        volume, least,
    )  # fmt: skip
    return 0.5 * shear * (factor * invariant - 3.0)


LAWS = {"neo_hookean": neo_hookean}
"""Energy of each law, by its name in the package's table."""


def gradients(nodes):
    """Deformation gradient at the eight corners and at the centre; `nodes` is [2, 2, 2, 3]."""
    found = []
    for a, b, c in CORNERS:
        edges = (
            nodes[1, b, c] - nodes[0, b, c],
            nodes[a, 1, c] - nodes[a, 0, c],
            nodes[a, b, 1] - nodes[a, b, 0],
        )
        found.append(np.stack(edges, axis=1))
    return [*found, sum(found) / 8.0]


def element_energy(nodes, shear, bulk, rule, law):
    """Energy of one element of unit edges, and the smallest J of its nine points."""
    points = gradients(nodes)
    volumes = [np.linalg.det(point) for point in points]
    parts = [1 / 24] * 8 + [2 / 3]
    weights = [rule.corner_weight] * 8 + [1.0 - 8.0 * rule.corner_weight]
    mean = sum(part * volume for part, volume in zip(parts, volumes, strict=True))
    local = rule.local_part * shear
    energy = 0.5 * (bulk - local) * (mean - 1.0) ** 2
    for gradient, volume, part, weight in zip(points, volumes, parts, weights, strict=True):
        energy += weight * law((gradient * gradient).sum(), volume, shear, rule.least_volume)
        energy += part * local * continued(
            lambda j: (j - 1) ** 2 / (2 * j), lambda j: 0.5 - 0.5 / j**2, lambda j: j**-3.0,
            volume, rule.least_volume,
        )  # fmt: skip
    return energy, mean, min(volume.real for volume in volumes)


def element_nodes(u, cell):
    """Present places [2, 2, 2, 3] of the nodes of an element."""
    places = np.array(np.indices(u.shape[1:]) + u)
    return np.stack([places[(slice(None), *np.add(cell, corner))] for corner in CORNERS]).reshape(
        2, 2, 2, 3
    )


def element_force(nodes, shear, bulk, rule, law):
    """Derivative of an element's energy by its nodes, by complex steps: exact to rounding."""
    force = np.zeros(nodes.shape)
    for index in np.ndindex(nodes.shape):
        moved = nodes.astype(complex)
        moved[index] += 1e-30j
        force[index] = element_energy(moved, shear, bulk, rule, law)[0].imag / 1e-30
    return force


def body_energy_and_forces(u, shear, bulk, rule, law):
    """Energy, smallest J, and derivative by each node's displacement, [3, x, y, z]."""
    total, least, force = 0.0, np.inf, np.zeros(u.shape)
    for cell in map(tuple, np.argwhere(shear > 0)):
        nodes, moduli = element_nodes(u, cell), (float(shear[cell]), float(bulk[cell]))
        energy, _, smallest = element_energy(nodes, *moduli, rule, law)
        total, least = total + energy, min(least, smallest)
        pull = element_force(nodes, *moduli, rule, law)
        for corner in CORNERS:
            force[(slice(None), *np.add(cell, corner))] += pull[corner]
    return total, least, force


def body_tangent(u, shear, bulk, rule, law, step=1e-6):
    """Second derivative of the energy, [3 n, 3 n], by central differences of the forces."""
    size, flat = u.size, np.arange(u.size).reshape(u.shape)
    matrix = np.zeros((size, size))
    for cell in map(tuple, np.argwhere(shear > 0)):
        nodes, moduli = element_nodes(u, cell), (float(shear[cell]), float(bulk[cell]))
        at = [flat[(slice(None), *np.add(cell, corner))] for corner in CORNERS]
        where = np.stack(at).reshape(nodes.shape)
        for index in np.ndindex(nodes.shape):
            moved = np.zeros(nodes.shape)
            moved[index] = step
            ahead, behind = (
                element_force(nodes + sign * moved, *moduli, rule, law) for sign in (1, -1)
            )
            matrix[where.ravel(), where[index]] += ((ahead - behind) / (2 * step)).ravel()
    return matrix


# --- block stencils ---------------------------------------------------------------------------


def dense(stencil):
    """The whole matrix of a block stencil [x, y, 126, z], among [3, x, y, z]."""
    nx, ny, _, nz = stencil.shape
    number = np.arange(3 * nx * ny * nz).reshape(3, nx, ny, nz)
    matrix = np.zeros((number.size, number.size))
    for n in np.ndindex(nx, ny, nz):
        for o, offset in enumerate(OFFSETS):
            m = tuple(np.add(n, offset))
            if any(not 0 <= index < size for index, size in zip(m, (nx, ny, nz), strict=True)):
                continue
            block = stencil[n[0], n[1], 9 * o : 9 * o + 9, n[2]].reshape(3, 3)
            own, other = number[(slice(None), *n)], number[(slice(None), *m)]
            matrix[np.ix_(own, other)] = block
            if o > 0:
                matrix[np.ix_(other, own)] = block.T
    return matrix


def interpolation(fine, coarse):
    """Matrix of the trilinear interpolation of a scalar; coarse node J lies on fine 2 J - 1."""
    matrix = np.zeros((int(np.prod(fine)), int(np.prod(coarse))))
    for row, n in enumerate(np.ndindex(*fine)):
        for column, m in enumerate(np.ndindex(*coarse)):
            inside = all(
                0 < i < size - 1 for i, size in zip((*n, *m), (*fine, *coarse), strict=True)
            )
            if inside:
                away = np.abs(np.array(n) - (2 * np.array(m) - 1))
                matrix[row, column] = np.prod(np.maximum(0.0, 1.0 - 0.5 * away))
    return matrix


def inverse_block(block):
    """Inverse among the displacements that have stiffness; of the row sums if not definite."""
    inverse, has = np.zeros((3, 3)), np.diag(block) != 0.0
    part = block[np.ix_(has, has)]
    if has.any():
        if np.linalg.eigvalsh(part).min() <= 0.0:
            part = np.diag(np.abs(part).sum(axis=1))
        inverse[np.ix_(has, has)] = np.linalg.inv(part)
    return inverse


# --- contact ----------------------------------------------------------------------------------


def straight_distance(plate, x, y, z):
    """Signed distance from a straight plate: a quarter plane with a rounded corner."""
    away = plate.radius - np.array([x - plate.edge, plate.side * (z - plate.face)])
    return np.hypot(*np.maximum(away, 0.0)) + min(away.max(), 0.0) - plate.radius


def panel_distance(plate, x, y, z):
    """Signed distance from a box without a top, rounded and turned about the hinge in its face."""
    turn = np.array([[plate.cosine, -plate.sine], [plate.sine, plate.cosine]])
    ahead, inwards = turn @ [x - plate.hinge, plate.side * (z - plate.face)]
    x = plate.hinge + ahead
    inside = np.array([x - plate.back, plate.front - x, y - plate.low, plate.high - y, inwards])
    away = plate.radius - np.array([inside[:2].min(), inside[2:4].min(), inwards])
    return np.linalg.norm(np.maximum(away, 0.0)) + min(away.max(), 0.0) - plate.radius


def normal(distance, plate, place, step=1e-6):
    """Outward normal of a solid: the gradient of its signed distance."""
    place = np.asarray(place)
    return np.array(
        [
            (distance(plate, *(place + step * e)) - distance(plate, *(place - step * e)))
            / (2 * step)
            for e in np.eye(3)
        ]
    )


def weights(local):
    """Trilinear weights of the eight corners at each point, [n, 8]."""
    return np.stack(
        [np.where(corner, local, 1.0 - local).prod(axis=1) for corner in CORNERS], axis=1
    )


def surface_points(fraction, samples, dense_samples):
    """Cells, local places, areas and normals of the points where the fraction passes one half."""
    rows = []
    for n in np.ndindex(*(size - 1 for size in fraction.shape)):
        for axis in range(3):
            m = tuple(np.add(n, np.eye(3, dtype=int)[axis]))
            here, there = float(fraction[n]), float(fraction[m])
            if (here >= 0.5) == (there >= 0.5):
                continue
            inside = here >= 0.5
            crossing = 0.5 + (here - 0.5) / (here - there)  # from the low face of cell n
            outward = _mean_normal(fraction, n, m)
            count = dense_samples if samples[n[0]] > 1 else 1
            slopes = {d: 0.0 if d == axis else _slope(fraction, n, axis, d) for d in (0, 2)}
            steep = max(1.0, *(abs(slope) for slope in slopes.values()))
            for sample in range(count):
                local = np.full(3, 0.5)
                local[axis] = crossing - (0.0 if inside else 1.0)
                for d, along in _spread(axis, sample, count).items():
                    local[d] += along / steep
                    local[axis] += (1.0 if inside else -1.0) * slopes[d] * along / steep
                area = 1.0 / (max(np.abs(outward).sum(), 1.0) * count)
                rows.append(((n if inside else m), local, area, outward))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def _spread(axis, sample, count):
    """Distance along x and z of one of the points on a face across `axis`."""
    if count == 1:
        return {}
    along = (sample + 0.5) / count - 0.5
    if axis == 1:
        return {0: (-0.25, 0.25)[sample // 2], 2: (-0.25, 0.25)[sample % 2]}
    return {2: along} if axis == 0 else {0: along}


def _slope(fraction, n, axis, along):
    """Slope of the surface's height: the smaller of both sides', 0 where they differ in sign."""
    low, here, high = (_height(fraction, np.add(n, k * np.eye(3, dtype=int)[along]), axis)
                       for k in (-1, 0, 1))  # fmt: skip
    behind, ahead = here - low, high - here
    return 0.0 if ahead * behind <= 0.0 else np.sign(ahead) * min(abs(ahead), abs(behind))


def _height(fraction, n, axis):
    """Sum of the fractions of six cells around a crossing."""
    cells = [np.add(n, d * np.eye(3, dtype=int)[axis]) for d in range(-2, 4)]
    return sum(_fraction_at(fraction, cell) for cell in cells)


def _mean_normal(fraction, *cells):
    """Unit vector down the gradient of the fraction, summed over two cells."""
    total = np.zeros(3)
    for cell in cells:
        for d, e in enumerate(np.eye(3, dtype=int)):
            ahead, behind = (_fraction_at(fraction, np.add(cell, k * e)) for k in (1, -1))
            total[d] -= ahead - behind
    return total / np.linalg.norm(total)


def _fraction_at(fraction, cell):
    """Fraction of a cell, the nearest one at the border."""
    return float(fraction[tuple(np.clip(cell, 0, np.array(fraction.shape) - 1))])
