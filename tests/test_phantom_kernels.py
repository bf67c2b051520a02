"""Kernels on label volumes: bodies joined by faces, and what a view leaves out."""

from __future__ import annotations

import numpy as np
import pytest
from naive import phantom as naive

from mammosim.phantom._body_kernels import count_runs, find_runs
from mammosim.phantom._count_kernels import count_labels
from mammosim.phantom._open_end_kernels import (
    CoarseDepth,
    copy_held,
    held_extent,
    muscle_fronts,
)
from mammosim.phantom.bodies import find_bodies


@pytest.mark.parametrize("filled", [0.05, 0.2, 0.35, 0.6])
@pytest.mark.parametrize("shape", [(6, 7, 8), (1, 9, 9), (9, 1, 9), (9, 9, 1), (12, 10, 11)])
def test_bodies_agree_with_the_twin(filled, shape):
    labels = (np.random.default_rng(5).random(shape) < filled).astype(np.uint8)
    labels[0, 0, 0] = 1
    labels[-1, -1, -1] = 1
    count, apart, foremost = naive.bodies(labels)
    found = find_bodies(labels)
    assert found.specks == count - 1
    assert found.speck_voxels == apart
    if filled == 0.6:  # one body is by far the largest, so that there is no tie
        np.testing.assert_allclose(found.tip_index, foremost)


@pytest.mark.parametrize("shape", [(3, 4, 5), (1, 1, 9), (2, 3, 1)])
def test_runs_are_the_unbroken_stretches_of_each_column(shape):
    labels = (np.random.default_rng(3).random(shape) < 0.6).astype(np.uint8)
    spans, first = [], []
    for column in labels.reshape(-1, shape[2]):
        first.append(len(spans))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], column, [0]])))
        spans += [(start, end - 1) for start, end in zip(edges[::2], edges[1::2], strict=True)]
    first.append(len(spans))
    assert count_runs(labels) == len(spans)
    out_span, out_first = np.zeros((len(spans), 2), np.int32), np.zeros(len(first), np.int64)
    find_runs(labels, out_span, out_first)
    np.testing.assert_array_equal(out_span, np.reshape(spans, (-1, 2)))
    np.testing.assert_array_equal(out_first, first)


def test_what_a_view_leaves_out_agrees_with_the_twin():
    rng = np.random.default_rng(8)
    labels = rng.integers(0, 4, (9, 8, 7)).astype(np.uint8)
    labels[:, 5] = labels[:, :, 6] = 0  # a row and a column without tissue
    cells = [np.arange(size) // 3 for size in labels.shape]
    parts = [(np.arange(size) % 3 / 3.0).astype(np.float32) for size in labels.shape]
    places = [of_axis for pair in zip(cells, parts, strict=True) for of_axis in pair]
    depth = rng.uniform(-3.0, 5.0, (4, 4, 4)).astype(np.float32)
    coarse = CoarseDepth(depth, np.float32(1.5), *places)
    box = np.array([[1, 9], [0, 7], [2, 7]])
    expected = naive.left_out(labels, coarse, box, 0.6, 2.8, 0.7, skin=9, nipple=3, muscle=2, fat=7)
    assert 20 < (expected != labels).sum() < (labels != 0).sum()
    assert (expected == 7).any()
    rows, columns = np.zeros((9, 8), bool), np.zeros((9, 7), bool)
    names = np.array([9, 3, 2, 7], np.uint8)
    given, fronts = labels.copy(), np.zeros((8, 7), np.int32)
    muscle_fronts(labels, names[2], fronts)
    held_extent(coarse, box, np.float32(0.6), names[1], labels, rows, columns)
    np.testing.assert_array_equal(rows, expected.any(axis=2))
    np.testing.assert_array_equal(columns, expected.any(axis=1))
    for first, end in ((np.array([0, 0]), (8, 7)), (np.array([2, 1]), (7, 5))):
        part = np.s_[:, first[0] : end[0], first[1] : end[1]]
        held = np.empty_like(expected[part])
        standing = np.float32(0.7)
        copy_held(
            coarse, box, np.float32(0.6), np.float32(2.8), standing, fronts, names, labels, first,
            held,
        )  # fmt: skip
        np.testing.assert_array_equal(held, expected[part])
    np.testing.assert_array_equal(labels, given)


@pytest.mark.parametrize("shape", [(3, 4, 6), (3, 5, 1)])
def test_labels_of_each_layer_are_counted_in_any_memory_order(shape):
    labels = np.random.default_rng(2).choice(np.array([0, 1, 200, 255], np.uint8), shape)
    labels[1] = 7
    expected = [np.bincount(layer.ravel(), minlength=256) for layer in labels]
    for stored in (labels, np.asfortranarray(labels), labels[:, :, ::-1]):
        counts = np.zeros((shape[0], 256), np.int64)
        count_labels(stored, counts)
        np.testing.assert_array_equal(counts, expected)
