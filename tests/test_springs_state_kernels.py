"""Kernels of a spring problem's state: strained springs, contact, start, and what is measured."""

from __future__ import annotations

import numpy as np
import pytest
from make_springs import half_ellipsoid, random_lattice
from naive import springs as naive

from mammosim.compression.multigrid.scalar_level import stencil_level
from mammosim.compression.springs import _lattice_kernels as lattice
from mammosim.compression.springs._exponential_kernels import LARGEST_STRAIN, strain_springs
from mammosim.compression.springs._measure_kernels import (
    cell_volumes,
    held_columns,
    touching_area,
)
from mammosim.compression.springs._series_kernels import series_columns

ENL = {4.5: 7.5, 15.0: 10.0, 45.0: 20.0}


def enl_of(modulus: np.ndarray) -> np.ndarray:
    """The thesis' Enl of nodes with its moduli."""
    stiffening = np.zeros_like(modulus)
    for kpa, enl in ENL.items():
        stiffening[modulus == np.float32(kpa)] = enl
    return stiffening


def test_stiffness_and_slope_are_those_of_the_definition():
    modulus = random_lattice(3, (4, 5, 4))
    enl = enl_of(modulus)
    rng = np.random.default_rng(3)
    displacement = rng.normal(0.0, 0.25, (3, *modulus.shape))
    places = np.indices(modulus.shape) + displacement
    stretch = np.zeros(modulus.shape, np.float32)
    lattice.cell_stretch(modulus, displacement[2], stretch)
    for axis in range(3):
        stiffness, slope = (np.zeros((13, *modulus.shape), np.float32) for _ in range(2))
        strain_springs(modulus, enl, *displacement, stretch, axis, stiffness, slope)
        for n in map(tuple, np.argwhere(modulus > 0)):
            for number, offset in enumerate(naive.NEIGHBOURS[13:]):
                force, steep = naive.spring_force(modulus, enl, places, n, offset)
                gap = places[(slice(None), *np.add(n, offset))] - places[(slice(None), *n)]
                pull = gap - naive.equilibrium_length(modulus, places[2], n, offset)
                # Single precision of the stretch, times exp(20 e).
                at = (number, *n)
                np.testing.assert_allclose(stiffness[at] * pull, force, rtol=1e-4, atol=1e-4)
                np.testing.assert_allclose(slope[at], steep[axis], rtol=1e-4)


def test_a_spring_stiffens_no_further_than_is_finite():
    modulus, enl = np.zeros((3, 3, 5), np.float32), np.zeros((3, 3, 5), np.float32)
    modulus[1, 1, 1:3], enl[1, 1, 1:3] = 45.0, 20.0
    stiffness, stretch = np.zeros((13, 3, 3, 5), np.float32), np.zeros((3, 3, 5), np.float32)
    u = np.zeros((3, 3, 5))
    u[1, 1, 2] = 50.0
    strain_springs(modulus, enl, 0 * u, 0 * u, u, stretch, 2, stiffness, None)
    assert stiffness[0, 1, 1, 1] == pytest.approx(45.0 * np.exp(20.0 * LARGEST_STRAIN), rel=1e-5)


def held(place, low, high, slack, before):
    """Which obstacle holds a node at its local equilibrium; a touched one is let go later."""
    if place > high - slack * (before == 1):
        return 1
    return -1 if place < low + slack * (before == -1) else 0


@pytest.mark.parametrize("advance", [0.0, 0.5])
@pytest.mark.parametrize("axis", [0, 2])
def test_obstacles_hold_nodes_along_x_and_z(axis, advance):
    """Plates' faces in front of their edge along z; behind it their ends, and the wall, along x."""
    problem = half_ellipsoid((5, 6, 7), gap=0.5)
    plates = problem.plates._replace(edge=3.0, radius=1.5)
    rng = np.random.default_rng(1)
    shape = problem.modulus.shape
    u, uz, force = (rng.normal(0.0, 1.0, shape) for _ in range(3))
    diagonal = rng.uniform(0.5, 2.0, shape)
    free = (problem.tissue & ~problem.fixed).astype(np.float32)
    contact = rng.integers(-1, 2, shape).astype(np.int8)
    chest, slack, changes = 1.0, 0.3, 0
    expected_u, expected = u.copy(), contact.copy()
    for n in map(tuple, np.argwhere(free > 0)):
        step = force[n] / diagonal[n]
        if axis == 2:
            between = n[0] > plates.edge
            low, high = (plates.lower, plates.upper) if between else (-np.inf, np.inf)
        else:
            behind = n[0] <= plates.edge
            low, high = chest, lattice.foremost(n[2] + uz[n], plates) if behind else np.inf
        state = held(n[axis] + u[n] + step, low, high, slack, contact[n])
        expected_u[n] = (high if state > 0 else low) - n[axis] if state else u[n] + advance * step
        changes += state != contact[n]
        expected[n] = state
    if axis == 2:
        found = lattice.hold_between_faces(
            u, force, diagonal, free, plates, slack, contact, advance
        )
    else:
        found = lattice.plate_end_contact(
            u, uz, force, diagonal, free, plates, chest, slack, contact, advance
        )
    assert {-1, 0, 1} <= set(np.unique(expected[free > 0]))
    assert sum(found) == changes > 0
    np.testing.assert_array_equal(contact, expected)
    np.testing.assert_allclose(u, expected_u, atol=1e-12)
    out = np.full_like(free, 7.0)
    lattice.unheld_nodes(free, contact, out)
    np.testing.assert_array_equal(out, np.where(contact == 0, free, 0.0))


