"""Laws of what holds a breast together: skin as a membrane, fascia, corners of surface cells."""

import numpy as np
import pytest
from naive import structure as naive

from mammosim.compression.hyperelastic.fascia import RIM_PART, Fascia, SkinBorder
from mammosim.compression.hyperelastic.fibres import Fibres
from mammosim.compression.hyperelastic.gravity import Weight
from mammosim.compression.hyperelastic.membrane import Membrane
from mammosim.compression.hyperelastic.surface import SurfacePoints
from mammosim.compression.hyperelastic.surface_cells import SurfaceCells
from mammosim.compression.multigrid import BlockLevel, Workspace

RADIUS = 9.0
"""Of the balloon, cells."""


def linear(shape, gradient, middle):
    """Displacement [3, x, y, z] whose deformation gradient is everywhere the same."""
    places = np.indices(shape) - np.reshape(middle, (3, 1, 1, 1))
    return np.einsum("ij,jxyz->ixyz", np.asarray(gradient) - np.eye(3), places)


def balloon():
    """A spherical membrane, its centre in the middle of the cells."""
    size = int(2 * RADIUS) + 6
    middle = 0.5 * size
    fine = (np.arange(4 * size) + 0.5) / 4.0 - middle
    inside = sum(a**2 for a in np.meshgrid(fine, fine, fine, indexing="ij")) <= RADIUS**2
    fraction = inside.reshape(size, 4, size, 4, size, 4).mean(axis=(1, 3, 5)).astype(np.float32)
    free = np.ones((3, size, size, size), np.float32)
    points = SurfacePoints.of(fraction, free)
    return Membrane.of(points, np.ones(len(points.area), bool), 1.0), middle, (size,) * 3


def test_an_inflated_balloon_has_the_pressure_of_a_neo_hookean_membrane():
    # p = 2 mu t / R (1/lambda - 1/lambda^7): Green & Adkins 1970, Large Elastic Deformations, ch. 4
    membrane, middle, shape = balloon()
    for stretch in (1.1, 1.4, 2.0):
        grown = linear(shape, stretch * np.eye(3), (middle,) * 3)
        force = np.zeros((3, *shape))
        membrane.add_forces(grown, force)
        places = np.indices(shape) - middle
        slope = (force * places).sum()  # dE/dlambda = p dV/dlambda
        pressure = slope / (4.0 * np.pi * RADIUS**3 * stretch**2)
        expected = 2.0 / RADIUS * (stretch**-1 - stretch**-7)
        assert pressure == pytest.approx(expected, rel=0.03)  # areas are found 2 to 3 % small


def flat(tension=2.0, stiffening=0.0):
    """One patch of a membrane in the plane x = 1."""
    points = SurfacePoints(
        np.array([[1, 1, 1]], np.int32), np.full((1, 3), 0.5), np.ones(1),
        np.array([[1.0, 0.0, 0.0]]),
    )  # fmt: skip
    return Membrane.of(points, np.ones(1, bool), tension, stiffening)


@pytest.mark.parametrize("width", [0.5, 0.8, 0.95])
def test_a_wrinkled_sheet_pulls_as_a_strip_does(width):
    # in uniaxial tension sigma = mu (lambda - 1 / lambda^2), and a narrower strip costs nothing
    membrane, shape, tension = flat(), (4, 4, 4), 2.0
    stretch = 1.05
    assert width < stretch**-0.5
    u = linear(shape, np.diag([1.0, width, stretch]), (1.5,) * 3)
    force = np.zeros((3, *shape))
    energy = membrane.add_forces(u, force)
    assert energy == pytest.approx(0.5 * tension * (stretch**2 + 2.0 / stretch - 3.0))
    assert np.abs(force[0]).max() == np.abs(force[1]).max() == 0.0
    pull = force[2, :, :, 2].sum()
    assert pull == pytest.approx(tension * (stretch - stretch**-2))


