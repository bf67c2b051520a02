"""Rules by which one view tells where to look in another, and targets to be doubted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from make_records import make_compressed, make_gantry, make_targets
from naive.projection import phantom

from mammosim.compression import compress
from mammosim.geometry import View
from mammosim.targets import rule_errors, target_origins, target_warnings


def seen(name, side="L", **changes):
    view = View(name, side)
    targets = make_targets(view)
    nipple = (targets[-1].image_row_px, targets[-1].image_col_px)
    placed = []
    for target in targets:
        away = np.hypot(target.image_row_px - nipple[0], target.image_col_px - nipple[1])
        placed.append(dataclasses.replace(target, image_nipple_distance_mm=float(0.5 * away)))
    if changes:
        placed[0] = dataclasses.replace(placed[0], **changes)
    return placed, make_gantry(view)


@pytest.mark.parametrize("side", ["L", "R"])
def test_both_rules_against_a_place_put_by_hand(side):
    cc, gantry = seen("CC", side)
    sign = 1.0 if side == "L" else -1.0
    nipple = cc[-1]
    # 24 mm behind the nipple and 10 mm beside it in CC; 30 mm behind and 16 mm above in MLO.
    cc[0] = dataclasses.replace(
        cc[0], image_col_px=nipple.image_col_px - sign * 48.0,
        image_row_px=nipple.image_row_px + 20.0, image_nipple_distance_mm=26.0,
    )  # fmt: skip
    mlo, other = seen("MLO", side)
    nipple = mlo[-1]
    mlo[0] = dataclasses.replace(
        mlo[0], image_col_px=nipple.image_col_px - sign * 60.0,
        image_row_px=nipple.image_row_px - 32.0, image_nipple_distance_mm=34.0,
    )  # fmt: skip
    row = rule_errors({"CC": (cc, gantry), "MLO": (mlo, other)})[0]
    assert (row.from_view, row.to_view, row.name) == ("CC", "MLO", "mass 1")
    assert (row.nipple_depth_from_mm, row.nipple_depth_to_mm) == pytest.approx((24.0, 30.0))
    assert row.line_error_mm == pytest.approx(6.0)
    assert row.arc_error_mm == pytest.approx(8.0)
    assert row.nipple_distance_mm == cc[0].nipple_distance_mm


def test_every_pair_of_views_and_only_what_both_show():
    views = {name: seen(name) for name in ("CC", "MLO", "ML")}
    rows = rule_errors(views)
    pairs = {(row.from_view, row.to_view) for row in rows}
    assert pairs == {("CC", "MLO"), ("CC", "ML"), ("MLO", "ML")}
    # The landmark lies outside all pictures, the nipple is the rules' origin.
    assert {row.kind for row in rows} == {"mass", "calcification", "clip"}
    views["ML"] = seen("ML", in_field=False)
    assert ("CC", "ML", "mass 1") not in {
        (row.from_view, row.to_view, row.name) for row in rule_errors(views)
    }
    assert rule_errors({"CC": views["CC"]}) == []


def test_targets_out_of_field_or_lattice_are_told():
    view = View("CC", "L")
    compressed = make_compressed(view)
    targets = make_targets(view)
    del targets[3]  # the made-up phantom has no landmarks
    origins = target_origins(compressed.phantom)
    gantry = make_gantry(view)
    assert target_warnings(compressed, targets, origins, gantry) == ()
    lost = [*targets[:-1], dataclasses.replace(targets[-1], in_field=False)]
    (note,) = target_warnings(compressed, lost, origins, gantry)
    assert note == "LCC: the nipple is not in the image; no needle can be aimed at it"


@pytest.mark.parametrize("percent", [0.0, 30.0, 75.0, 98.0])
def test_a_lesion_behind_the_chest_wall_edge_is_told_by_its_part_in_the_image(percent):
    """The rays in the plane of that edge are upright: what counts is x alone."""
    view = View("CC", "L")
    compressed = make_compressed(view)
    origins = target_origins(compressed.phantom)
    x_mm = np.linspace(10.0, 20.0, 1000)
    points = np.stack([x_mm, np.zeros(1000), np.zeros(1000)], axis=1)
    origins[0] = dataclasses.replace(origins[0], points_mm=points)
    after = points[:, 0] + compressed.displacement_at(points)[:, 0]
    gantry = make_gantry(view)
    assert target_warnings(compressed, make_targets(view)[:1], origins[:1], gantry) == ()
    edge = float(np.quantile(after, 1.0 - percent / 100.0)) + 1e-6
    behind = dataclasses.replace(gantry, detector_edge_mm=edge)
    (note,) = target_warnings(compressed, make_targets(view)[:1], origins[:1], behind)
    assert note.startswith("LCC: mass 'mass 1': part of the lesion in the image: found ")
    found = float(note.partition("found ")[2].partition(" %")[0])
    assert found == pytest.approx(percent, abs=0.2)


def test_a_speck_that_hangs_on_nothing_is_doubted():
    labels = np.zeros((40, 40, 40), np.uint8)
    labels[:20, 5:35, 5:35] = 1
    labels[34:38, 18:22, 18:22] = 1  # in front of the breast, with nothing between
    breast = phantom(labels, 1.0, [0.5, -19.5, -19.5])
    compressed = compress(breast, view="CC", model="springs", thickness_mm=24.0, resolution_mm=2.0)
    row = make_targets(View("CC", "L"))[-1]
    origins = target_origins(breast)
    (note,) = target_warnings(compressed, [row], origins, make_gantry(View("CC", "L")))
    assert note.startswith("LCC: the nipple is not in the mechanical lattice")
    on_the_skin = dataclasses.replace(origins[-1], points_mm=np.array([[20.5, 0.0, 0.0]]))
    assert target_warnings(compressed, [row], [on_the_skin], make_gantry(View("CC", "L"))) == ()
    left_alone = compress(breast, view="CC", model="none")
    assert target_warnings(left_alone, [row], origins, make_gantry(View("CC", "L"))) == ()
