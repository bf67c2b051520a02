"""Kernels of the contact between the breast's surface and the plates.

Contact is tested at points of the surface: point n moves with element ``cells[n]``, in or beside
which it lies at ``local[n]``, 0 to 1 inside, along each axis. Lengths are in lattice units. A plate
is a rigid solid of any shape that `depth_in_plate` knows.
"""

import numpy as np

from mammosim._jit import contracting_kernel, inlined_kernel
from mammosim.compression.hyperelastic._corner_kernels import neighbour
from mammosim.compression.plates._plate_kernels import depth_in_plate

SAMPLES = 4
"""Surface points near the plates' edge where the fraction passes one half between two cells."""

CURVATURE_STEP = 1e-4
"""Distance, lattice units, over which a plate's normal is compared to find its curvature."""


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
def surface_points(fraction, samples, out_cells, out_local, out_area, out_normal):
    """Points between neighbouring elements where the tissue fraction passes one half.

    The fraction is taken as linear between the centres of two cells. Each place of layer i has
    ``samples[i]`` points, 1 or `SAMPLES`, spread along x and z on the surface's slope. They belong
    to the cell that is an element, and may lie an edge outside it. A part of the surface with
    normal m has (|m_x| + |m_y| + |m_z|) places a unit of area; `out_area` is a part of its inverse.
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
                    slope_x = 0.0 if axis == 0 else _slope(fraction, i, j, k, axis, 0)
                    slope_z = 0.0 if axis == 2 else _slope(fraction, i, j, k, axis, 2)
                    outward = 1.0 if inside else -1.0
                    steep = max(1.0, abs(slope_x), abs(slope_z))
                    for sample in range(samples[i]):
                        out_cells[count, 0] = i if inside else p
                        out_cells[count, 1] = j if inside else q
                        out_cells[count, 2] = k if inside else r
                        out_local[count, :] = 0.5
                        out_local[count, axis] = place if inside else place - 1.0
                        along_x, along_z = _spread(axis, sample, samples[i])
                        along_x, along_z = along_x / steep, along_z / steep
                        out_local[count, 0] += along_x
                        out_local[count, 2] += along_z
                        out_local[count, axis] += outward * (slope_x * along_x + slope_z * along_z)
                        for d in range(3):
                            out_normal[count, d] = normal[d]
                        out_area[count] = 1.0 / (max(total, 1.0) * samples[i])
                        count += 1


@inlined_kernel
def _spread(axis, sample, samples):
    """Distance of a point from the middle of its place, along x and z but not along `axis`."""
    if samples == 1:
        return 0.0, 0.0
    along = (sample + 0.5) / SAMPLES - 0.5
    if axis == 0:
        return 0.0, along
    if axis == 2:
        return along, 0.0
    return 0.5 * (sample // 2) - 0.25, 0.5 * (sample % 2) - 0.25


@inlined_kernel
def _slope(fraction, i, j, k, axis, along):
    """Slope of the surface's height over `axis` along x or z; the smaller of both sides'.

    It is 0 at a crest and at a sharp edge.
    """
    step_i, step_k = int(along == 0), int(along == 2)
    here = _height(fraction, i, j, k, axis)
    ahead = _height(fraction, i + step_i, j, k + step_k, axis) - here
    behind = here - _height(fraction, i - step_i, j, k - step_k, axis)
    if ahead * behind <= 0.0:
        return 0.0
    smaller = min(abs(ahead), abs(behind))
    return smaller if ahead > 0.0 else -smaller


@inlined_kernel
def _height(fraction, i, j, k, axis):
    """Sum of the fractions along `axis` over three cells on each side of where it passes a half."""
    total = 0.0
    for d in range(-2, 4):
        p = min(max(i + (d if axis == 0 else 0), 0), fraction.shape[0] - 1)
        q = min(max(j + (d if axis == 1 else 0), 0), fraction.shape[1] - 1)
        r = min(max(k + (d if axis == 2 else 0), 0), fraction.shape[2] - 1)
        total += fraction[p, q, r]
    return total


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
def plate_depth(places, plate, out_depth, out_normal):
    """Depth of each place in a plate, [n], negative outside, and its outward normal, [n, 3]."""
    for n in range(places.shape[0]):
        depth, normal_x, normal_y, normal_z = depth_in_plate(
            plate, places[n, 0], places[n, 1], places[n, 2]
        )
        out_depth[n] = depth
        out_normal[n, 0] = normal_x
        out_normal[n, 1] = normal_y
        out_normal[n, 2] = normal_z


@contracting_kernel
def add_contact_forces(pressure, push, area, cells, local, out_force):
    """Subtract the plates' forces on the nodes: `out_force` is the energy's derivative."""
    for n in range(cells.shape[0]):
        for plate in range(pressure.shape[0]):
            size = area[n] * pressure[plate, n]
            if size == 0.0:
                continue
            for corner in range(8):
                i, j = cells[n, 0] + corner // 4, cells[n, 1] + (corner // 2) % 2
                k, share = cells[n, 2] + corner % 2, size * _weight(local, n, corner)
                for d in range(3):
                    out_force[d, i, j, k] -= share * push[plate, n, d]


@contracting_kernel
def add_contact_blocks(places, plate, stiffness, geometric, out_blocks):
    """Add the second derivative of each point's contact energy by its place, xx xy xz yy yz zz.

    With the pressure p, the stiffness k, the plate's outward normal n: ``k n n^T - p grad n``. The
    last term, which a rounded edge has and which may be negative, is scaled by `geometric`.
    """
    gradient = np.empty((3, 3))
    for point in range(places.shape[0]):
        x, y, z = places[point, 0], places[point, 1], places[point, 2]
        depth, nx, ny, nz = depth_in_plate(plate, x, y, z)
        if depth <= 0.0:
            continue
        for axis in range(3):
            a = CURVATURE_STEP if axis == 0 else 0.0
            b = CURVATURE_STEP if axis == 1 else 0.0
            c = CURVATURE_STEP if axis == 2 else 0.0
            _, gx, gy, gz = depth_in_plate(plate, x + a, y + b, z + c)
            _, hx, hy, hz = depth_in_plate(plate, x - a, y - b, z - c)
            half = 0.5 / CURVATURE_STEP
            gradient[axis, 0] = half * (gx - hx)
            gradient[axis, 1] = half * (gy - hy)
            gradient[axis, 2] = half * (gz - hz)
        pressure = geometric * stiffness * depth
        out_blocks[point, 0] += stiffness * nx * nx - pressure * gradient[0, 0]
        out_blocks[point, 1] += stiffness * nx * ny - pressure * gradient[0, 1]
        out_blocks[point, 2] += stiffness * nx * nz - pressure * gradient[0, 2]
        out_blocks[point, 3] += stiffness * ny * ny - pressure * gradient[1, 1]
        out_blocks[point, 4] += stiffness * ny * nz - pressure * gradient[1, 2]
        out_blocks[point, 5] += stiffness * nz * nz - pressure * gradient[2, 2]


@contracting_kernel
def add_contact_stiffness(blocks, area, cells, local, out_stencil):
    """Add the stiffness of the points in contact, from their symmetric blocks."""
    for n in range(cells.shape[0]):
        xx, xy, xz = blocks[n, 0], blocks[n, 1], blocks[n, 2]
        yy, yz, zz = blocks[n, 3], blocks[n, 4], blocks[n, 5]
        if xx == 0.0 and yy == 0.0 and zz == 0.0:
            continue
        for node in range(8):
            i, j = cells[n, 0] + node // 4, cells[n, 1] + (node // 2) % 2
            k, own = cells[n, 2] + node % 2, _weight(local, n, node) * area[n]
            for other in range(node, 8):
                offset = neighbour(node, other)
                both = own * _weight(local, n, other)
                block = 9 * offset
                out_stencil[i, j, block, k] += both * xx
                out_stencil[i, j, block + 1, k] += both * xy
                out_stencil[i, j, block + 2, k] += both * xz
                out_stencil[i, j, block + 3, k] += both * xy
                out_stencil[i, j, block + 4, k] += both * yy
                out_stencil[i, j, block + 5, k] += both * yz
                out_stencil[i, j, block + 6, k] += both * xz
                out_stencil[i, j, block + 7, k] += both * yz
                out_stencil[i, j, block + 8, k] += both * zz
