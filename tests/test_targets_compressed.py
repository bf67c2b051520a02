"""Projection and targets of breasts that the mechanical models compressed, end to end."""

import numpy as np
import pytest
from make_phantom import far_away
from naive.projection import phantom, plain_projection

from mammosim.compression import compress
from mammosim.phantom import Lesion
from mammosim.projection import compressed_labels, project
from mammosim.targets import find_targets

LESION = 160


def half_ellipsoid():
    """45 x 80 x 70 mm of fat with a 10 mm mass, 2 mm voxels."""
    x = np.arange(23) * 2.0 + 1.0
    y = (np.arange(42) - 20.5) * 2.0
    z = (np.arange(38) - 18.5) * 2.0
    at = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    labels = (((at / [45.0, 40.0, 35.0]) ** 2).sum(axis=-1) <= 1.0).astype(np.uint8)
    inside = np.linalg.norm(at - [22.0, 12.0, 10.0], axis=-1) <= 5.0
    labels[inside] = LESION
    lesion = Lesion("m", "mass", LESION, "mass", at[inside].mean(axis=0), inside.sum() * 8.0)
    return phantom(labels, 2.0, [1.0, y[0], z[0]], lesions=(lesion,))


def test_a_breast_left_as_it_is_projects_as_the_plain_voxels():
    breast = half_ellipsoid()
    left_alone = compress(breast, view="MLO", model="none", resolution_mm=4.0)
    paths = project(left_alone, pixel_mm=3.0, detector_mm=[108.0, 60.0])
    expected = plain_projection(breast, paths.gantry)
    both = np.stack([expected[1], expected[LESION]])
    # Single precision of the map, as in the twins' tests.
    np.testing.assert_allclose(paths.length_mm, both, atol=2e-4)


@pytest.fixture(scope="module")
def compressed():
    return compress(half_ellipsoid(), view="CC", model="springs", thickness_mm=50.0,
                    resolution_mm=2.0)  # fmt: skip


def test_springs_keep_mass_but_for_what_is_clipped(compressed):
    paths = project(
        compressed,
        far_away(pixel_mm=0.5, detector_edge_mm=-3.0, support_to_detector_mm=30.0),
    )
    before = np.count_nonzero(compressed.phantom.labels) * 8.0
    after = paths.attenuating_mm.sum(dtype=float) * 0.25
    # Clipped cells are off by their own share; the rest is second order in the 2 mm lattice.
    assert after == pytest.approx(before, rel=0.002 + paths.clipped_fraction)
    assert paths.clipped_fraction < 0.01
    # The plain length does not keep it: the springs lose volume.
    assert paths.length_mm.sum(dtype=float) * 0.25 < 0.99 * before


def test_a_lesion_went_where_its_picture_and_the_warped_voxels_say(compressed):
    paths = project(compressed, pixel_mm=0.25)
    mass = find_targets(compressed, paths)[0]
    place = np.array([mass.compressed_x_mm, mass.compressed_y_mm, mass.compressed_z_mm])
    thrown = paths.gantry.project(place)
    # A quarter of a millimetre, an eighth of the lattice's spacing: forward and inverse map are
    # interpolated apart from each other.
    np.testing.assert_allclose([mass.image_row_px, mass.image_col_px], thrown, atol=1.0)
    labels, frame = compressed_labels(compressed, 0.5)
    warped = frame.position_mm(np.argwhere(labels == LESION).mean(axis=0))
    gantry_mm = warped - [paths.gantry.detector_edge_mm, 0.0, paths.gantry.support_z_mm]
    np.testing.assert_allclose(gantry_mm, place, atol=0.25)
    assert mass.shift_z_mm < 0.0  # pressed down from above the middle
    assert 0.0 < mass.compressed_z_mm < 50.0
    volume = np.count_nonzero(labels == LESION) * 0.125
    # The lesion's staircase surface in voxels of 0.5 mm.
    assert mass.volume_ratio == pytest.approx(volume / mass.volume_mm3, rel=0.03)
