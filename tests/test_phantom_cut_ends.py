"""Where a breast from a file is cut off though the body goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

import mammosim
from mammosim.export.label_files import table_of_phantom, write_label_files
from mammosim.geometry import View, VoxelFrame
from mammosim.phantom import PhantomSettings, leaves_picture, phantom_summary, without_open_end
from mammosim.phantom._cut_kernels import count_faces, count_places
from mammosim.phantom.cut_ends import find_open_end


@pytest.fixture(scope="module")
def generated():
    return mammosim.generate_phantom(density="fatty", voxel_mm=1.0, volume_ml=300.0, seed=3)


@pytest.fixture(scope="module")
def reread(generated, tmp_path_factory):
    """The same breast from a file of labels alone."""
    path = tmp_path_factory.mktemp("file") / "breast.npz"
    np.savez(
        path, labels=generated.labels, voxel_mm=generated.voxel_mm, origin_mm=generated.origin_mm
    )
    return mammosim.read_phantom(path, laterality="L")


def ellipsoid(skin_mm: float = 2.0, *, beyond_mm: float = 0.0) -> tuple[np.ndarray, VoxelFrame]:
    """Half a ball of 50 mm with skin, its array ending as far beyond it along +z."""
    shape = (55, 110, 55 + int(50 + beyond_mm))
    frame = VoxelFrame(np.array([0.5, -54.5, -54.5]), np.ones(3), shape)
    x, y, z = np.ix_(*(frame.axis_mm(axis) for axis in range(3)))
    radius = np.sqrt(x**2 + y**2 + z**2)
    labels = np.where(radius < 50.0, 1, 0).astype(np.uint8)
    labels[(radius < 50.0) & (radius > 50.0 - skin_mm)] = 2
    return labels, frame


NIPPLE_MM = np.array([49.5, 0.0, 0.0])


def test_faces_agree_with_shifted_arrays():
    labels = np.random.default_rng(4).integers(0, 4, (4, 6, 7)).astype(np.uint8)
    covers = np.zeros(256, bool)
    covers[2] = True
    faces = np.zeros((4, 4, 3), np.int64)
    count_faces(labels, covers, faces)
    places = np.zeros((4, 40), np.int64)
    y, z = 1.5 * np.arange(6), 2.0 * np.arange(7)
    count_places(labels, covers, y, z, places)
    at = np.floor(y[:, None] + z).astype(int)
    expected_places = np.zeros_like(places)
    for way, (axis, step) in enumerate([(1, -1), (1, 1), (2, -1), (2, 1)]):
        around = np.pad(labels, 1, constant_values=255)
        beside = np.roll(around, -step, axis)[1:-1, 1:-1, 1:-1]
        skin, bare = labels == 2, (labels == 1) | (labels == 3)
        for kind, found in enumerate(
            [skin & (beside == 0), bare & (beside == 0), bare & (beside == 255)]
        ):
            np.testing.assert_array_equal(faces[:, way, kind], found.sum(axis=(1, 2)))
        for i, j, k in np.argwhere(bare & (beside == 0)):
            expected_places[i, at[j, k]] += 1
    np.testing.assert_array_equal(places, expected_places)


def test_the_cut_towards_the_axilla_is_found_in_a_file_of_labels(generated, reread):
    end, known = reread.open_end, generated.open_end
    assert end is not None
    assert end.normal @ known.normal > 0.999
    assert end.point_mm @ end.normal == pytest.approx(known.point_mm @ known.normal, abs=1.0)
    assert end.skin_mm == pytest.approx(known.skin_mm, rel=0.35)
    assert any("cut tissue" in note for note in reread.notes)
    assert end.standing == 1.0  # nobody says how far its muscle stands off in other views


def test_a_file_beside_its_table_gives_the_same_muscle_in_other_views(generated, tmp_path):
    np.savez(
        tmp_path / "breast.npz",
        labels=generated.labels,
        voxel_mm=generated.voxel_mm,
        origin_mm=generated.origin_mm,
    )
    write_label_files(table_of_phantom(generated), ("breast.npz",), tmp_path)
    end = mammosim.read_phantom(tmp_path / "breast.npz").open_end
    assert end is not None
    assert end.standing == generated.open_end.standing < 1.0
    table = tmp_path / "labels.json"
    table.write_text(table.read_text().replace(f": {end.standing}", ": 3"))
    with pytest.raises(mammosim.InputError, match=r"muscle_standing 3, expected above 0"):
        mammosim.read_phantom(tmp_path / "breast.npz")


def test_other_views_leave_out_what_leads_to_the_axilla(generated, reread):
    """The surface that replaces it is the breast's own within some millimetres."""
    held, known = without_open_end(reread), without_open_end(generated)
    volume, expected = ((breast.labels != 0).sum() for breast in (held, known))
    assert volume == pytest.approx(expected, rel=0.12)
    ends = [breast.labels.any(axis=0) for breast in (held, known)]
    tops = [
        breast.origin_mm[1:] + np.argwhere(end).max(axis=0) * breast.voxel_mm[1:]
        for breast, end in zip((held, known), ends, strict=True)
    ]
    np.testing.assert_allclose(*tops, atol=12.0)
    assert held.open_end is None
    bare = np.zeros((held.labels.shape[0], 4, 3), np.int64)
    covers = np.isin(np.arange(256), [2, 33])
    count_faces(held.labels, covers, bare)
    assert bare[10:, :, 1:].sum() < 0.02 * bare[10:, :, 0].sum()  # skin closes it