def test_volume_of_cells_is_that_of_their_mean_edges():
    modulus = random_lattice(2, (5, 6, 4))
    u = np.random.default_rng(2).normal(0.0, 0.4, (3, *modulus.shape))
    layers = np.zeros((modulus.shape[0], 3))
    cell_volumes(modulus, *u, layers)
    places = np.indices(modulus.shape) + u
    expected = np.zeros_like(layers)
    for cell in np.ndindex(*(size - 1 for size in modulus.shape)):
        part = tuple(slice(c, c + 2) for c in cell)
        if not modulus[part].all():
            continue
        edges = [np.diff(places[axis][part], axis=axis).mean() for axis in range(3)]
        first = [np.diff(places[axis][part], axis=axis)[0, 0, 0] for axis in range(3)]
        expected[cell[0]] += 1.0, np.prod(edges), min(first) < 0.0
    assert expected[:, 2].sum() > 0
    np.testing.assert_allclose(layers, expected, atol=1e-12)


@pytest.mark.parametrize("side", [1, -1])
def test_columns_that_touch_a_plate(side):
    rng = np.random.default_rng(3)
    contact = rng.choice([-1, 0, 1], (6, 5, 4), p=[0.2, 0.6, 0.2]).astype(np.int8)
    ux, uy = rng.normal(0.0, 0.2, (2, 6, 5, 4))
    place, touching = np.zeros((6, 5, 2)), np.zeros((6, 5), bool)
    held_columns(contact, ux, uy, side, place, touching)
    np.testing.assert_array_equal(touching, (contact == side).any(axis=2))
    for i, j in np.argwhere(touching):
        k = np.flatnonzero(contact[i, j] == side)[-1 if side > 0 else 0]
        np.testing.assert_allclose(place[i, j], [i + ux[i, j, k], j + uy[i, j, k]])


def test_area_of_a_sheared_and_stretched_patch():
    """Columns map linearly: the whole patch has the area of its quadrilaterals, scaled."""
    i, j = np.meshgrid(np.arange(7.0), np.arange(6.0), indexing="ij")
    place = np.stack([1.3 * i + 0.4 * j, 0.8 * j], axis=-1)
    touching = np.zeros((7, 6), bool)
    touching[1:6, 1:5] = True
    # 20 columns of 1.3 x 0.8 each; the shear keeps areas.
    assert touching_area(place, touching) == pytest.approx(20 * 1.3 * 0.8)
    touching[:] = False
    touching[2, 2] = touching[4, 4] = True
    assert touching_area(place, touching) == 2.0  # no quadrilateral: columns at rest


def test_columns_in_series_share_a_squeeze_as_one_over_stiffness():
    modulus = np.zeros((6, 3, 8), np.float32)
    modulus[1:5, 1, 1:7] = [4.5, 4.5, 15.0, 15.0, 4.5, 4.5]
    span = np.zeros((6, 3, 2), np.int32)
    span[1:5, 1] = 1, 7
    z = np.broadcast_to(np.arange(8.0), modulus.shape).copy()
    widening = np.ones(modulus.shape)
    lower, upper = 2.0, 5.5
    series_columns(modulus, span, 1, 2.0, lower, upper, z, widening)
    np.testing.assert_array_equal(z[1], np.broadcast_to(np.arange(8.0), (3, 8)))  # at the wall
    springs = 1.0 / np.minimum(modulus[3, 1, 1:6], modulus[3, 1, 2:7])
    shorter = (5.0 - (upper - lower)) * springs / springs.sum()
    np.testing.assert_allclose(np.diff(z[3, 1, 1:7]), 1.0 - shorter, rtol=1e-6)
    assert z[3, 1, 1] == lower
    assert z[3, 1, 6] == pytest.approx(upper)
    np.testing.assert_allclose(widening[3, 1, 1:6], (1.0 - shorter) ** -0.5, rtol=1e-6)
    # A column that fits is only moved.
    series_columns(modulus, span, 1, 2.0, 2.5, 9.0, z, widening)
    np.testing.assert_allclose(z[3, 1, 1:7], np.arange(1.0, 7.0) + 1.5)


def test_a_chebyshev_step_on_a_stored_stencil():
    rng = np.random.default_rng(5)
    shape = (5, 6, 7)
    stencil = np.zeros((14, *shape), np.float32)
    inner = (slice(None), *(slice(1, -1),) * 3)
    stencil[inner] = rng.normal(0.0, 0.2, stencil[inner].shape)
    stencil[0][1:-1, 1:-1, 1:-1] = 8.0
    level = stencil_level(stencil)
    u, load, step = np.zeros((3, *shape), np.float32)
    for field in (u, load, step):
        field[1:-1, 1:-1, 1:-1] = rng.normal(size=(3, 4, 5))
    force, out, before = np.zeros_like(u), np.zeros_like(u), step.copy()
    level.residual(u, load, force)
    keep, gain = np.float32(0.3), np.float32(0.7)
    level.smooth(u, load, keep, gain, step, out)
    free = stencil[0] > 0
    expected = keep * before[free] + gain * force[free] / stencil[0][free]
    np.testing.assert_allclose(step[free], expected, atol=1e-6)  # single precision
    np.testing.assert_allclose(out[free], u[free] + expected, atol=1e-6)
