"""The staircase of large voxels is smoothed in what attenuates, and in nothing else."""

import numpy as np
import pytest
from make_phantom import far_away
from naive.projection import phantom, unsqueezed

from mammosim.geometry import VoxelFrame
from mammosim.phantom import Lesion
from mammosim.projection import project
from mammosim.projection.smoothing import SMOOTHING_VOXELS, stretched_voxel_mm
from mammosim.projection.voxel_map import VoxelMap

ADIPOSE, MASS, DUST = 1, 160, 161


def wedge(voxel_mm=1.0):
    """A wedge of fat that thickens by 1 mm in 5 along y, with a mass and a speck in it."""
    shape = np.array([40, 60, 24])
    _, y, z = np.indices(shape)
    labels = ((z + 0.5) <= 4.0 + (y + 0.5) / 5.0).astype(np.uint8)
    labels[10:16, 28:34, 2:6] = MASS
    labels[28, 40, 3] = DUST
    labels[:, :4] = labels[:, -4:] = 0
    lesions = (
        Lesion("lump", "mass", MASS, "mass", np.zeros(3), 1.0),
        Lesion("speck", "calcification", DUST, "calcification", np.zeros(3), 1.0),
    )
    block = phantom(labels, voxel_mm, np.array([0.5, -29.5, 0.5]) * voxel_mm, lesions=lesions)
    return unsqueezed(block, spacing_mm=8.0, plates_mm=(0.0, 24.0))


def both(pixel_mm=0.25, **keys):
    return [
        project(wedge(), pixel_mm=pixel_mm, detector_mm=[80.0, 60.0], detector_edge_mm=-5.0,
                smooth_voxels=smooth, **keys)
        for smooth in (True, False)
    ]  # fmt: skip


def test_a_comb_of_voxels_fades_as_a_gaussian_of_a_third_of_a_voxel_fades_it():
    """Every other voxel along y gland: the wave two voxels long keeps exp(-2 pi^2 s^2 / 4)."""
    labels = np.full((20, 64, 6), ADIPOSE, np.uint8)
    labels[:, ::2] = 29
    comb = unsqueezed(phantom(labels, 1.0, [0.5, -31.5, 0.5]), plates_mm=(0.0, 6.0))
    keys = {"pixel_mm": 0.25, "detector_mm": [80.0, 30.0]}
    waves = []
    for smooth in (True, False):
        gland = project(comb, far_away(smooth_voxels=smooth, **keys)).attenuating_mm[1, 96:224, 40]
        waves.append(np.abs(np.fft.rfft(gland.astype(float)))[16])  # 32 mm hold 16 waves
    expected = np.exp(-2.0 * np.pi**2 * SMOOTHING_VOXELS**2 / 4.0)
    # The Gaussian is sampled on pixels of a quarter of a voxel and cut off at three deviations.
    assert waves[0] / waves[1] == pytest.approx(expected, rel=0.02)


def test_the_smoothing_is_as_wide_as_compression_stretches_a_voxel():
    """An inverse map that stretches y by 3/2 and x by 5/4: exactly so much wider per axis."""
    frame = VoxelFrame(np.zeros(3), np.full(3, 4.0), (5, 5, 3))
    index = np.indices(frame.shape).transpose(1, 2, 3, 0) * 4.0 / [0.2, 0.2, 0.4]
    nodes = np.concatenate([index / [1.25, 1.5, 0.5], np.ones((*frame.shape, 1))], axis=3)
    mapped = VoxelMap(frame, nodes.astype(np.float32), np.ones((4, 4, 2), bool), 0.0)
    along_y, along_x = stretched_voxel_mm(mapped, np.array([0.2, 0.2, 0.4]))
    assert along_y == pytest.approx(0.4 * 1.5, rel=1e-5)  # the longest edge counts
    assert along_x == pytest.approx(0.4 * 1.25, rel=1e-5)


def test_air_in_the_map_does_not_count_for_the_stretch():
    frame = VoxelFrame(np.zeros(3), np.ones(3), (4, 4, 3))
    nodes = np.full((4, 4, 3, 4), np.nan, np.float32)
    nodes[:3, :3] = np.concatenate(
        [np.indices((3, 3, 3)).transpose(1, 2, 3, 0), np.ones((3, 3, 3, 1))], axis=3
    )
    tissue = np.zeros((3, 3, 2), bool)
    tissue[:3, :3] = True  # cells at its border have a corner without a map
    assert stretched_voxel_mm(VoxelMap(frame, nodes, tissue, 0.0), np.ones(3)) == (1.0, 1.0)


def test_lengths_masks_and_small_bright_things_stay_exact():
    smooth, sharp = both()
    np.testing.assert_array_equal(smooth.length_mm, sharp.length_mm)
    speck = smooth.tissues.index("speck")
    np.testing.assert_array_equal(smooth.attenuating_mm[speck], sharp.attenuating_mm[speck])
    lump = smooth.tissues.index("lump")
    assert np.abs(smooth.attenuating_mm[lump] - sharp.attenuating_mm[lump]).max() > 0.5


def test_sums_are_kept():
    for smooth, sharp in zip(*(paths.attenuating_mm for paths in both()), strict=True):
        # Single precision, and the cut-off of the Gaussian is made up for by its own sum.
        assert smooth.sum(dtype=float) == pytest.approx(sharp.sum(dtype=float), rel=1e-6)


def test_voxels_no_larger_than_a_pixel_are_left_alone():
    smooth, sharp = both(pixel_mm=1.1)
    np.testing.assert_array_equal(smooth.attenuating_mm, sharp.attenuating_mm)


def test_without_conserved_mass_both_lengths_stay_one():
    smooth, _ = both(conserve_mass=False)
    assert smooth.attenuating_mm is smooth.length_mm
