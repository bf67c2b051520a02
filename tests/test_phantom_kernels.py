"""Kernels on label volumes: bodies joined by faces."""

from __future__ import annotations

import numpy as np
import pytest
from naive import phantom as naive

from mammosim.phantom._body_kernels import count_runs, find_runs
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
