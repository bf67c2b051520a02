"""What a read breast shows: bodies, nipple, side, and the lesions it brings along."""

from __future__ import annotations

import numpy as np
import pytest

from mammosim.errors import InputError
from mammosim.geometry import VoxelFrame
from mammosim.phantom import phantom_summary, read_phantom
from mammosim.phantom.found_lesions import number_lesions
from mammosim.phantom.lesion_pieces import bounding_box
from mammosim.phantom.orientation import nipple_position, side_of_muscle
from mammosim.tissues import LESION_LABELS


def frame_of(labels, voxel_mm=1.0):
    return VoxelFrame(np.array([1.0, 2.0, 3.0]), np.full(3, voxel_mm), labels.shape)


def test_the_tip_of_a_speck_is_not_the_nipple():
    labels = np.zeros((12, 9, 9), np.uint8)
    labels[:6, 2:7, 2:7] = 1
    labels[6, 4, 5] = 1
    labels[11, 0, 0] = 1
    frame = frame_of(labels)
    position, labelled = nipple_position(labels, frame)
    assert not labelled
    np.testing.assert_allclose(position, frame.position_mm([6, 4, 5]))


def test_nipple_is_the_middle_of_its_foremost_voxels():
    labels = np.zeros((12, 9, 9), np.uint8)
    labels[:6] = 1
    labels[4:8, 3:6, 2:5] = 33
    frame = frame_of(labels, 0.5)
    position, labelled = nipple_position(labels, frame)
    assert labelled
    np.testing.assert_allclose(position, frame.position_mm([7, 4, 3]))


@pytest.mark.parametrize(("thicker_towards", "side"), [(1, "R"), (-1, "L"), (0, None)])
def test_side_by_the_muscle_below_the_nipple(thicker_towards, side):
    labels = np.zeros((12, 20, 16), np.uint8)
    labels[:10] = 1
    labels[:3, :, :8] = 40
    if thicker_towards:
        half = slice(10, None) if thicker_towards > 0 else slice(None, 10)
        labels[:6, half, :8] = 40
    # Above the nipple the muscle may do the opposite.
    labels[:9, slice(None, 10) if thicker_towards > 0 else slice(10, None), 9:] = 40
    frame = frame_of(labels)
    assert side_of_muscle(labels, frame, frame.position_mm([10, 10, 8])) == side


def test_no_muscle_tells_no_side(tmp_path):
    labels = np.zeros((8, 8, 8), np.uint8)
    labels[:6, 1:7, 1:7] = 1
    np.save(tmp_path / "b.npy", labels)
    breast = read_phantom(tmp_path / "b.npy")
    assert breast.laterality == "L"
    assert any("no muscle wedge tells which breast it is: left" in note for note in breast.notes)
    assert any("no nipple is labelled" in note for note in breast.notes)
    assert read_phantom(tmp_path / "b.npy", laterality="R").laterality == "R"


def test_a_label_is_boxed():
    labels = np.zeros((8, 9, 10), np.uint8)
    labels[2, 7, 1] = labels[5, 3, 8] = 200
    assert bounding_box(labels, 200) == (slice(2, 6), slice(3, 8), slice(1, 9))
    assert bounding_box(labels, 250) is None


def lesioned():
    labels = np.ones((40, 40, 40), np.uint8)
    labels[5:9, 5:9, 5:9] = 200
    labels[9, 9, 9] = 200  # touches by a corner: the same mass
    labels[20:22, 20:22, 20:22] = 200
    for at in ((30, 5, 5), (30, 11, 5), (35, 5, 9)):
        labels[at] = 250  # nearer than 10 mm to each other: a cluster
    labels[5, 35, 35] = 250
    labels[30, 30, 30:33] = 251
    return labels


def test_every_lesion_gets_its_own_label():
    labels = lesioned()
    frame = frame_of(labels)
    lesions = number_lesions(labels, frame, "b.npy")[0]
    assert [lesion.name for lesion in lesions] == [
        "mass 1", "mass 2", "calcification 1", "calcification 2", "clip 1",
    ]  # fmt: skip
    assert [lesion.volume_mm3 for lesion in lesions] == [65, 8, 3, 1, 3]
    assert [lesion.label for lesion in lesions] == list(LESION_LABELS[:5])
    for lesion in lesions:
        voxels = np.argwhere(labels == lesion.label)
        assert len(voxels) == lesion.volume_mm3
        np.testing.assert_allclose(frame.position_mm(voxels.mean(axis=0)), lesion.position_mm)
    assert not np.isin(labels, [200, 250, 251]).any()


def test_calcifications_further_than_a_centimetre_are_two_clusters():
    for gap, clusters in ((10, 1), (11, 2)):
        labels = np.ones((20, 4, 4), np.uint8)
        labels[2, 1, 1] = labels[2 + gap, 1, 1] = 250
        assert len(number_lesions(labels, frame_of(labels), "b")[0]) == clusters


def test_more_lesions_than_labels():
    labels = np.ones((30, 30, 4), np.uint8)
    labels[::2, ::2, 1] = 200
    with pytest.raises(InputError, match=r"b\.npy: holds 225 separate lesions, at most 101"):
        number_lesions(labels, frame_of(labels), "b.npy", 0.0, 0.0)


def test_read_lesions_and_summary(tmp_path):
    np.savez(tmp_path / "b.npz", labels=lesioned(), voxel_mm=[0.5, 1, 2], origin_mm=[0, 0, 0])
    breast = read_phantom(tmp_path / "b.npz")
    assert breast.tissue_of_label[breast.lesions[0].label] == "mass"
    summary = phantom_summary(breast)
    assert summary.shape == (40, 40, 40)
    assert summary.extent_mm == ((-0.25, 19.75), (-0.5, 39.5), (-1.0, 79.0))
    assert summary.volume_ml["mass"] == pytest.approx(0.073)
    assert sum(summary.volume_ml.values()) == pytest.approx(64.0)
    assert summary.fibroglandular_percent == 0.0
    assert summary.lesions == breast.lesions


def test_summary_shares_and_muscle(tmp_path):
    labels = np.zeros((10, 10, 10), np.uint8)
    labels[:2], labels[2:8], labels[8] = 40, 1, 2
    labels[2:5, :, :5] = 29
    np.savez(tmp_path / "b.npz", labels=labels, voxel_mm=np.ones(3), origin_mm=np.zeros(3))
    summary = phantom_summary(read_phantom(tmp_path / "b.npz"))
    assert summary.breast_ml == pytest.approx(0.7)
    assert summary.fibroglandular_percent == pytest.approx(25.0)
    bare = np.full((4, 4, 4), 40, np.uint8)
    np.save(tmp_path / "m.npy", bare)
    assert phantom_summary(read_phantom(tmp_path / "m.npy")).fibroglandular_percent is None
