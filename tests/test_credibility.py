"""A compression is believed, doubted or refused by the table of limits."""

from dataclasses import replace

import pytest
from make_records import make_compressed

from mammosim.compression import CompressionSettings, compress
from mammosim.compression.credibility import believed
from mammosim.errors import InputError, NotConverged
from mammosim.geometry import View
from mammosim.phantom import generate_phantom

SOUND = {
    "force_n": 110.0, "support_force_n": 108.0, "pressure_kpa": 12.0, "volume_change_percent": 1.0,
    "inverted_cells": 0.0, "cells": 10000.0,
}  # fmt: skip


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
        ("hyperelastic", {"force_n": 19.0, "support_force_n": 19.0}, "plausible from 20 N"),
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


def test_forces_need_not_balance_under_gravity():
    hanging = compressed(support_force_n=140.0)
    assert believed(hanging, CompressionSettings(gravity=True)).notes == ()


def test_springs_pressed_flat_are_no_result():
    breast = generate_phantom(density="fatty", voxel_mm=3.0, volume_ml=200, seed=1)
    with pytest.raises(NotConverged, match="no credible result: loss of volume"):
        compress(breast, "CC", model="springs", resolution_mm=6.0, thickness_mm=1.0)


@pytest.mark.parametrize(
    ("heights_mm", "said"),
    [((500.0, 540.0), "push the whole breast"), ((-60.0, 62.0), "a plate must touch it")],
)
def test_plates_that_do_not_compress_are_refused(heights_mm, said):
    breast = generate_phantom(density="fatty", voxel_mm=3.0, volume_ml=200, seed=1)
    low, high = heights_mm
    with pytest.raises(InputError, match=said):
        compress(breast, "CC", resolution_mm=6.0, support_z_mm=low, paddle_z_mm=high)
