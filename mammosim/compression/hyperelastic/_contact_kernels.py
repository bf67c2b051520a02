"""Kernels of the contact between the breast's surface and the plates.

Contact is tested at points of the surface: point n moves with element ``cells[n]``, in or beside
which it lies at ``local[n]``, 0 to 1 inside, along each axis. Lengths are in lattice units. A plate
is the rigid solid behind its face, from its edge forward, the edge rounded with a radius; `plates`
is ``[[face z, side], ...]`` with side +1 for the paddle (solid above its face), -1 for the support.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel


SAMPLES = 4
"""Surface points where the fraction passes one half between two cells."""


@contracting_kernel
def count_crossings(fraction, out_layers):
    """Number of neighbouring cells of each layer between which the fraction passes one half."""
    for i in range(fraction.shape[0] - 1):
        count = 0
        for j in range(fraction.shape[1] - 1):
            for k in range(fraction.shape[2] - 1):
                inside = fraction[i, j, k] >= 0.5
                count += inside != (fraction[i + 1, j, k] >= 0.5)
                count += inside != (fraction[i, j + 1, k] >= 0.5)
                count += inside != (fraction[i, j, k + 1] >= 0.5)
        out_layers[i] = count


@contracting_kernel
def surface_points(fraction, out_cells, out_local, out_area, out_normal):
    """Points between neighbouring elements where the tissue fraction passes one half.

    The fraction is taken as linear between the centres of two cells. Each place has `SAMPLES`
    points on the surface's tangent plane, spread along x and z: where the surface is stretched
    around the plates' edge, a single point an element would let it cut through the edge. They
    belong to the cell that is an element, and may lie up to half an edge outside it. A part of the
    surface with normal m has (|m_x| + |m_y| + |m_z|) places a unit of area; `out_area` is a part of
    its inverse.
    """
    count = 0
    for i in range(fraction.shape[0] - 1):
        for j in range(fraction.shape[1] - 1):
            for k in range(fraction.shape[2] - 1):
                for axis in range(3):
                    p, q, r = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    here, there = fraction[i, j, k], fraction[p, q, r]
                    if (here >= 0.5) == (there >= 0.5):
                        continue
                    place = 0.5 + (here - 0.5) / (here - there)
                    inside = here >= 0.5
                    normal = _normal(fraction, i, j, k, p, q, r)
                    total = abs(normal[0]) + abs(normal[1]) + abs(normal[2])
                    for sample in range(SAMPLES):
                        out_cells[count, 0] = i if inside else p
                        out_cells[count, 1] = j if inside else q
                        out_cells[count, 2] = k if inside else r
                        out_local[count, :] = 0.5
                        out_local[count, axis] = place if inside else place - 1.0
                        _spread(out_local[count], normal, axis, sample)
                        for d in range(3):
                            out_normal[count, d] = normal[d]
                        out_area[count] = 1.0 / (max(total, 1.0) * SAMPLES)
                        count += 1


@inlined_kernel
def _spread(local, normal, axis, sample):
    """Move a point on the tangent plane, along the axes of x and z that are not `axis`."""
    along_x = along_z = (sample + 0.5) / SAMPLES - 0.5
    if axis == 0:
        along_x = 0.0
    elif axis == 2:
        along_z = 0.0
    else:  # two by two
        along_x, along_z = 0.5 * (sample // 2) - 0.25, 0.5 * (sample % 2) - 0.25
    steep = max(abs(normal[axis]), 1e-3)
    rise = -(normal[0] * along_x + normal[2] * along_z) / (
        steep if normal[axis] >= 0.0 else -steep
    )
    local[0] += along_x
    local[2] += along_z
    local[axis] = min(max(local[axis] + rise, -0.5), 1.5)


@contracting_kernel
def _normal(fraction, i, j, k, p, q, r):
    """Outward unit normal of the surface, from central differences at two elements."""
    x = y = z = 0.0
    for a, b, c in ((i, j, k), (p, q, r)):
        a0, a1 = max(a - 1, 0), min(a + 1, fraction.shape[0] - 1)
        b0, b1 = max(b - 1, 0), min(b + 1, fraction.shape[1] - 1)
        c0, c1 = max(c - 1, 0), min(c + 1, fraction.shape[2] - 1)
        x -= fraction[a1, b, c] - fraction[a0, b, c]
        y -= fraction[a, b1, c] - fraction[a, b0, c]
        z -= fraction[a, b, c1] - fraction[a, b, c0]
    length = np.sqrt(x * x + y * y + z * z) + 1e-30
    return x / length, y / length, z / length


@inlined_kernel
def depth_in_plate(x, z, face, side, edge, radius):
    """Depth of a place in a plate, and the direction (x, z) of the plate's push on it."""
    centre = edge + radius
    if x >= centre:
        return side * (z - face), 0.0, -side
    ahead = centre - x
    below = radius - side * (z - face)
    if below <= 0.0:
        return x - edge, -1.0, 0.0
    distance = np.sqrt(ahead * ahead + below * below)
    return radius - distance, -ahead / distance, -side * below / distance


