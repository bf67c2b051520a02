"""Which way a breast looks when its file does not say."""

from __future__ import annotations

import numpy as np
import pytest
from make_phantom import half_ellipsoid_breast
from make_volumes import save_itk

from mammosim.phantom import read_phantom
from mammosim.phantom.chest_wall import find_axes, find_chest_wall
from mammosim.phantom.readers.axes import AXIS_OF_LETTER, are_axes, axes_of_direction
from mammosim.tissues import LABEL_MAPS

MAP = LABEL_MAPS["mammosim"]
LOOKS = [(axis, sense) for axis in range(3) for sense in (1, -1)]
ALL_AXES = [
    a + b + c for a in AXIS_OF_LETTER for b in AXIS_OF_LETTER for c in AXIS_OF_LETTER
    if are_axes(a + b + c)
]  # fmt: skip


def looking(values: np.ndarray, axis: int, sense: int) -> np.ndarray:
    """[x, y, z] with x along an axis, the others in their order."""
    turned = np.moveaxis(values, 0, axis)
    return turned if sense > 0 else np.flip(turned, axis)


def determinant(axes: str) -> float:
    matrix = np.zeros((3, 3))
    for file_axis, letter in enumerate(axes):
        axis, sense = AXIS_OF_LETTER[letter]
        matrix[axis, file_axis] = sense
    return round(float(np.linalg.det(matrix)))


@pytest.mark.parametrize(("axis", "sense"), LOOKS)
@pytest.mark.parametrize("muscle_mm", [0.0, 8.0])
def test_a_breast_without_nipple_is_found_by_its_chest_wall(axis, sense, muscle_mm):
    labels = half_ellipsoid_breast(muscle_mm=muscle_mm).labels
    found = find_chest_wall(looking(labels, axis, sense), MAP)
    assert found == (axis, sense)


@pytest.mark.parametrize(("axis", "sense"), LOOKS)
def test_the_nipple_decides_where_there_is_one(axis, sense):
    labels = np.ones((20, 24, 22), np.uint8)  # no face is cut flat, or all are
    labels[18:, 11:13, 10:12] = 33
    assert find_chest_wall(looking(labels, axis, sense), MAP) == (axis, sense)


def test_specks_and_air_do_not_hide_the_chest_wall():
    labels = np.pad(half_ellipsoid_breast().labels, 9)
    labels[2, 3, 4] = labels[-2, 40, 20] = 1
    assert find_chest_wall(labels, MAP) == (0, 1)


@pytest.mark.parametrize("values", [np.zeros((5, 6, 7)), np.ones((5, 6, 7))])
def test_where_there_is_nothing_to_see_nothing_is_found(values):
    assert find_chest_wall(values.astype(np.uint8), MAP) is None


def test_a_ball_has_no_chest_wall():
    index = np.indices((30, 30, 30)) - 14.5
    ball = (np.linalg.norm(index, axis=0) < 12).astype(np.uint8)
    assert find_chest_wall(ball, MAP) is None


@pytest.mark.parametrize(("axis", "sense"), LOOKS)
def test_axes_found_look_forward_and_are_right_handed(axis, sense):
    letters = find_axes((axis, sense))
    assert letters[axis] == ("A" if sense > 0 else "P")
    assert determinant(letters) == determinant("ALS") == 1
    assert "S" in letters


@pytest.mark.parametrize(("axis", "sense"), LOOKS)
def test_a_bare_array_is_turned_forward_and_never_mirrored(tmp_path, axis, sense):
    labels = half_ellipsoid_breast().labels
    labels[8:12, 40:50, 10:30] = 88  # so that a mirrored breast would show
    np.save(tmp_path / "b.npy", looking(labels, axis, sense))
    breast = read_phantom(tmp_path / "b.npy")
    nipple = breast.frame.index(breast.nipple_mm)
    assert nipple[0] > 0.8 * breast.labels.shape[0]
    assert any("the chest wall and nipple were found" in note for note in breast.notes)
    # All twelve right-handed turns that look forward keep this triple product's sign.
    was, now = (_triple_product(array) for array in (looking(labels, axis, sense), breast.labels))
    assert np.sign(was) == np.sign(now)


def _triple_product(labels: np.ndarray) -> float:
    """Of three directions that the array itself shows: its sign is that of its handedness."""
    tissue = np.argwhere(labels > 0).mean(axis=0)
    mark = np.argwhere(labels == 88).mean(axis=0) - tissue
    front = np.argwhere(labels == 2).mean(axis=0) - tissue
    long = np.argwhere(labels == 88)
    spread = np.linalg.eigh(np.cov(long.T))[1][:, 2]
    return float(np.linalg.det(np.stack([mark, front, spread * np.sign(spread @ mark)])))


@pytest.mark.parametrize("axes", ["LSA", "PLS"])
def test_a_header_that_seems_wrong_is_followed_and_noted(tmp_path, axes):
    labels = half_ellipsoid_breast().labels
    breast = read_phantom(save_itk(tmp_path / "b.nrrd", labels, axes))
    where = [AXIS_OF_LETTER[letter] for letter in axes]
    values = labels[tuple(slice(None, None, sense) for _, sense in where)]
    expected = values.transpose(np.argsort([axis for axis, _ in where]))
    np.testing.assert_array_equal(breast.labels, expected)
    assert any("but its chest wall suggests ALS" in note for note in breast.notes)
    right = read_phantom(tmp_path / "b.nrrd", axes="ALS")
    np.testing.assert_array_equal(right.labels, labels)
    assert not any("chest wall" in note for note in right.notes)


def test_a_header_that_fits_is_not_noted(tmp_path):
    breast = read_phantom(save_itk(tmp_path / "b.nrrd", half_ellipsoid_breast().labels))
    assert not any("chest wall" in note for note in breast.notes)
    assert breast.orientation.startswith("axes run ALS by its header")


def test_there_are_48_ways_to_lie():
    assert len(ALL_AXES) == 48
    assert sum(determinant(axes) == 1 for axes in ALL_AXES) == 24


@pytest.mark.parametrize("axes", ALL_AXES)
def test_letters_and_cosines_say_the_same(tmp_path, axes):
    lps = {"L": (1, 0, 0), "R": (-1, 0, 0), "P": (0, 1, 0), "A": (0, -1, 0), "S": (0, 0, 1),
           "I": (0, 0, -1)}  # fmt: skip
    direction = np.array([lps[letter] for letter in axes], float).T
    assert axes_of_direction(direction, tmp_path) == axes
