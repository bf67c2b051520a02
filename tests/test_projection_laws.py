"""Laws of projection geometry that need no other program to check against."""

from itertools import pairwise

import numpy as np
import pytest
from make_phantom import far_away
from naive.projection import compressed, inverse_map, phantom, unsqueezed

from mammosim.projection import project

ADIPOSE, GLAND = 1, 29


def channel(paths, name):
    return paths.length_mm[paths.tissues.index(name)]


def ball(radius_mm, voxel_mm, label=ADIPOSE):
    """A ball in the middle of a cube of voxels, centred at the origin."""
    n = 2 * int(np.ceil(radius_mm / voxel_mm + 1))
    at = (np.arange(n) - 0.5 * (n - 1)) * voxel_mm
    inside = at[:, None, None] ** 2 + at[:, None] ** 2 + at**2 <= radius_mm**2
    return phantom(inside * np.uint8(label), voxel_mm, np.full(3, at[0]))


def test_chord_of_a_sphere():
    radius, voxel = 15.0, 0.25
    breast = unsqueezed(ball(radius, voxel), edge_mm=-20.0)
    paths = project(breast, pixel_mm=1.0, support_to_detector_mm=20.0)
    gantry = paths.gantry
    row, column = np.indices(paths.length_mm.shape[1:])
    pixel = np.concatenate(
        [gantry.detector_xy_mm(row, column), np.full((*row.shape, 1), -20.0)], axis=-1
    )
    spot = gantry.focal_spot_mm
    centre = gantry.gantry_from_breast([0.0, 0.0, 0.0])
    along = (pixel - spot) / np.linalg.norm(pixel - spot, axis=-1, keepdims=True)
    distance = np.linalg.norm(np.cross(along, centre - spot), axis=-1)
    chord = 2.0 * np.sqrt(np.maximum(radius**2 - distance**2, 0.0))
    steep = distance < 0.9 * radius
    error = paths.length_mm.sum(axis=0) - chord
    # A staircase of voxels is within half a voxel's diagonal of the sphere, which either end of a
    # chord meets at a cosine of at least sqrt(1 - 0.9^2).
    assert np.abs(error[steep]).max() < 2.0 * 0.5 * np.sqrt(3.0) * voxel / np.sqrt(1.0 - 0.81)
    assert abs(error[steep].mean()) < 0.05 * voxel


def test_slab_thickness_over_cosine():
    labels = np.full((40, 60, 20), GLAND, dtype=np.uint8)
    breast = unsqueezed(phantom(labels, [2.0, 2.0, 1.5], [1.0, -59.0, 0.75]))
    paths = project(breast, pixel_mm=2.0)
    gantry = paths.gantry
    row, column = np.indices(paths.length_mm.shape[1:])
    at = gantry.detector_xy_mm(row, column)
    cosine = gantry.source_to_detector_mm / np.hypot(
        gantry.source_to_detector_mm, np.hypot(at[..., 0], at[..., 1])
    )
    inside = (at[..., 0] < 75.0) & (np.abs(at[..., 1]) < 55.0)
    np.testing.assert_allclose(
        channel(paths, "gland")[inside], (30.0 / cosine)[inside], rtol=2e-6
    )  # float32 output, voxel places in float32


@pytest.mark.parametrize("height_mm", [5.0, 45.0])
def test_magnification_is_distance_over_distance(height_mm):
    labels = np.zeros((61, 121, 101), dtype=np.uint8)
    z = round(height_mm / 0.5)
    labels[50, 20, z] = labels[50, 100, z] = GLAND
    breast = unsqueezed(
        phantom(labels, 0.5, [0.0, -30.0, 0.0]), spacing_mm=1.0, plates_mm=(0.0, 50.0)
    )
    paths = project(breast, pixel_mm=0.05, detector_mm=[80.0, 40.0])
    rows = np.flatnonzero(channel(paths, "gland").any(axis=1))
    upper, lower = rows[rows < rows.mean()].mean(), rows[rows > rows.mean()].mean()
    magnification = 650.0 / (650.0 - 15.0 - height_mm)
    # Half a pixel at either end of each spot's shadow.
    assert (lower - upper) * 0.05 == pytest.approx(40.0 * magnification, abs=0.05)


