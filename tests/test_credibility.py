"""A compression is believed, doubted or refused by the table of limits."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from make_records import make_compressed

from mammosim.compression import CompressionSettings, compress
from mammosim.compression.credibility import believed, contact_quantities
from mammosim.compression.plate_balance import (
    BALANCED,
    BalancedHeight,
    PlateForces,
    balanced,
)
from mammosim.compression.plates import Plates
from mammosim.errors import InputError, NotConverged
from mammosim.geometry import View
from mammosim.phantom import generate_phantom

SOUND = {
    "force_n": 110.0, "support_force_n": 108.0, "pressure_kpa": 12.0, "volume_change_percent": 1.0,
    "inverted_cells": 0.0, "cells": 10000.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def breast():
    return generate_phantom(density="fatty", voxel_mm=3.0, volume_ml=350, seed=1)


def compressed(model="springs", **measures):
    record = make_compressed(View("CC", "L"))
    return replace(record, model=model, measures={**SOUND, **measures})


def test_a_sound_compression_has_no_doubts():
    for model in ("springs", "hyperelastic"):
        assert believed(compressed(model), CompressionSettings(model=model)).notes == ()


@pytest.mark.parametrize(
    ("model", "measures", "said"),
    [
        ("springs", {"volume_change_percent": 3.1}, "loss of volume: found 3.1 %"),
        ("springs", {"inverted_cells": 11.0}, "share of folded cells: found 0.11 %"),
        ("springs", {"force_n": 264.0, "support_force_n": 264.0}, "force on the paddle: found 264"),
        ("hyperelastic", {"force_n": 6.0, "support_force_n": 6.0}, "plausible from 7 N"),
        ("springs", {"pressure_kpa": 41.0}, "mean pressure under the paddle: found 41 kPa"),
        ("springs", {"support_force_n": 103.0}, "forces on paddle and support: found 6.36"),
    ],
)
def test_a_doubt_is_noted_in_words(model, measures, said):
    result = believed(compressed(model, **measures), CompressionSettings(model=model))
    assert result.converged
    assert len(result.notes) == 1
    assert said in result.notes[0]


@pytest.mark.parametrize(
    ("model", "measures", "said"),
    [
        ("springs", {"volume_change_percent": 20.5}, "loss of volume: found 20.5 %, no result"),
        ("springs", {"inverted_cells": 201.0}, "share of folded cells: found 2.01 %"),
        ("hyperelastic", {"inverted_cells": 1.0}, "number of folded elements: found 1"),
        ("springs", {"force_n": 2001.0, "support_force_n": 2000.0}, "found 2001 N, no result"),
        ("springs", {"force_n": float("nan")}, "found nan, expected a number"),
        ("springs", {"support_force_n": 54.0}, "forces on paddle and support: found 50.91 %, no"),
    ],
)
def test_what_cannot_be_a_result_is_none(model, measures, said):
    with pytest.raises(NotConverged, match="LCC: no credible result") as refused:
        believed(compressed(model, **measures), CompressionSettings(model=model))
    assert said in str(refused.value)
    assert not refused.value.reached.converged
    assert any(said in note for note in refused.value.reached.notes)


def test_a_low_force_that_was_asked_for_is_believed():
    low = compressed(force_n=5.0, support_force_n=5.0)
    assert believed(low, CompressionSettings(force_n=5.0)).notes == ()


def test_a_breast_need_not_bear_the_whole_of_a_clinical_force():
    low = compressed("hyperelastic", force_n=19.0, support_force_n=19.0)
    assert believed(low, CompressionSettings(model="hyperelastic")).notes == ()
    (note,) = believed(low, CompressionSettings(model="hyperelastic", thickness_mm=50.0)).notes
    assert "plausible from 20 N" in note


def test_forces_need_not_balance_under_gravity():
    hanging = compressed(support_force_n=140.0)
    assert believed(hanging, CompressionSettings(gravity=True)).notes == ()


def test_springs_pressed_flat_are_no_result(breast):
    with pytest.raises(NotConverged, match="no credible result: loss of volume"):
        compress(breast, "CC", model="springs", resolution_mm=6.0, thickness_mm=1.0)


@pytest.mark.parametrize(
    ("heights_mm", "said"),
    [((500.0, 540.0), "displace the whole breast"), ((-60.0, 62.0), "a plate must touch it")],
)
def test_plates_that_do_not_compress_are_refused(breast, heights_mm, said):
    low, high = heights_mm
    with pytest.raises(InputError, match=said):
        compress(
            breast, "CC", model="springs", resolution_mm=6.0, support_z_mm=low, paddle_z_mm=high
        )


@pytest.mark.parametrize("view", ["CC", "MLO"])
def test_default_heights_balance_and_given_ones_are_judged(breast, view):
    """Midway between the faces of this breast the plates differ by 33 % in CC, 44 % in MLO."""
    found = compress(breast, view, model="springs", resolution_mm=6.0)
    forces = contact_quantities(found, CompressionSettings())
    assert forces["force_imbalance_percent"] <= 100.0 * BALANCED
    high = {"support_z_mm": found.support_z_mm + 16.0, "paddle_z_mm": found.paddle_z_mm + 16.0}
    with pytest.raises(NotConverged, match=r"difference between the forces .* no result above 50"):
        compress(breast, view, model="springs", resolution_mm=6.0, **high)


def test_the_height_is_found_for_a_force_too(breast):
    found = compress(breast, "MLO", model="springs", resolution_mm=6.0, force_n=60.0)
    assert found.force_n == pytest.approx(60.0, rel=0.01)
    forces = contact_quantities(found, CompressionSettings())
    assert forces["force_imbalance_percent"] <= 100.0 * BALANCED


def test_given_heights_are_left_alone(breast):
    """The same bits, whether heights were found or given."""
    found = compress(breast, "CC", model="springs", resolution_mm=6.0)
    again = compress(
        breast, "CC", model="springs", resolution_mm=6.0,
        support_z_mm=found.support_z_mm, paddle_z_mm=found.paddle_z_mm,
    )  # fmt: skip
    assert (again.support_z_mm, again.paddle_z_mm) == (found.support_z_mm, found.paddle_z_mm)
    assert np.abs(again.field.displacement_mm - found.field.displacement_mm).max() < 0.05


def linear(zero_mm, slope_per_mm):
    """Plates whose forces differ in proportion to their height above that of balance."""

    def forces(plates):
        share = np.clip(slope_per_mm * (plates.centre_mm - zero_mm), -1.0, 1.0)
        return PlateForces(100.0 * min(1.0, 1.0 - share), 100.0 * min(1.0, 1.0 + share))

    return forces


@pytest.mark.parametrize("zero_mm", [-14.0, 0.0, 9.0])
@pytest.mark.parametrize("slope_per_mm", [0.01, 0.05, 1.0])
def test_the_height_of_balance_is_found_from_anywhere(zero_mm, slope_per_mm):
    height = BalancedHeight(linear(zero_mm, slope_per_mm), -50.0, 50.0)
    placed = height.placed(Plates(-25.0, 25.0, 0.0))
    assert placed.thickness_mm == pytest.approx(50.0)
    assert abs(linear(zero_mm, slope_per_mm)(placed).imbalance) <= BALANCED
    forces = linear(zero_mm + 3.0, slope_per_mm)
    moved = height.corrected(placed, forces(placed))
    assert abs(forces(moved).imbalance) < abs(forces(placed).imbalance) or slope_per_mm == 1.0


def test_a_coarse_copy_that_fails_leaves_the_plates_where_they_are():
    plates = Plates(-25.0, 25.0, 0.0)
    assert BalancedHeight(lambda plates: None, -50.0, 50.0).placed(plates) == plates
    assert BalancedHeight(linear(5.0, 0.05), -20.0, 20.0).placed(plates) == plates


@dataclass(frozen=True)
class Solved:
    """A solver's state, with nothing in it."""

    converged: bool = True
    interrupted: bool = False

    def stopped(self):
        return Solved(converged=False, interrupted=True)


def test_an_interruption_of_a_correction_is_no_result():
    """The height before was solved, but not balanced: it is what was reached."""
    solved = []

    def solve(plates, start):
        solved.append(plates)
        return (Solved().stopped() if start else Solved()), PlateForces(80.0, 100.0)

    height = BalancedHeight(linear(0.0, 0.05), -50.0, 50.0)
    plates, state = balanced(Plates(-25.0, 25.0, 0.0), height, solve)
    assert len(solved) == 2
    assert state.interrupted
    assert not state.converged
    assert plates == solved[0]


def test_what_is_left_of_the_height_is_known():
    """The breast itself has another height of balance and slope than its coarse copy."""
    forces = linear(1.0, 0.016)
    height = BalancedHeight(linear(0.0, 0.05), -50.0, 50.0, slope=1.4)
    plates, _ = balanced(
        Plates(-25.0, 25.0, 0.0), height, lambda plates, start: (Solved(), forces(plates))
    )
    left = height.move_mm(plates, forces(plates))
    assert abs(left) > 0.1
    assert left == pytest.approx(1.0 - plates.centre_mm, rel=0.6)


def test_plates_that_touch_nothing_are_balanced():
    assert PlateForces(0.0, 0.0).imbalance == 0.0
