"""The tracing kernels against slow twins, and one answer whatever the number of threads."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from naive.projection import (
    compressed,
    deformed_projection,
    inverse_map,
    phantom,
    plain_projection,
    unsqueezed,
)

from mammosim.phantom import Lesion
from mammosim.projection import compressed_labels, project
from mammosim.projection._ray_kernels import Voxels, _other, _segment, find_empty_cells

ADIPOSE, GLAND, LESION = 1, 29, 160

compiled_only = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT), reason="compares with, or runs on the threads of, compiled code"
)


def noise(shape, voxel_mm, origin_mm, laterality="L", seed=3):
    """Random fat, gland, air and lesion voxels: every face is met."""
    labels = np.random.default_rng(seed).choice(
        np.array([0, ADIPOSE, GLAND, LESION], dtype=np.uint8), shape, p=[0.2, 0.4, 0.3, 0.1]
    )
    lesion = Lesion("noise", "mass", LESION, "mass", np.zeros(3), 1.0)
    return phantom(labels, voxel_mm, origin_mm, laterality, lesions=(lesion,))


def by_channel(lengths):
    return np.stack([lengths[ADIPOSE], lengths[GLAND], lengths[LESION]])


@pytest.mark.parametrize("view", ["CC", "MLO", "ML"])
@pytest.mark.parametrize("laterality", ["L", "R"])
def test_no_displacement_equals_the_plain_projector(view, laterality):
    breast = noise((12, 14, 10), [1.0, 0.9, 1.1], [0.5, -6.0, -5.0], laterality)
    left_alone = unsqueezed(breast, view, spacing_mm=3.7)
    paths = project(left_alone, pixel_mm=1.3, detector_mm=[39.0, 26.0])
    assert paths.tissues == ("adipose", "gland", "noise")
    assert paths.materials == ("adipose", "gland", "mass")
    assert paths.lesion_labels == (0, 0, LESION)
    expected = by_channel(plain_projection(breast, paths.gantry))
    assert expected.max() > 2.0
    # The inverse map is in single precision: 1e-6 voxel, which a ray that meets a voxel's side at
    # a slope of 1/100 turns into 1e-4 mm.
    np.testing.assert_allclose(paths.length_mm, expected, atol=2e-4)
    np.testing.assert_allclose(paths.attenuating_mm, expected, atol=2e-4)


def warped(points):
    """A map that bends every axis, compression frame."""
    x, y, z = points.T
    bend = [x + 0.8 * np.sin(y / 4.0), 0.8 * y + 0.05 * x * z, 1.5 * z + 0.5 * np.cos(x / 3.0)]
    return np.stack(bend, axis=-1)


def warped_breast(view="MLO", laterality="R"):
    breast = noise((12, 14, 10), [1.0, 0.9, 1.1], [0.5, -6.0, -5.0], laterality)
    inverse = inverse_map(warped, [-2.0, -12.0, -7.0], [14.0, 12.0, 7.0], [1.5, 1.3, 1.1])
    rng = np.random.default_rng(8)
    inverse.original_mm[rng.random(inverse.frame.shape) < 0.03] = np.nan
    return compressed(breast, inverse, view)


def test_deformed_voxels_equal_the_slow_twin():
    breast = warped_breast()
    paths = project(breast, pixel_mm=1.3, detector_mm=[39.0, 26.0])
    expected = by_channel(deformed_projection(breast, paths.gantry))
    assert expected.max() > 2.0
    # The twin folds the frames in double precision, the kernel in single: as above.
    np.testing.assert_allclose(paths.length_mm, expected, atol=2e-4)


@compiled_only
def test_any_number_of_threads_gives_the_same_bits():
    breast = warped_breast("CC", "L")
    threads = numba.get_num_threads()
    images = []
    try:
        for count in sorted({1, min(2, numba.config.NUMBA_NUM_THREADS)}):
            numba.set_num_threads(count)
            images.append(project(breast, pixel_mm=0.2))
    finally:
        numba.set_num_threads(threads)
    assert images[0].length_mm.tobytes() == images[-1].length_mm.tobytes()
    assert images[0].attenuating_mm.tobytes() == images[-1].attenuating_mm.tobytes()


def voxels_of(labels):
    """Labels 1 to 3 in channels 0 to 2."""
    row = labels.reshape(-1)
    words = row[: row.size // 8 * 8].view(np.uint64)
    channel = np.append(3, np.arange(255)).astype(np.uint64)
    return Voxels(row, words, *map(int, labels.shape), channel, np.zeros((0, 0, 0), np.bool_))


def test_the_other_label_is_found_at_any_place_of_a_word():
    """Columns of 19 voxels, of which the last three fill no word, in rows of one to nine."""
    rng = np.random.default_rng(6)
    labels = np.repeat(rng.integers(0, 3, 90), rng.integers(1, 10, 90)).astype(np.uint8)
    columns = labels[: 19 * (labels.size // 19)]
    voxels = voxels_of(columns.reshape(1, -1, 19))
    assert columns.size % 8
    for column in range(0, columns.size, 19):
        line = columns[column : column + 19]
        for start in range(19):
            for end in range(19):
                step = 1 if end >= start else -1
                between = range(start, end + step, step)
                for label in (1, 2):
                    expected = next((z for z in between if line[z] != label), -1)
                    assert _other(column, start, end, label, voxels) == expected


def test_a_segment_is_shared_among_the_voxels_between_the_planes_that_it_crosses():
    """In all directions, along axes and along diagonals, where it crosses planes together."""
    rng = np.random.default_rng(6)
    size = np.array([6, 5, 19])
    labels = rng.integers(0, 4, size).astype(np.uint8)
    voxels = voxels_of(labels)
    ends = [rng.uniform(0.1, size - 0.1, (2, 3)) for _ in range(60)]
    ends += [
        np.array([[*place, 0.5], [*place + 0.3, 17.5]]) for place in rng.uniform(0.1, 4.5, (20, 2))
    ]
    ends += [
        np.array([[*place, 17.5], [*place + 0.3, 0.5]]) for place in rng.uniform(0.1, 4.5, (9, 2))
    ]
    ends += [np.array([[2.5, 2.5, 2.5], place]) for place in rng.uniform(0.1, size - 0.1, (20, 3))]
    for axis in range(3):
        ends += [np.array([place, place + np.eye(3)[axis]]) for place in rng.uniform(1, 3, (5, 3))]
    ends += [np.array([[1.25, 1.25, 1.25], [1.25 + 3 * a, 1.25 + 3 * b, 4.25]])
             for a in (0, 1) for b in (0, 1)]  # fmt: skip
    for start, end in ends:
        planes = [(np.arange(1, n) - start[axis]) / change for axis, n in enumerate(size)
                  if (change := end[axis] - start[axis])]  # fmt: skip
        crossed = np.concatenate(planes)
        t = np.sort([0.0, *crossed[(crossed > 0.0) & (crossed < 1.0)], 1.0])
        inside = start + 0.5 * (t[1:] + t[:-1])[:, None] * (end - start)
        at = tuple(np.minimum(np.floor(inside).astype(int), size - 1).T)
        expected = np.bincount(labels[at], np.diff(t), minlength=4)[1:]
        shares, sums = np.zeros((3, 4)), np.zeros((2, 4))
        _segment((*start, 0.5), (*end, 1.5), 0.0, 1.0, 2.0, voxels, shares, sums)
        np.testing.assert_allclose(sums[:, :3], [2.0 * expected] * 2, atol=1e-12)
        assert not shares.any()


def test_cells_without_tissue_are_found_in_the_box_of_their_nodes():
    rng = np.random.default_rng(7)
    labels = rng.integers(1, 4, (20, 21, 22)).astype(np.uint8)
    labels[6:] = np.where(rng.random((14, 21, 22)) < 0.01, 2, 0)
    nodes = np.ones((9, 8, 7, 4), np.float32)
    nodes[..., :3] = 3.1 * np.moveaxis(np.indices((9, 8, 7)), 0, -1) - 1.3
    nodes[..., :3] += rng.uniform(-0.6, 0.6, (9, 8, 7, 3))
    nodes[rng.random((9, 8, 7)) < 0.02, :3] = np.nan
    empty = np.ones((8, 7, 6), np.bool_)
    find_empty_cells(nodes, voxels_of(labels), 3, empty)
    for i, j, k in np.ndindex(empty.shape):
        corners = nodes[i : i + 2, j : j + 2, k : k + 2, :3].reshape(8, 3)
        expected = False
        if np.isfinite(corners).all():
            low = np.maximum(np.floor(corners.min(axis=0) - 0.01), 0).astype(int)
            high = np.maximum(np.floor(corners.max(axis=0) + 0.01) + 1, 0).astype(int)
            expected = not labels[tuple(map(slice, low, high))].any()
        assert empty[i, j, k] == expected
    assert 20 < empty.sum() < 300


def test_what_is_left_out_in_empty_cells_changes_no_bit(monkeypatch):
    breast = warped_breast()
    labels = breast.phantom.labels.copy()
    labels[4:] = 0
    breast = compressed(
        phantom(labels, [1.0, 0.9, 1.1], [0.5, -6.0, -5.0], "R", lesions=breast.phantom.lesions),
        breast.inverse, "MLO",
    )  # fmt: skip
    found = []

    def find(nodes, voxels, unwanted, empty):
        find_empty_cells(nodes, voxels, unwanted, empty)
        found.append(empty.sum())

    monkeypatch.setattr("mammosim.projection.ray_tracing.find_empty_cells", find)
    with_gaps = project(breast, pixel_mm=1.3, detector_mm=[39.0, 26.0])
    monkeypatch.setattr("mammosim.projection.ray_tracing.find_empty_cells", lambda *all_of: None)
    whole = project(breast, pixel_mm=1.3, detector_mm=[39.0, 26.0])
    assert found[0] > 20
    assert with_gaps.length_mm.max() > 2.0
    assert with_gaps.length_mm.tobytes() == whole.length_mm.tobytes()
    assert with_gaps.attenuating_mm.tobytes() == whole.attenuating_mm.tobytes()


def test_labels_in_another_memory_order_give_the_same():
    breast = warped_breast()
    turned = compressed(phantom_in_fortran_order(breast.phantom), breast.inverse, "MLO")
    np.testing.assert_array_equal(
        project(turned, pixel_mm=1.0).length_mm, project(breast, pixel_mm=1.0).length_mm
    )


def phantom_in_fortran_order(breast):
    copy = phantom(
        breast.labels, breast.voxel_mm, breast.origin_mm, breast.laterality, lesions=breast.lesions
    )
    object.__setattr__(copy, "labels", np.asfortranarray(breast.labels))
    return copy


@compiled_only
def test_uncompiled_kernels_give_the_same(tmp_path):
    """The kernels as plain Python, in another process, since Numba reads the switch at start."""
    script = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import numpy as np, test_projection_kernels as t\n"
        "from mammosim.projection import compressed_labels, project\n"
        "breast = t.warped_breast()\n"
        "paths = project(breast, pixel_mm=2.0, detector_mm=[38.0, 24.0])\n"
        "labels, _ = compressed_labels(breast, 2.0)\n"
        "np.savez(sys.argv[2], length=paths.length_mm, weighted=paths.attenuating_mm,\n"
        "         labels=labels)\n"
    )
    out = tmp_path / "uncompiled.npz"
    subprocess.run(
        [sys.executable, "-c", script, os.path.dirname(__file__), str(out)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=True,
        timeout=600,
    )
    breast = warped_breast()
    paths = project(breast, pixel_mm=2.0, detector_mm=[38.0, 24.0])
    with np.load(out) as plain:
        np.testing.assert_allclose(plain["length"], paths.length_mm, atol=1e-6)
        np.testing.assert_allclose(plain["weighted"], paths.attenuating_mm, atol=1e-6)
        np.testing.assert_array_equal(plain["labels"], compressed_labels(breast, 2.0)[0])


def test_compressed_labels_equal_point_by_point_lookup():
    breast = warped_breast("CC", "L")
    frame, original = breast.inverse.frame, breast.inverse.original_mm.astype(float)
    labels, grid = compressed_labels(breast, 0.7)
    rng = np.random.default_rng(5)
    seen = 0
    for index in rng.integers(0, labels.shape, (2000, 3)):
        at = np.clip(frame.index(grid.position_mm(index)), 0, np.array(frame.shape) - 1)
        low = np.minimum(at.astype(int), np.array(frame.shape) - 2)
        i, j, k = low
        value = original[i : i + 2, j : j + 2, k : k + 2]
        for part in at - low:
            value = value[0] * (1 - part) + value[1] * part
        voxel = breast.phantom.frame.index(value @ breast.view.rotation)
        expected = 0
        if np.isfinite(voxel).all():
            if np.abs(voxel - np.floor(voxel) - 0.5).min() < 1e-4:
                continue  # single precision may decide for the neighbour
            nearest = np.rint(voxel).astype(int)
            if ((nearest >= 0) & (nearest < breast.phantom.labels.shape)).all():
                expected = breast.phantom.labels[tuple(nearest)]
        assert labels[tuple(index)] == expected
        seen += expected > 0
    assert seen > 500