@pytest.mark.parametrize("stretch", [1.02, 1.3, 1.6])
def test_a_sheet_that_stiffens_follows_yeohs_law(stretch):
    # one way, sigma = mu (lambda - 1 / lambda^2) (1 + b I), I = lambda^2 + 2 / lambda - 3
    tension, stiffening = 2.0, 6.0
    u = linear((4, 4, 4), np.diag([1.0, stretch**-0.6, stretch]), (1.5,) * 3)
    force = np.zeros_like(u)
    energy = flat(tension, stiffening).add_forces(u, force)
    size = stretch**2 + 2.0 / stretch - 3.0
    assert energy == pytest.approx(0.5 * tension * (size + 0.5 * stiffening * size**2))
    pull = force[2, :, :, 2].sum()
    expected = tension * (stretch - stretch**-2) * (1.0 + stiffening * size)
    assert pull == pytest.approx(expected)


def test_a_slack_sheet_does_nothing():
    u = linear((4, 4, 4), np.diag([1.0, 0.9, 0.7]), (1.5,) * 3)
    force = np.zeros_like(u)
    assert flat().add_forces(u, force) == 0.0
    assert not force.any()


def test_a_turned_sheet_has_no_energy():
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    membrane, middle, shape = balloon()
    u = linear(shape, turn, (middle,) * 3)
    force = np.zeros_like(u)
    assert membrane.add_forces(u, force) == pytest.approx(0.0, abs=1e-9)
    assert np.abs(force).max() < 1e-6


def rough_patches(stiffening, count=12, seed=0):
    """Patches all over a small lattice, and a rough displacement that strains them all ways."""
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    points = SurfacePoints(
        rng.integers(1, 3, (count, 3)).astype(np.int32), rng.uniform(-0.3, 1.3, (count, 3)),
        rng.uniform(0.3, 1.0, count), normal,
    )  # fmt: skip
    membrane = Membrane.of(points, np.ones(count, bool), 2.0, stiffening)
    return membrane, 0.3 * rng.standard_normal((3, 5, 5, 5)), rng


def image(stencil, direction):
    """What a block stencil makes of a direction."""
    span = np.zeros((*stencil.shape[:2], 2), np.int32)
    span[1:-1, 1:-1] = 1, stencil.shape[3] - 1
    out = np.zeros(direction.shape, np.float32)
    level = BlockLevel.of(stencil, span, Workspace())
    level.residual(direction.astype(np.float32), np.zeros(direction.shape, np.float32), out)
    return -out.astype(np.float64)


