"""Kernels of the photon transport beside their slow twins."""

import numpy as np
import pytest
from naive import monte_carlo as naive

from mammosim.acquisition.monte_carlo._flight_kernels import Path, Plan, fly
from mammosim.acquisition.monte_carlo._random_kernels import Stream, philox, uniforms
from mammosim.projection._coarse_kernels import SampledAs
from mammosim.projection.coarse_copy import CoarseBreast, fold


def stream(key=(0, 0), number=(0, 0)):
    return Stream(*(np.uint64(part) for part in (*key, *number)))


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        # known answers of the authors' library, Random123
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        (
            (0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2,
            (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
        ),
    ],
)  # fmt: skip
def test_philox_known_answers(counter, key, expected):
    assert naive.philox(counter, key) == expected


def test_philox_agrees_with_its_twin():
    rng = np.random.default_rng(1)
    for _ in range(20):
        block, low, high, k0, k1 = (int(n) for n in rng.integers(0, 2**32, 5))
        found = philox(stream((k0, k1), (low, high)), np.uint64(block))
        assert tuple(int(n) for n in found) == naive.philox((block, 0, low, high), (k0, k1))


def test_uniforms_are_uniform():
    numbers = np.array([uniforms(stream((3, 4), (n, 0)), 0) for n in range(5000)]).ravel()
    assert 0.0 < numbers.min() < numbers.max() < 1.0
    # 20 000 numbers in 20 bins: chi squared of 19 degrees is below 44 but once in a thousand
    counts = np.bincount((numbers * 20).astype(int), minlength=20)
    assert (((counts - 1000.0) ** 2) / 1000.0).sum() < 44.0


def random_scene():
    rng = np.random.default_rng(5)
    shares = rng.integers(0, 9, (6, 8, 5)).astype(np.uint64)
    density = rng.uniform(0.6, 1.6, shares.shape).astype(np.float32)
    breast = CoarseBreast(
        np.array([0.0, -8.0, 0.0]), np.array([2.0, 2.0, 3.0]), ("gland",), shares, density
    )
    return naive.Case(breast, layers=naive.plates(3.0, 1.0))


def test_flight_agrees_with_its_twin():
    """Lengths in each cell, and the optical depth of whole rays in any direction."""
    case = random_scene()
    space, tables = case.scene.space, case.tables
    planes = (space.x, space.y, space.z)
    shape = tuple(part.size - 1 for part in planes)
    attenuation = (tables.total @ case.scene.fraction.T)[-1] / 8192.0
    longest = sum(shape) + 6
    path = Path(np.empty(longest), np.empty(longest), np.empty(longest, np.int64))
    plan = Plan(1, stream(), 1.0, 1, False, False, 0)
    rng = np.random.default_rng(2)
    for _ in range(40):
        cell = [int(rng.integers(1, size - 1)) for size in shape]
        start = [
            planes[axis][at] + rng.uniform(0.1, 0.9) * (planes[axis][at + 1] - planes[axis][at])
            for axis, at in enumerate(cell)
        ]
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        tally = np.zeros(len(case.scene.fraction))
        steps, through = fly(
            plan, space, attenuation.astype(np.float32), np.zeros(1, np.float32),
            (*start, *direction), int(np.ravel_multi_index(cell, shape)), 2.0, path, tally,
            np.zeros(1, np.float32),
        )  # fmt: skip
        expected = naive.crossed_lengths(planes, start, direction)
        assert steps == len(expected)
        places = [int(np.ravel_multi_index(place, shape)) for place, _ in expected]
        np.testing.assert_array_equal(path.place[:steps], places)
        lengths = np.diff(path.length[:steps], prepend=0.0)
        np.testing.assert_allclose(lengths, [length for _, length in expected], atol=1e-9)
        words = space.words[places]
        depth = (attenuation[words & 0xFFFF] * (words >> np.uint32(16)) * lengths).sum()
        # sections are held in 32 bits
        assert path.depth[steps - 1] == pytest.approx(depth, rel=1e-5)
        # exp by a polynomial: 1e-6 a cell
        assert through == pytest.approx(np.exp(-depth), rel=2e-5)
        assert tally.sum() == pytest.approx(2.0 * (1.0 - through), rel=1e-9)


def test_shares_are_counted_in_blocks_of_eight():
    labels = np.zeros((4, 2, 2), np.uint8)
    labels[0] = 1
    labels[1, 0, 0] = 2
    labels[2:] = 2
    material = np.full(256, -1)
    material[1], material[2] = 0, 1
    shares = fold(labels, SampledAs(material, material, np.ones(256)))
    assert [int(word) for word in shares.ravel()] == [4 + (1 << 4), 8 << 4]


def test_a_lesion_that_fills_its_voxels_in_part_leaves_the_rest_to_its_host():
    labels = np.full((40, 40, 40), 3, np.uint8)
    material, host, fill = np.full(256, -1), np.full(256, -1), np.ones(256)
    material[3], host[3], fill[3] = 1, 0, 0.3
    shares = fold(labels, SampledAs(material, host, fill))
    breast = CoarseBreast(
        np.zeros(3), np.ones(3), ("adipose", "calcification"), shares,
        np.ones(shares.shape, np.float32),
    )  # fmt: skip
    assert breast.fraction("calcification").mean() == pytest.approx(0.3, abs=2e-3)
    assert (breast.fraction("calcification") + breast.fraction("adipose") == 1.0).all()