def test_its_volume_does_not_depend_on_where_it_lies(reread):
    shift_mm = np.array([0.0, -300.0, 50.0])
    moved = replace(
        reread, origin_mm=reread.origin_mm + shift_mm, nipple_mm=reread.nipple_mm + shift_mm
    )
    labels, voxel_mm = reread.labels, reread.voxel_mm
    frame = VoxelFrame(moved.origin_mm, voxel_mm, labels.shape)
    end, _ = find_open_end(labels, frame, moved.nipple_mm, "auto")
    here, there = (phantom_summary(b) for b in (reread, replace(moved, open_end=end)))
    assert here.breast_ml == pytest.approx(there.breast_ml, rel=1e-9)


def test_oblique_views_end_there_and_others_do_not(reread):
    assert leaves_picture(reread, View("MLO", "L").rotation[1])
    assert not leaves_picture(reread, View("CC", "L").rotation[1])


def test_a_closed_breast_has_no_open_end():
    assert find_open_end(*ellipsoid(beyond_mm=5.0), NIPPLE_MM, "auto") == (None, ())


def test_a_breast_may_end_where_its_array_does():
    labels, frame = ellipsoid(beyond_mm=-12.0)
    end, notes = find_open_end(labels, frame, NIPPLE_MM, "auto")
    assert end is not None
    np.testing.assert_allclose(end.normal, [0, 0, 1])
    np.testing.assert_allclose(end.point_mm, [0, 0, 38.0])
    assert end.skin_mm == pytest.approx(2.0, rel=0.15)
    assert len(notes) == 1
    assert find_open_end(labels, frame, NIPPLE_MM, "none") == (None, ())


def test_without_any_skin_only_the_end_of_the_array_counts():
    labels, frame = ellipsoid(skin_mm=0.0, beyond_mm=-12.0)
    end, _ = find_open_end(labels, frame, NIPPLE_MM, "auto")
    assert end is not None
    assert end.skin_mm == 0.0
    closed, frame = ellipsoid(skin_mm=0.0, beyond_mm=5.0)
    assert find_open_end(closed, frame, NIPPLE_MM, "auto") == (None, ())


def test_a_breast_cut_off_beside_its_nipple_is_left_as_it_is_and_said():
    labels, frame = ellipsoid(beyond_mm=-35.0)
    end, notes = find_open_end(labels, frame, NIPPLE_MM, "auto")
    assert end is None
    assert "too near to the nipple" in notes[0]


def test_the_larger_of_two_ends_counts_and_the_other_is_said():
    labels, frame = ellipsoid(beyond_mm=-12.0)
    end, notes = find_open_end(labels[:, :96], frame, NIPPLE_MM, "auto")
    assert end is not None
    assert "also ends in cut tissue" in notes[0]
    np.testing.assert_allclose(end.normal, [0, 0, 1])


def test_skin_with_holes_is_said_to_be_taken_for_the_surface():
    labels, frame = ellipsoid(beyond_mm=5.0)
    rng = np.random.default_rng(2)
    thin = (labels == 2) & (rng.random(labels.shape) < 0.3)
    labels[thin] = 1
    end, notes = find_open_end(labels, frame, NIPPLE_MM, "auto")
    assert end is None
    assert "have no skin" in notes[0]


def test_the_way_out_may_be_given():
    labels, frame = ellipsoid(skin_mm=0.0, beyond_mm=-12.0)
    end, _ = find_open_end(labels, frame, NIPPLE_MM, (0.0, 0.0, 2.0))
    assert end is not None
    np.testing.assert_allclose(end.normal, [0, 0, 1])
    np.testing.assert_allclose(end.point_mm, [0, 0, 38.0])


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_way_that_leads_forward_is_refused(way):
    with pytest.raises(mammosim.InputError, match="direction to the side"):
        find_open_end(*ellipsoid(), NIPPLE_MM, way)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"generate": {}, "open_end": "none"}, "belongs to 'file'"),
        ({"file": "a.mhd", "open_end": [0, 1, 1], "compressed_for": "CC"}, "between plates"),
        ({"file": {"L": "a.mhd", "R": "b.mhd"}, "open_end": [0, 1, 1]}, "both sides"),
        ({"file": "a.mhd", "open_end": "axilla"}, "auto, none, or the way"),
        ({"file": "a.mhd", "open_end": [0, 1]}, "auto, none, or the way"),
        ({"file": "a.mhd", "open_end": [0, 1, float("nan")]}, "auto, none, or the way"),
        ({"file": "a.mhd", "open_end": [1, 0, 0]}, "direction to the side"),
    ],
)
def test_an_open_end_that_makes_no_sense_is_refused(keys, message):
    with pytest.raises(ValidationError, match=message):
        PhantomSettings.model_validate(keys)