def test_parallel_beam_sees_a_block_at_its_own_size():
    """From far away the shadow of a block is its own size."""
    labels = np.full((20, 30, 10), ADIPOSE, dtype=np.uint8)
    breast = unsqueezed(phantom(labels, 1.0, [0.5, -14.5, 0.5]))
    paths = project(breast, far_away(pixel_mm=0.5))
    lengths = paths.length_mm[0]
    assert lengths.max() == pytest.approx(10.0, rel=1e-5)
    assert lengths.sum(dtype=float) * 0.25 == pytest.approx(labels.size, rel=1e-5)


def squeezed_block(spacing_mm, original_of, high=(44.0, 34.0, 22.0), **keys):
    """A 40 x 60 x 40 mm block of fat with gland in it, and its compression by formula."""
    rng = np.random.default_rng(4)
    labels = np.where(rng.random((40, 60, 40)) < 0.3, GLAND, ADIPOSE).astype(np.uint8)
    breast = phantom(labels, 1.0, [0.5, -29.5, -19.5])
    low = (-4.0, -high[1], -high[2])
    return compressed(breast, inverse_map(original_of, low, high, spacing_mm), **keys)


def test_affine_compression_keeps_mass():
    stretch = np.array([1.0, 1.1, 0.6])
    breast = squeezed_block(
        2.0, lambda p: p / stretch, high=(44.0, 36.0, 16.0), plates_mm=(-12.0, 12.0), edge_mm=-1.0
    )
    keys = {"pixel_mm": 0.25, "detector_mm": [80.0, 60.0]}
    paths = project(breast, far_away(**keys))
    labels = breast.phantom.labels
    for order, label in enumerate([ADIPOSE, GLAND]):
        before = np.count_nonzero(labels == label)
        image = paths.attenuating_mm[order].sum(dtype=float) * 0.25**2
        # The edge of the shadow falls on whole pixels along x: 1e-3 of the area.
        assert image == pytest.approx(before, rel=1e-3)
        plain = paths.length_mm[order].sum(dtype=float) * 0.25**2
        assert plain == pytest.approx(before * np.prod(stretch), rel=1e-3)
    assert paths.clipped_fraction == 0.0
    unweighted = project(breast, far_away(conserve_mass=False, **keys))
    assert unweighted.attenuating_mm is unweighted.length_mm
    np.testing.assert_array_equal(unweighted.length_mm, paths.length_mm)


def bent(points):
    """A smooth inverse map that squeezes along z and bulges in x and y, folding nowhere."""
    x, y, z = points.T
    squeeze = 1.0 + 0.5 * np.exp(-((y / 25.0) ** 2)) * (x / 40.0)
    return np.stack(
        [x - 1.5 * np.cos(y / 12.0) * np.cos(z / 9.0) + 1.5, y * (1.0 - 0.05 * np.cos(z / 8.0)),
         z * squeeze], axis=-1,
    )  # fmt: skip


def test_smooth_compression_keeps_mass():
    breast = squeezed_block(1.0, bent, plates_mm=(-21.0, 21.0), edge_mm=-4.0)
    paths = project(breast, far_away(pixel_mm=0.2, detector_mm=[80.0, 60.0]))
    before = breast.phantom.labels.size
    after = paths.attenuating_mm.sum(dtype=float) * 0.04
    # Second order in the 1 mm grid, and whole pixels at the block's edge.
    assert after == pytest.approx(before, rel=1e-3)
    assert paths.length_mm.sum(dtype=float) * 0.04 < 0.9 * before
    assert paths.clipped_fraction == 0.0


def test_halving_the_grid_converges_with_second_order():
    """Successive halvings of the inverse map's spacing change the image by a quarter each."""
    images = []
    for spacing in (4.0, 2.0, 1.0, 0.5):
        breast = squeezed_block(spacing, bent, plates_mm=(-21.0, 21.0), edge_mm=-1.0)
        paths = project(breast, pixel_mm=1.0, detector_mm=[80.0, 60.0])
        # Summed over the tissues, away from the block's rim where a ray is in or out.
        images.append(paths.attenuating_mm[:, 20:60, 5:35].sum(axis=0, dtype=float))
    changes = [np.sqrt(np.mean((coarse - fine) ** 2)) for coarse, fine in pairwise(images)]
    orders = np.log2(np.array(changes[:-1]) / changes[1:])
    # Observed 1.9 and 2.1: second order, as interpolation within a cell.
    assert (np.abs(orders - 2.0) < 0.3).all(), (changes, orders)
    assert changes[-1] < 0.01  # mm, of 28 to 40 mm
