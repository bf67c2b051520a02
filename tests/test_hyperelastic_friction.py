"""Friction between plates and skin: its energy, its limits, and what moves with the plates."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_hyperelastic_model import block

from mammosim._jit import one_blas_thread
from mammosim.compression.hyperelastic.contact import Contact
from mammosim.compression.hyperelastic.friction import Friction
from mammosim.compression.hyperelastic.measures import plate_forces
from mammosim.compression.hyperelastic.newton import evaluate
from mammosim.compression.hyperelastic.sliding import anchors
from mammosim.compression.hyperelastic.stages import Stages
from mammosim.compression.plates import Panel, Plates

CELLS, EDGE_MM = 4, 10.0
"""Of the block: elements along each side, and their edge."""


def open_plates():
    """Plates all over the block, which just touch it."""
    return Plates(EDGE_MM, (1 + CELLS) * EDGE_MM, -1e4)


def closed(part=0.85):
    """The same, closed to a part of the block's height."""
    plates = open_plates()
    return plates.at_height(plates.centre_mm, part * plates.thickness_mm)


def squeezed(coefficient, body=None):
    """Stages of a block, and its state between closed plates with friction."""
    nodes = SimpleNamespace(spacing_mm=np.full(3, EDGE_MM), origin_mm=np.zeros(3))
    mesh = SimpleNamespace(body=body or block(CELLS), nodes=nodes)
    stages = Stages(mesh, -1e4, 1e-3, friction=coefficient)
    state = one_blas_thread(stages.compress)(closed())
    assert state.converged
    return stages, state


def force_n(stages, state, plates):
    """On the paddle."""
    return plate_forces(stages.contact(0, plates), state, EDGE_MM).paddle_n


def test_friction_resists_up_to_a_bonded_contact():
    forces = [force_n(*squeezed(mu), closed()) for mu in (0.0, 0.05, 0.2, 2.0)]
    assert (np.diff(forces) > 0.0).all()
    bonded = block(CELLS)
    held = bonded.held.copy()
    held[:2, :, :, [1, 1 + CELLS]] = True
    limit = force_n(*squeezed(0.0, replace(bonded, held=held)), closed())
    # Friction holds the middles of the elements' faces, and bonding their corners.
    assert forces[-1] == pytest.approx(limit, rel=0.02)
    assert limit - forces[0] > 5.0 * (limit - forces[-1])


def test_stress_is_friction_times_pressure_where_skin_slides_and_less_where_it_sticks():
    coefficient = 0.5
    _, state = squeezed(coefficient)
    pressed = state.value.pressure > 0.0
    limit = coefficient * state.value.pressure[pressed]
    stress = np.linalg.norm(state.grip.stress, axis=-1)[pressed]
    slides = np.linalg.norm(state.grip.slip, axis=-1)[pressed] > 0.999
    assert 0 < np.count_nonzero(slides) < slides.size
    # The pressure that friction takes is that of the last solution but one.
    np.testing.assert_allclose(stress[slides], limit[slides], rtol=0.02)
    assert (stress[~slides] < limit[~slides]).all()


def test_without_friction_nothing_of_it_is_left():
    stages, state = squeezed(0.0)
    assert state.grip is None
    contact = stages.contact(0, closed())
    none = np.zeros_like(state.value.pressure)
    friction = Friction(none, state.value.push, state.value.push, 0.01)
    held = evaluate(stages.bodies[0], replace(contact, friction=friction), state.u)
    assert held.energy == state.value.energy
    np.testing.assert_array_equal(held.force, state.value.force)


def test_friction_is_the_derivative_of_its_energy():
    rng, step = np.random.default_rng(2), 1e-6
    push = rng.standard_normal((2, 5, 3))
    push /= np.linalg.norm(push, axis=-1, keepdims=True)
    places, area = rng.standard_normal((5, 3)), np.ones(5)
    anchor = places + 0.3 * rng.standard_normal((2, 5, 3))
    friction = Friction(rng.uniform(0.4, 0.8, (2, 5)), push, anchor, 0.25)
    slides = np.linalg.norm(friction.slip(places), axis=-1) > 0.999
    assert slides.any()
    assert not slides.all()

    def forces(at):
        size, way = friction.stress(at)
        return -(size[..., None] * way).sum(axis=0)

    blocks = np.zeros((5, 6))
    friction.add_blocks(places, blocks)
    entries = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    for point, axis in np.ndindex(5, 3):
        moved = np.zeros_like(places)
        moved[point, axis] = step
        ahead, behind = places + moved, places - moved
        slope = (friction.energy(ahead, area) - friction.energy(behind, area)) / (2 * step)
        assert slope == pytest.approx(forces(places)[point, axis], abs=1e-7)
        change = ((forces(ahead) - forces(behind)) / (2 * step))[point]
        for other in range(3):
            entry = entries.index((min(axis, other), max(axis, other)))
            assert change[other] == pytest.approx(blocks[point, entry], abs=1e-6)


def test_what_is_carried_by_a_plate_keeps_its_depth_in_it():
    rng = np.random.default_rng(3)
    panel = Panel(0.0, 60.0, -40.0, 40.0, 25.0, -1.0)
    before = Plates(-20.0, 22.0, 10.0).shaped("panel", panel)
    after = Plates(-18.5, 19.0, 10.0).shaped("panel", replace(panel, tilt_deg=4.0))
    places = np.array([10.0, 0.0, 0.0]) + rng.uniform(-1.0, 1.0, (50, 3)) * (5.0, 50.0, 30.0)

    def depths(plates, moved):
        contact = Contact(None, plates.solids(np.zeros(3), 1.0), 1.0)
        return [contact.depth(own)[0][number] for number, own in enumerate(moved)]

    there = before.carried(after, places)
    np.testing.assert_allclose(depths(after, there), depths(before, (places, places)), atol=1e-9)


def test_an_anchor_goes_with_a_plate_from_where_the_plate_reaches_it():
    """A paddle that comes down by 2 mm on points 1 mm inside it, 1.5 and 3 mm below its face."""
    start, end = Plates(-50.0, 0.0, -100.0), Plates(-50.0, -2.0, -100.0)
    before, after = (Contact(None, plates.solids(np.zeros(3), 1.0), 1.0) for plates in (start, end))
    places = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.5], [0.0, 0.0, -3.0]])
    hold = np.zeros((2, 3, 3))
    hold[0, 0] = 0.1, 0.0, 0.0
    found = anchors(before, after, places, start.carried(end, places), hold)
    np.testing.assert_allclose(found[0], [[-0.1, 0.0, -1.0], [0.0, 0.0, -2.0], [0.0, 0.0, -3.0]])
    np.testing.assert_allclose(found[1], places)
