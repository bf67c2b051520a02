"""The compression room as a user sees it: compress(), its field, its measures, its errors."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from make_phantom import half_ellipsoid_breast

import mammosim
from mammosim.compression import compress, hyperelastic_model, spring_model
from mammosim.compression.lattice import (
    breast_volume_ml,
    build_lattice,
    posterior_limits,
    tissue_mean,
)
from mammosim.compression.plate_balance import PlateForces
from mammosim.compression.plates import population_thickness_mm
from mammosim.compression.plates.placement import _thickness_mm
from mammosim.compression.settings import CompressionSettings
from mammosim.geometry import View
from mammosim.phantom import as_held
from mammosim.tissues import Moduli, stiffness_kpa


@pytest.fixture(scope="module")
def breast():
    return half_ellipsoid_breast()


@pytest.fixture(scope="module")
def compressed(breast):
    return compress(breast, "CC", model="springs", thickness_mm=32.0, resolution_mm=2.0)


def tissue_points(breast, step: int = 3) -> np.ndarray:
    index = np.argwhere(breast.labels[::step, ::step, ::step] > 0) * step
    return breast.frame.position_mm(index)


def test_tissue_lies_between_the_plates(breast, compressed):
    points = tissue_points(breast)
    moved = points + compressed.displacement_at(points)
    between = moved[:, 0] > compressed.plate_edge_mm
    # Nodes are bounded; the fine surface may stand out by half a node spacing.
    assert moved[between, 2].min() > compressed.support_z_mm - 1.0
    assert moved[between, 2].max() < compressed.paddle_z_mm + 1.0
    assert compressed.thickness_mm == 32.0


def test_chest_wall_stays(breast, compressed):
    wall = breast.frame.position_mm(np.argwhere(breast.labels[:1] > 0))
    assert np.abs(compressed.displacement_at(wall)).max() < 1e-6


def test_volume_is_kept_roughly_and_reported(compressed):
    assert 0.85 < compressed.measures["volume_ratio"] < 1.05
    assert compressed.force_n > 0.0
    assert compressed.measures["pressure_kpa"] == pytest.approx(
        1e3 * compressed.force_n / compressed.measures["contact_area_mm2"]
    )
    assert compressed.converged
    assert compressed.history.size > 0


def test_original_point_is_the_inverse(breast, compressed):
    points = tissue_points(breast)
    back = compressed.original_point(points + compressed.displacement_at(points))
    missed = np.linalg.norm(back - points, axis=1)
    # Cells that the model folds near the plates' edge have several originals; all others are exact.
    assert np.isfinite(missed).all()
    assert (missed < 1e-4).mean() > 0.98


def test_original_point_is_unknown_where_no_tissue_came(compressed):
    assert np.isnan(compressed.original_point([[10.0, 0.0, 60.0], [500.0, 0.0, 0.0]])).all()


def test_displacement_is_finite_one_cell_around_the_tissue(breast, compressed):
    points = tissue_points(breast, 1)
    for shift in np.vstack([np.eye(3), -np.eye(3)]) * 2.0:
        assert np.isfinite(compressed.displacement_at(points + shift)).all()


def test_deformation_gradient_is_that_of_the_displacement(compressed):
    points = np.array([[12.3, 4.1, -3.2], [20.4, -9.7, 6.6]])
    gradient = compressed.field.deformation_gradient_at(points)
    step = 1e-4
    for axis in range(3):
        shift = np.eye(3)[axis] * step
        ahead, behind = (compressed.displacement_at(points + sign * shift) for sign in (1, -1))
        expected = (ahead - behind) / (2 * step) + np.eye(3)[axis]
        # Single-precision displacements of 10 mm over a difference of 0.2 um.
        np.testing.assert_allclose(gradient[:, :, axis], expected, atol=1e-5)


@pytest.mark.parametrize("laterality", ["L", "R"])
@pytest.mark.parametrize("view", ["CC", "MLO", "ML"])
def test_plates_squeeze_along_their_normal(laterality, view):
    compressed = compress(
        half_ellipsoid_breast(laterality),
        view,
        model="springs",
        thickness_mm=36.0,
        resolution_mm=3.0,
    )
    normal = compressed.view.rotation.T @ [0.0, 0.0, 1.0]
    medial = 1.0 if laterality == "R" else -1.0
    angle = {"CC": 0.0, "MLO": np.pi / 4, "ML": np.pi / 2}[view]
    np.testing.assert_allclose(normal, [0, medial * np.sin(angle), np.cos(angle)], atol=1e-12)
    above, below = compressed.displacement_at(
        np.outer([18.0, -18.0], normal) + np.array([15.0, 0, 0])
    )
    assert above @ normal < -2.0
    assert below @ normal > 2.0


def test_left_and_right_breasts_are_mirror_images():
    fields = []
    for laterality in "LR":
        breast = half_ellipsoid_breast(laterality)
        fields.append(
            compress(breast, "MLO", model="springs", thickness_mm=36.0, resolution_mm=3.0)
        )
    points = tissue_points(half_ellipsoid_breast())
    mirror = np.array([1.0, -1.0, 1.0])
    left, right = fields[0].displacement_at(points), fields[1].displacement_at(points * mirror)
    # The solver's tolerance, 0.001 of 3 mm, and a few nodes at the plates' edge.
    assert np.median(np.abs(left - right * mirror)) < 3e-3


def test_solvers_give_the_same_displacement(breast, compressed):
    relaxed = compress(
        breast, "CC", model="springs", thickness_mm=32.0, resolution_mm=2.0, solver="relaxation"
    )
    points = tissue_points(breast)
    gap = compressed.displacement_at(points) - relaxed.displacement_at(points)
    assert np.linalg.norm(gap, axis=1).mean() < 0.1 * 2.0
    assert {"sum_dx_voxel", "nodes_counted"} <= set(relaxed.history.dtype.names)


def test_plates_can_be_given_by_their_heights(breast):
    compressed = compress(
        breast, "CC", model="springs", support_z_mm=-16.0, paddle_z_mm=18.0, resolution_mm=3.0
    )
    assert (compressed.support_z_mm, compressed.paddle_z_mm) == (-16.0, 18.0)


def test_thickness_follows_the_population_and_says_so(breast):
    volume = breast_volume_ml(breast)
    compressed = compress(breast, "CC", model="springs", resolution_mm=3.0)
    assert compressed.thickness_mm == pytest.approx(population_thickness_mm("CC", volume), abs=0.1)
    assert any("population fit" in note for note in compressed.notes)


def test_a_thickness_that_the_breasts_height_limits_says_so(breast):
    view, fitted = View("CC", "L"), population_thickness_mm("CC", breast_volume_ml(breast))
    for height_mm, expected in ((200.0, fitted), (10.0, 8.0)):
        thickness, (note,) = _thickness_mm(CompressionSettings(), breast, view, height_mm)
        assert thickness == pytest.approx(expected)
        assert (f"80 % of the breast's height between the plates ({height_mm:.1f} mm)" in note) == (
            thickness < fitted
        )
        assert f"{expected:.1f} mm" in note
        assert "the population fit for a breast of" in note
        assert "towards the axilla" not in note  # this breast ends at its own outline


def test_the_volume_of_an_oblique_view_is_said_to_hold_the_way_to_the_axilla():
    breast = mammosim.generate_phantom("fatty", 4.0, 1, volume_ml=350.0)
    for name, extent in (("MLO", ", counted with the tissue towards the axilla"), ("CC", "")):
        view = View(name, "L")
        held = as_held(breast, view.rotation[1])
        _, (note,) = _thickness_mm(CompressionSettings(), held, view, 200.0)
        volume = f"a breast of {breast_volume_ml(held):.0f} mL"
        assert note.endswith(f"the population fit for {volume}{extent}")


def test_a_force_finds_its_thickness(breast):
    wanted = compress(breast, "CC", model="springs", thickness_mm=34.0, resolution_mm=3.0)
    found = compress(breast, "CC", model="springs", force_n=wanted.force_n, resolution_mm=3.0)
    assert found.force_n == pytest.approx(wanted.force_n, rel=0.01)
    # 1 % of force, where force grows roughly linearly over 15 mm of squeeze.
    assert found.thickness_mm == pytest.approx(34.0, abs=0.5)


def test_a_force_that_springs_cannot_bear_names_the_largest(breast):
    with pytest.raises(
        mammosim.InputError, match=r"force_n: found 500 N.*supports at most [\d.]+ N"
    ):
        compress(breast, "CC", model="springs", force_n=500.0, resolution_mm=3.0)


def test_muscle_is_held_or_soft():
    breast = half_ellipsoid_breast(muscle_mm=8.0)
    point = [[7.0, 0.0, 14.0]]
    held = compress(
        breast, "CC", model="springs", thickness_mm=36.0, resolution_mm=2.0, muscle="fixed"
    )
    soft = compress(
        breast, "CC", model="springs", thickness_mm=36.0, resolution_mm=2.0, muscle="soft"
    )
    assert np.abs(held.displacement_at(point)).max() < 1e-6
    assert np.abs(soft.displacement_at(point)).max() > 0.5
    assert held.plate_edge_mm == pytest.approx(13.0)
    assert soft.plate_edge_mm == pytest.approx(5.0)


def test_muscle_left_out_depends_on_how_far_it_reaches():
    slab = compress(
        half_ellipsoid_breast(muscle_mm=8.0),
        "CC",
        model="springs",
        thickness_mm=36.0,
        resolution_mm=3.0,
    )
    wedge = compress(
        half_ellipsoid_breast(muscle_mm=22.0),
        "CC",
        model="springs",
        thickness_mm=36.0,
        resolution_mm=3.0,
    )
    assert slab.plate_edge_mm == pytest.approx(13.0)
    assert wedge.plate_edge_mm == pytest.approx(5.0)


def test_model_none_moves_nothing(breast):
    compressed = compress(breast, "MLO", model="none")
    points = tissue_points(breast)
    assert not compressed.displacement_at(points).any()
    # Single-precision places of the inverse map, polished by Newton steps.
    np.testing.assert_allclose(compressed.original_point(points), points, atol=1e-5)
    assert compressed.force_n == 0.0


def test_lattice_has_the_moduli_and_the_volume_of_the_phantom(breast):
    lattice = build_lattice(breast, View("CC", "L"), 2.0, Moduli("thesis"))
    volume = lattice.tissue.sum() * 8.0 * 1e-3
    # Blocks of 2 mm along a surface of radius 28 mm.
    assert volume == pytest.approx(breast_volume_ml(breast), rel=0.03)
    moduli = lattice.modulus[lattice.tissue]
    assert moduli.min() == pytest.approx(4.5)
    assert moduli.max() == pytest.approx(16.0, abs=1.0)
    assert lattice.frame.origin_mm[0] == pytest.approx(posterior_limits(breast).chest_wall_mm - 1.0)


def test_a_property_of_the_tissues_is_averaged_as_the_modulus_is(breast):
    view = View("MLO", "L")
    lattice = build_lattice(breast, view, 2.0, Moduli("thesis"))
    again = tissue_mean(breast, view, lattice, lambda tissue: stiffness_kpa(tissue, "thesis"))
    np.testing.assert_array_equal(again, lattice.modulus)
    ones = tissue_mean(breast, view, lattice, lambda tissue: 1.0)
    np.testing.assert_array_equal(ones, lattice.tissue)


def test_rotated_lattice_holds_the_same_breast(breast):
    straight, turned = (
        build_lattice(breast, View(name, "L"), 2.0, Moduli("thesis")) for name in ("CC", "MLO")
    )
    assert turned.tissue.sum() == pytest.approx(straight.tissue.sum(), rel=0.02)


def test_tissue_that_hangs_on_nothing_is_left_out_and_said():
    breast = half_ellipsoid_breast()
    labels = breast.labels.copy()
    labels[26:30, 2:6, 2:6] = 1
    apart = mammosim.BreastPhantom(
        labels, breast.voxel_mm, breast.origin_mm, "L", breast.tissue_of_label, breast.nipple_mm
    )
    lattice = build_lattice(apart, View("CC", "L"), 2.0, Moduli("thesis"))
    assert any("not connected to the chest wall" in note for note in lattice.notes)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"thickness_mm": 90.0}, r"thickness_mm: found 90, but the breast .* is only \d+"),
        (
            {"thickness_mm": -3.0},
            r"found -3.0, expected greater than or equal to 1",
        ),
        ({"thicknes_mm": 30.0}, r"unknown key; did you mean 'thickness_mm'"),
        (
            {"model": "jelly"},
            r"compression.model: found 'jelly', expected 'springs', 'hyperelastic' or 'none'",
        ),
        (
            {"stiffness_kpa": {"jelly": 1.0}},
            r"compression.stiffness_kpa: .*unknown tissue jelly; expected one of adipose, artery",
        ),
        ({"stiffness_kpa": {"skin": 0.0}}, r"compression.stiffness_kpa.skin"),
        (
            {"stiffness": "steel"},
            r"compression.stiffness: found .steel., expected one of aspiration, krouskop, thesis",
        ),
        ({"thickness_mm": 30.0, "force_n": 5.0}, r"give one of thickness_mm, force_n"),
        ({"paddle_z_mm": 30.0}, r"given together or not at all"),
        ({"paddle_z_mm": -30.0, "support_z_mm": 0.0}, r"must be greater than support_z_mm"),
        ({"plate_edge_mm": 80.0}, r"plate_edge_mm: found 80, but tissue extends only to"),
        (
            {"resolution_mm": "fine"},
            r"compression.resolution_mm: found 'fine', expected a valid number",
        ),
        ({"model": "none", "thickness_mm": 30.0}, r"'none' does not compress"),
    ],
)
def test_bad_settings_say_what_is_allowed(settings, message, breast):
    with pytest.raises(mammosim.InputError, match=message):
        compress(breast, "CC", **settings)


def test_unknown_view(breast):
    with pytest.raises(
        mammosim.InputError, match="view: found 'XCCL', expected one of CC, MLO, ML"
    ):
        compress(breast, "XCCL")


def test_a_breast_of_air_is_refused(breast):
    air = mammosim.BreastPhantom(
        np.zeros_like(breast.labels), breast.voxel_mm, breast.origin_mm, "L", {0: "air"},
        breast.nipple_mm, source="air.mhd",
    )  # fmt: skip
    with pytest.raises(mammosim.InputError, match=r"air.mhd: no tissue"):
        compress(air, "CC", thickness_mm=30.0)


def test_not_converged_carries_what_was_reached(breast):
    with pytest.raises(mammosim.NotConverged, match="LCC: relaxation stopped") as caught:
        compress(
            breast,
            "CC",
            model="springs",
            thickness_mm=32.0,
            resolution_mm=3.0,
            solver="relaxation",
            max_sweeps=5,
        )
    assert not caught.value.reached.converged
    assert caught.value.reached.history.size == 5


def test_interruption_carries_what_was_reached(breast):
    def stop(row):
        raise KeyboardInterrupt

    for solver in ("multigrid", "relaxation"):
        with pytest.raises(
            mammosim.Interrupted, match="LCC: compression was interrupted"
        ) as caught:
            compress(
                breast,
                "CC",
                model="springs",
                thickness_mm=32.0,
                resolution_mm=3.0,
                solver=solver,
                watch=stop,
            )
        assert caught.value.reached.interrupted


@pytest.mark.parametrize("search", ["springs", "hyperelastic", "force"])
def test_interruption_while_the_plates_height_is_sought(search, breast, monkeypatch):
    """Nothing has been compressed yet, or to another force: that is what was reached."""
    keys = {"model": "springs", "thickness_mm": 32.0, "resolution_mm": 6.0}
    tried = []

    def stop(self, plates):
        if search == "force" and not tried:
            tried.append(plates)
            return PlateForces(1.0, 1.0)
        raise KeyboardInterrupt

    if search == "hyperelastic":
        keys |= {"model": search}
        monkeypatch.setattr(hyperelastic_model._CoarseBody, "forces", stop)
    else:
        forces = partial(stop, None)
        monkeypatch.setattr(spring_model, "_coarse_forces", lambda case: forces)
    if search == "force":
        keys |= {"thickness_mm": None, "force_n": 1e3}
    with pytest.raises(mammosim.Interrupted, match="LCC: compression was interrupted") as caught:
        compress(breast, "CC", **keys)
    reached = caught.value.reached
    assert reached.interrupted
    assert not reached.converged
    assert (reached.force_n > 0.0) == (search == "force")
    assert np.isfinite(reached.displacement_at(np.array([[10.0, 0.0, 0.0]]))).all()


def test_interruption_before_anything_is_compressed(breast, monkeypatch):
    def stop(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(spring_model, "make_case", stop)
    with pytest.raises(mammosim.Interrupted, match="LCC: compression was interrupted") as caught:
        compress(breast, "CC", model="springs", thickness_mm=32.0)
    assert caught.value.reached is None