@inlined_kernel
def _weight(local, n, corner):
    a = local[n, 0] if corner & 4 else 1.0 - local[n, 0]
    b = local[n, 1] if corner & 2 else 1.0 - local[n, 1]
    c = local[n, 2] if corner & 1 else 1.0 - local[n, 2]
    return a * b * c


@contracting_kernel
def place_points(u, cells, local, out):
    """Present places of the points, (n, 3)."""
    for n in range(cells.shape[0]):
        for d in range(3):
            total = cells[n, d] + local[n, d]
            for corner in range(8):
                i, j, k = cells[n, 0] + corner // 4, cells[n, 1] + (corner // 2) % 2, 0
                k = cells[n, 2] + corner % 2
                total += _weight(local, n, corner) * u[d, i, j, k]
            out[n, d] = total


@contracting_kernel
def contact_pressure(places, plates, edge, radius, stiffness, out_pressure, out_push):
    """Pressure ``max(0, stiffness depth)`` of each plate on each point, and its push.

    `out_pressure` is [plate, n]; `out_push` [plate, n, 2] the direction (x, z) of the push.
    """
    for n in range(places.shape[0]):
        for plate in range(2):
            depth, push_x, push_z = depth_in_plate(
                places[n, 0], places[n, 2], plates[plate, 0], plates[plate, 1], edge, radius
            )
            out_pressure[plate, n] = max(0.0, stiffness * depth)
            out_push[plate, n, 0] = push_x
            out_push[plate, n, 1] = push_z


@contracting_kernel
def add_contact_forces(pressure, push, area, cells, local, out_force):
    """Subtract the plates' forces on the nodes: `out_force` is the energy's derivative."""
    for n in range(cells.shape[0]):
        for plate in range(2):
            size = area[n] * pressure[plate, n]
            if size == 0.0:
                continue
            for corner in range(8):
                i, j = cells[n, 0] + corner // 4, cells[n, 1] + (corner // 2) % 2
                k, share = cells[n, 2] + corner % 2, size * _weight(local, n, corner)
                out_force[0, i, j, k] -= share * push[plate, n, 0]
                out_force[2, i, j, k] -= share * push[plate, n, 1]


@contracting_kernel
def add_contact_stiffness(pressure, push, area, stiffness, cells, local, out_stencil):
    """Add the stiffness of the points in contact, along the direction of the push."""
    for n in range(cells.shape[0]):
        for plate in range(2):
            if pressure[plate, n] == 0.0:
                continue
            x, z = push[plate, n, 0], push[plate, n, 1]
            for node in range(8):
                i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
                k, own = cells[n, 2] + node % 2, _weight(local, n, node) * stiffness * area[n]
                for other in range(node, 8):
                    offset = (
                        9 * (other // 4 - node // 4)
                        + 3 * ((other // 2) % 2 - (node // 2) % 2)
                        + other % 2 - node % 2
                    )  # fmt: skip
                    both = own * _weight(local, n, other)
                    out_stencil[i, j, 9 * offset, k] += both * x * x
                    out_stencil[i, j, 9 * offset + 2, k] += both * x * z
                    out_stencil[i, j, 9 * offset + 6, k] += both * x * z
                    out_stencil[i, j, 9 * offset + 8, k] += both * z * z
