"""Numbers beside marks: none covers another, nor its own mark, however near the marks are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mammosim.report.labels import BASELINE, LETTER_HEIGHT, LETTER_WIDTH, Marked, place_labels

BOX = (-10.0, 5.0, 100.0, 140.0)
SIZE = 4.0


def boxes(labels, places):
    """Left, top, right and bottom of the letters of each number, [mark, 4], in one state."""
    found = []
    for label, (x, y) in zip(labels, places, strict=True):
        half_width = 0.5 * LETTER_WIDTH * label.size * len(label.text)
        middle = y + label.y - BASELINE * label.size
        half_height = 0.5 * LETTER_HEIGHT * label.size
        found.append((x + label.x - half_width, middle - half_height,
                      x + label.x + half_width, middle + half_height))  # fmt: skip
    return np.array(found)


def check_clear(labels, places, radii, box=BOX):
    """No number on another, on its own circle, or out of the drawing."""
    found = boxes(labels, places)
    for one, other in itertools.combinations(found, 2):
        assert (one[:2] >= other[2:]).any() or (other[:2] >= one[2:]).any()
    for (left, top, right, bottom), (x, y), radius in zip(found, places, radii, strict=True):
        assert np.hypot(np.clip(x, left, right) - x, np.clip(y, top, bottom) - y) >= radius
    assert (found[:, :2] >= np.array(box[:2])).all()
    assert (found[:, 2:] <= np.add(box[:2], box[2:])).all()


def placed(places, radii, sizes=None, **others):
    texts = [str(number + 1) for number in range(len(radii))]
    marked = Marked(places, radii, BOX, **others)
    return place_labels(marked, texts, sizes or [SIZE] * len(radii), (1.0, 0.0))


@pytest.mark.parametrize("spread_mm", [0.0, 2.0, 10.0, 40.0])
def test_thirty_marks_however_near_keep_their_numbers_apart(spread_mm):
    """From thirty on one spot to thirty all over the drawing."""
    rng = np.random.default_rng(round(spread_mm))
    places = np.array([40.0, 75.0]) + spread_mm * rng.uniform(-1.0, 1.0, (30, 2))
    radii = rng.uniform(1.0, 7.0, 30)
    labels = placed([places], radii)
    check_clear(labels, places, radii)
    assert labels == placed([places], radii)
    # What is far from its mark is tied to it.
    far = [label for label in labels if np.hypot(label.x, label.y) > 7.0 + 3.0 * SIZE]
    assert all(label.lead for label in far)


def test_a_number_alone_stands_where_it_is_wanted():
    (alone,) = placed([[(20.0, 40.0)]], [3.0])
    assert alone.x > 3.0
    assert alone.y == pytest.approx(BASELINE * SIZE)
    assert alone.lead == ()


def test_numbers_keep_clear_in_every_state_of_marks_that_move():
    """Two marks that pass one another, as under the slider."""
    states = np.array([[[20.0 + s, 50.0], [40.0 - s, 53.0]] for s in np.linspace(0.0, 20.0, 9)])
    labels = placed(states, [1.0, 1.0])
    for places in states:
        check_clear(labels, places, [1.0, 1.0])


def test_lines_other_marks_and_other_texts_are_spared():
    places, radii = np.array([[20.0, 40.0]]), [2.0]
    right = placed([places], radii)[0]
    line = [[(x, 40.0) for x in np.linspace(22.0, 40.0, 12)]]
    other = placed([[(20.0, 40.0), (26.0, 40.0)]], [2.0, 3.0])[0]
    text = placed([places], radii, taken=[(28.0, 40.0, 10.0, 3.0)])[0]
    for label in (placed([places], radii, lines=line)[0], other, text):
        assert (label.x, label.y) != (right.x, right.y)
        _, top, right_end, bottom = boxes([label], places)[0]
        assert right_end <= 22.0 or bottom <= 40.0 or top >= 40.0


def test_a_drawing_without_marks_has_no_numbers():
    assert place_labels(Marked([[]], [], BOX), [], [], (1.0, 0.0)) == []