@pytest.mark.parametrize("stiffening", [0.0, 6.0])
def test_membrane_forces_are_those_of_the_plain_twin(stiffening):
    membrane, u, _ = rough_patches(stiffening)
    force = np.zeros_like(u)
    energy = membrane.add_forces(u, force)
    states = naive.states(u, membrane)
    assert {"slack", "wrinkled", "taut"} <= set(states)  # all three are tested
    assert energy == pytest.approx(naive.membrane_energy(u, membrane), rel=1e-12)
    expected = naive.membrane_force(u, membrane)
    # central differences of 1e-6: good to about 1e-9 of the largest force
    assert np.abs(force - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("stiffening", [0.0, 6.0])
def test_membrane_tangent_is_the_slope_of_its_forces_and_never_negative(stiffening):
    membrane, u, rng = rough_patches(stiffening)
    stencil = np.zeros((5, 5, 126, 5), np.float32)
    membrane.add_tangent(u, stencil)
    for _ in range(5):
        direction = np.zeros_like(u)
        direction[:, 1:-1, 1:-1, 1:-1] = rng.standard_normal((3, 3, 3, 3))
        ahead, behind = np.zeros_like(u), np.zeros_like(u)
        membrane.add_forces(u + 1e-6 * direction, ahead)
        membrane.add_forces(u - 1e-6 * direction, behind)
        expected = (ahead - behind) / 2e-6
        found = image(stencil, direction)
        inner = (slice(None), *(slice(1, -1),) * 3)
        # the stencil is in single precision
        assert np.abs(found - expected)[inner].max() < 1e-5 * np.abs(expected).max()
        assert (found * direction).sum() > 0.0


def test_the_fascia_is_a_layer_in_shear():
    # F = G A u / t: 0.5 kPa/mm over 2 x 3 faces, moved by 0.25 along y and -0.5 along z
    active = np.zeros((5, 6, 7), bool)
    active[1:3, 1:3, 1:4] = True
    fascia = Fascia.of(active.astype(np.float32), active, 0.5)
    u = np.zeros((3, *active.shape))
    u[1], u[2] = 0.25, -0.5
    force = np.zeros_like(u)
    energy = fascia.add_forces(u, force)
    assert force[1].sum() == pytest.approx(0.5 * 6 * 0.25)
    assert force[2].sum() == pytest.approx(-0.5 * 6 * 0.5)
    assert force[0].any() == False  # noqa: E712
    assert energy == pytest.approx(0.5 * 0.5 * 6 * (0.25**2 + 0.5**2))
    stencil = np.zeros((5, 6, 126, 7), np.float32)
    fascia.add_tangent(u, stencil)
    assert np.allclose(image(stencil, u)[:, 1], force[:, 1])


def wall_with_skin(side=13):
    """A square wall, and skin around it but for the side at low z, where the phantom was cut."""
    active = np.zeros((5, side + 4, side + 4), bool)
    active[1:3, 1 : side + 1, 1 : side + 1] = True
    skin = active.astype(np.float32)
    skin[:, 2:side, :side] = 0.0
    return active, skin


def test_skin_goes_on_beyond_the_wall():
    # Chain of a strip of skin, E t u'' = k u, one edge wide: its end against sqrt(E t k).
    tension, layer, step, links = 6.0, 0.09, 0.1, 3000
    active, skin = wall_with_skin()
    border = SkinBorder.of(active, skin, 0.25, tension, 5.0)
    yy, yz, zz = border.skin_beyond(layer)
    middle, low, high = 8, 1, 14
    for held, young in ((yy, 4.0), (zz, 1.0)):  # across the border, and along it
        chain = young * tension / step
        stiffness = 0.0
        for _ in range(links):  # each further piece of skin in series, on its own layer
            stiffness = 1.0 / (1.0 / (stiffness + layer * step) + 1.0 / chain)
        for end in (low, high):
            assert held[end, middle] == pytest.approx(stiffness, rel=0.01)
            assert yz[end, middle] == 0.0
    assert not zz[middle, low].any()  # where the phantom was cut, no skin holds
    assert zz[middle, high] > 0.0
    assert border.length.sum() == pytest.approx(3 * 13, rel=0.1)


def test_the_fascia_is_softer_along_the_rim():
    active, skin = wall_with_skin()
    border = SkinBorder.of(active, skin, 0.25, 1e-20, 5.0)
    tie = Fascia.of(active.astype(np.float32), active, 0.5, border).ties[0]
    at_rim, next_to_it, inside = tie[1, 8], tie[2, 8], tie[8, 8]
    assert inside == pytest.approx(0.5)
    assert at_rim == pytest.approx(0.5 * RIM_PART * 0.5)  # half of a face behind each node there
    assert next_to_it == pytest.approx(0.5 * (RIM_PART + (1.0 - RIM_PART) / 5.0))
    assert tie[8, 2] == pytest.approx(0.5)  # near where the phantom was cut


def test_ties_are_the_slope_of_their_energy():
    active, skin = wall_with_skin(6)
    border = SkinBorder.of(active, skin, 0.25, 6.0, 3.0)
    fascia = Fascia.of(active.astype(np.float32), active, 0.5, border)
    u = np.zeros((3, *active.shape))
    u[:, 1:-1, 1:-1, 1:-1] = np.random.default_rng(4).standard_normal((3, 3, 8, 8))
    force, stencil = np.zeros_like(u), np.zeros((5, 10, 126, 10), np.float32)
    energy = fascia.add_forces(u, force)
    fascia.add_tangent(u, stencil)
    assert energy == pytest.approx(0.5 * (force * u).sum())
    assert np.abs(image(stencil, u) - force).max() < 1e-5 * np.abs(force).max()


def test_corners_follow_every_uniform_deformation_at_no_cost():
    active = np.zeros((6, 6, 6), bool)
    active[1:4, 1:4, 1:4] = True
    cells = SurfaceCells.of(active, active.astype(np.float32), 0.0)
    assert len(cells.cells) == 27 - 1 - 1  # all but the innermost and the one at the wall behind it
    rng = np.random.default_rng(1)
    u = linear(active.shape, rng.standard_normal((3, 3)), (2.0, 2.0, 2.0))
    force = np.zeros_like(u)
    assert cells.add_forces(u, force) == pytest.approx(0.0, abs=1e-9)
    u[:, 4, 4, 4] += 1.0  # a corner that sticks out, and that only one cell holds
    cells.add_forces(u, force)
    assert (force[:, 4, 4, 4] > 0.0).all()


def test_a_corner_further_out_is_held_more_stiffly():
    active = np.zeros((6, 6, 6), bool)
    active[1:4, 1:4, 1:4] = True
    cells = SurfaceCells.of(active, active.astype(np.float32), 0.0)
    pull = {}
    for out in (0.1, 2.0):
        u, force = np.zeros((3, 6, 6, 6)), np.zeros((3, 6, 6, 6))
        u[0, 4, 4, 4] = out  # half of it is no uniform deformation: q = out^2 / 2
        cells.add_forces(u, force)
        pull[out] = force[0, 4, 4, 4] / (0.5 * out)
    assert pull[0.1] == pytest.approx(1.0 + 4.0 * 0.1**2 / 2.0)
    assert pull[2.0] == pytest.approx(1.0 + 4.0 * 2.0**2 / 2.0)


def test_corner_stiffness_is_the_slope_of_its_forces():
    active = np.zeros((6, 6, 6), bool)
    active[1:4, 1:4, 1:4] = True
    cells = SurfaceCells.of(active, active.astype(np.float32), 1.5)
    u, step = np.zeros((2, 3, 6, 6, 6))
    u[:, 1:-1, 1:-1, 1:-1], step[:, 1:-1, 1:-1, 1:-1] = np.random.default_rng(2).standard_normal(
        (2, 3, 4, 4, 4)
    )
    ahead, behind = np.zeros_like(u), np.zeros_like(u)
    cells.add_forces(u + 1e-5 * step, ahead)
    cells.add_forces(u - 1e-5 * step, behind)
    slope, stencil = (ahead - behind) / 2e-5, np.zeros((6, 6, 126, 6), np.float32)
    cells.add_tangent(u, stencil)
    assert np.abs(image(stencil, step) - slope).max() < 1e-5 * np.abs(slope).max()


def test_corner_forces_are_those_of_the_plain_twin():
    active = np.zeros((5, 5, 5), bool)
    active[1:3, 1:3, 1:3] = True
    cells = SurfaceCells.of(active, active.astype(np.float32), 0.7)
    u = np.random.default_rng(6).standard_normal((3, 5, 5, 5))
    force = np.zeros_like(u)
    energy = cells.add_forces(u, force)
    assert energy == pytest.approx(naive.corner_energy(u, cells), rel=1e-10)
    expected = naive.force_of(lambda moved: naive.corner_energy(moved, cells), u, cells.cells)
    # central differences of 1e-6: good to about 1e-9 of the largest force
    assert np.abs(force - expected).max() < 1e-7 * np.abs(expected).max()


def test_fibre_forces_are_those_of_the_plain_twin():
    shear = np.zeros((5, 5, 5), np.float32)
    shear[1:3, 1:3, 1:3] = 2.0
    fibres = Fibres.of(shear, np.array([-3.0, 2.2, 1.7]), 2.5)
    u = 0.3 * np.random.default_rng(8).standard_normal((3, 5, 5, 5))
    force = np.zeros_like(u)
    energy = fibres.add_forces(u, force)
    assert energy > 0.0
    assert energy == pytest.approx(naive.fibre_energy(u, fibres), rel=1e-10)
    expected = naive.force_of(lambda moved: naive.fibre_energy(moved, fibres), u, fibres.cells)
    # central differences of 1e-6: good to about 1e-9 of the largest force
    assert np.abs(force - expected).max() < 1e-7 * np.abs(expected).max()


def fibrous_block(ratio=3.0):
    """Eight elements of shear modulus 2 with fibres along z, from far below."""
    shear = np.zeros((5, 5, 5), np.float32)
    shear[1:3, 1:3, 1:3] = 2.0
    return Fibres.of(shear, np.array([2.0, 2.0, -1e9]), ratio)


@pytest.mark.parametrize("stretch", [0.7, 1.2, 1.5])
def test_a_block_with_fibres_pulls_along_them_and_in_tension_only(stretch):
    # k (L - 1) with k = (ratio - 1) E, less half of the stretch over which fibres take hold
    fibres = fibrous_block()
    u = linear((5, 5, 5), np.diag([0.9, 0.9, stretch]), (2.0, 2.0, 2.0))
    force = np.zeros_like(u)
    energy = fibres.add_forces(u, force)
    pull = (3.0 - 1.0) * 3.0 * 2.0 * max(stretch - 1.0 - 0.5 * 0.015, 0.0)
    assert force[2, :, :, 3].sum() == pytest.approx(4.0 * pull)  # over four faces
    assert np.abs(force[:2]).max() < 1e-7
    assert energy == pytest.approx(8.0 * 6.0 * max(stretch - 1.0075, 0.0) ** 2, rel=1e-3)


def test_fibre_tangent_is_the_slope_of_its_forces_and_never_negative():
    shear = np.zeros((5, 5, 5), np.float32)
    shear[1:3, 1:3, 1:3] = 2.0
    fibres = Fibres.of(shear, np.array([-3.0, 2.2, 1.7]), 2.5)
    rng = np.random.default_rng(4)
    u, direction = np.zeros((2, 3, 5, 5, 5))
    u[:, 1:-1, 1:-1, 1:-1] = 0.3 * rng.standard_normal((3, 3, 3, 3))
    direction[:, 1:-1, 1:-1, 1:-1] = rng.standard_normal((3, 3, 3, 3))
    stencil = np.zeros((5, 5, 126, 5), np.float32)
    fibres.add_tangent(u, stencil)
    ahead, behind = np.zeros_like(u), np.zeros_like(u)
    above = fibres.add_forces(u + 1e-6 * direction, ahead)
    below = fibres.add_forces(u - 1e-6 * direction, behind)
    force = np.zeros_like(u)
    fibres.add_forces(u, force)
    assert (above - below) / 2e-6 == pytest.approx((force * direction).sum(), rel=1e-6)
    expected, found = (ahead - behind) / 2e-6, image(stencil, direction)
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()  # single precision
    assert (found * direction).sum() > 0.0


def test_weight_is_that_of_the_mass():
    mass = np.zeros((5, 5, 5), np.float32)
    mass[1:3, 1:3, 1:3] = 0.95
    weight = Weight.of(mass, (0.0, 0.0, -0.01))
    u = np.zeros((3, 5, 5, 5))
    u[2] = -0.5  # all fall by half an edge
    force = np.zeros_like(u)
    assert weight.add_forces(u, force) == pytest.approx(-8 * 0.95 * 0.01 * 0.5)
    assert force[2].sum() == pytest.approx(8 * 0.95 * 0.01)
    assert not force[:2].any()
