"""Kernels of the generated breast against their twins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from naive import phantom as naive
from scipy import ndimage
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame
from mammosim.phantom import GenerateSettings
from mammosim.phantom.anatomy import (
    _block_kernels,
    _fill_kernels,
    _net_kernels,
    _noise_kernels,
    _sample_kernels,
    _slope_kernels,
    _surface_kernels,
    _tissue_kernels,
    _tube_kernels,
    _wall_kernels,
    body,
    foam,
    generate,
    lobules,
    threads,
)
from mammosim.tissues import TISSUES

SEPTA = ("ligament_eighth", "ligament_quarter", "ligament_half", "ligament")

LABEL = {name: tissue.label for name, tissue in TISSUES.items()}


def test_noise_agrees_with_its_twin():
    points = np.random.default_rng(1).uniform(-40.0, 40.0, (50, 3))
    for point in points:
        assert _noise_kernels.gradient_noise(*point, 77) == pytest.approx(
            naive.gradient_noise(point, 77), abs=1e-10
        )


def test_gland_is_where_the_potential_exceeds_the_threshold():
    """Blocks that are decided from their corners hold what their voxels would have been given."""
    settings = GenerateSettings(voxel_mm=2.5, volume_ml=120.0, density="c")
    anatomy = generate._anatomy(settings, 5)
    lattice = body.lattice_of(anatomy.body, settings.voxel_mm)
    texture = generate._texture(anatomy, 5)
    paint = body.paint_of(anatomy.body)._replace(threshold=-2.0)
    size = (lattice.x_mm.size, lattice.lateral_mm.size, lattice.superior_mm.size)
    labels = np.zeros(size, np.uint8)
    half = np.searchsorted(lattice.x_start, size[0] // 2, side="right") - 1  # of the voxels
    slab = np.arange(half, half + 1)  # enough of the breast, and quick as plain Python too
    _tissue_kernels.paint_tissue(slab, labels, lattice, texture, paint)
    first = lattice.x_start[slab[0]]
    labels = labels[first : lattice.x_start[slab[-1] + 1]]
    across = np.ones((1, 3, 3), bool)
    gland = labels == LABEL["gland"]
    soft = np.isin(labels, [LABEL[name] for name in ("adipose", "gland", *SEPTA)])
    soft &= ndimage.binary_erosion(soft, across, 2)  # where the skin's dither does not reach
    soft &= ~ndimage.binary_dilation(labels == LABEL["muscle"], across, 2)  # fat within it
    rng, checked, differ = np.random.default_rng(1), 0, 0
    for index in rng.permutation(np.argwhere(soft))[:120]:
        at = index + np.array([first, 0, 0])
        point = np.array([axis[n] for axis, n in zip(lattice[:3], at, strict=True)])
        above = naive.gland_potential(texture, lattice.coarse_origin_mm, 2.0, point) + 2.0
        grain = naive.grain(texture, lattice.coarse_origin_mm, 2.0, point)
        wanted = min(above, texture.gland_cap) + grain
        if abs(wanted) > 1e-6:
            differ += gland[tuple(index)] != (wanted > 0.0)
            checked += 1
    assert differ == 0
    assert checked > 60
    assert 0.05 < gland[soft].mean() < 0.9


def test_slopes_are_those_of_numpy_to_the_last_bit():
    value = np.random.default_rng(3).normal(size=(5, 4, 6))
    found = np.empty(value.shape)
    _slope_kernels.slopes(value, 0.3, found)
    expected = np.sqrt(sum(part**2 for part in np.gradient(value, 0.3)))
    np.testing.assert_array_equal(found, expected)


def test_the_threshold_is_sampled_at_voxels():
    """With one voxel a block, each sample is that voxel."""
    settings = GenerateSettings(voxel_mm=2.0, volume_ml=120.0, density="c")
    anatomy = generate._anatomy(settings, 5)
    lattice = body.lattice_of(anatomy.body, settings.voxel_mm)
    texture, paint = generate._texture(anatomy, 5), body.paint_of(anatomy.body)
    labels = np.zeros([axis.size for axis in lattice[:3]], np.uint8)
    shape = (*(side - 1 for side in texture.fields.shape[:3]), _sample_kernels.SAMPLES)
    potential, state = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
    middle = np.searchsorted(lattice.x_start, labels.shape[0] // 2, side="right") - 1
    layer = np.arange(middle, middle + 1)  # enough, and quick as plain Python too
    _sample_kernels.sample_potential(layer, labels, lattice, texture, paint, potential, state)
    undecided = np.argwhere(state[middle, ..., 0] == _sample_kernels.UNDECIDED)
    assert len(undecided) > 200
    for j, k in np.random.default_rng(1).permutation(undecided)[:20]:
        block = (middle, j, k)
        voxel = [start[n] for start, n in zip(lattice[-3:], block, strict=True)]
        point = np.array([axis[n] for axis, n in zip(lattice[:3], voxel, strict=True)])
        grain = naive.grain(texture, lattice.coarse_origin_mm, 2.0, point)
        wanted = naive.gland_potential(texture, lattice.coarse_origin_mm, 2.0, point) + grain
        if texture.gland_cap + grain <= 0.0:
            wanted = -1e9
        np.testing.assert_allclose(potential[block], wanted, rtol=1e-5, atol=1e-5)


def test_noise_is_zero_at_lattice_points_and_of_unit_variance():
    for point in np.random.default_rng(2).integers(-30, 30, (20, 3)).astype(float):
        assert _noise_kernels.gradient_noise(*point, 3) == 0.0
    points = np.random.default_rng(3).uniform(-200.0, 200.0, (4000, 3))
    values = np.array([_noise_kernels.gradient_noise(*point, 3) for point in points])
    # 4000 nearly independent values: the mean is known to 0.016, the variance to 3 % or so.
    assert abs(values.mean()) < 0.06
    assert values.var() == pytest.approx(1.0, abs=0.12)


@pytest.fixture(scope="module")
def net():
    """A net whose coordinates are turned and stretched against real ones.

    Its seeds are in double precision: where the compiled kernel adds an integer and a single in
    double precision, NumPy adds them in single, and the two would differ by a millionth of a cell.
    """
    rng = np.random.default_rng(4)
    axis = np.arange(0.0, 60.0, 2.0)
    drawn = lobules.draw_net([axis] * 3, 10.0, rng)
    drawn = drawn._replace(seeds=drawn.seeds.astype(float))
    return drawn, np.array([[0.8, 0.1, 0.0], [-0.2, 1.1, 0.0], [0.0, 0.3, 0.6]])


@pytest.fixture(scope="module")
def strands():
    """Pieces of strands in a ball of 60 mm, and the depth below its skin."""
    frame = VoxelFrame(np.full(3, -32.0), np.full(3, 2.0), (33, 33, 33))
    axis = np.arange(33) * 2.0 - 32.0
    places = np.meshgrid(axis, axis, axis, indexing="ij")
    away = np.linalg.norm(np.stack(places), axis=0)
    bent = [0.9 * part + 1.5 * np.sin(places[2] / 9.0) for part in places]
    tissue = threads.Tissue(30.0 - away, np.full(away.shape, -9.0), bent, frame)
    rng = np.random.default_rng(7)
    foams = (lobules.draw_net(bent, 9.0, rng), lobules.draw_net(bent, 7.0, rng))
    drawn = threads.draw_threads(tissue, foams, 1.0, 1.0, rng)
    return drawn, lambda at: 30.0 - np.linalg.norm(at, axis=-1)


def test_gathered_cells_give_the_walls_of_all_cells(net):
    drawn, slope = net
    rng, near = np.random.default_rng(5), _net_kernels.new_near()
    for centre in rng.uniform(20.0, 40.0, (30, 3)):
        found = _net_kernels.gather(drawn, centre, 1.8, 2.2, slope, near)
        assert 0 < found < _net_kernels.MAX_NEAR
        for _ in range(5):
            place = centre + rng.uniform(-1.0, 1.0, 3)
            cells = (place - drawn.origin_mm) / 10.0
            gap, inside = _wall_kernels.wall_distance(
                near.place, near.pair, near.block, near.holding[0], found, *cells, 1.1
            )
            gaps, fatness = naive.wall(drawn, place, slope)
            assert gap == pytest.approx(naive.rounded(gaps, 1.1), rel=1e-5, abs=1e-6)
            assert near.fatness[inside] == pytest.approx(fatness)


def filled(near, count, at, thick_mm, voxel_mm, border_mm):
    """Part of a voxel at a place of the lattice that the walls of gathered cells fill."""
    cells = np.arange(count)
    inside, least, _, _ = _net_kernels.three_nearest(near.place, cells, count, *at)
    return _wall_kernels.wall_fill(
        near.place, near.pair, cells, count, inside, least, at, thick_mm, voxel_mm, border_mm
    )


def test_walls_fill_their_thickness_whatever_the_voxel(net):
    """Filling times the voxel's side, added up across a wall, is the wall's thickness."""
    near = _net_kernels.new_near()
    near.place[0], near.place[1] = [0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0]
    near.tag[:2] = 0.25
    _net_kernels._pairs(near, 2, 2, 10.0, np.eye(3))
    factor = near.pair[0, 1, 1]
    for voxel in (0.1, 0.2, 0.5, 1.0):
        x = np.arange(2.0 + 0.37 * voxel, 8.0, voxel)
        filling = [filled(near, 2, (at / 10.0, 0.0, 0.0), 0.3, voxel, 1.1) for at in x]
        assert np.sum(filling) * voxel == pytest.approx(0.3 * factor, rel=1e-9)


def test_a_thread_fills_its_cross_section_whatever_the_voxel():
    """Filling times the voxel's face, added up across a thread, is the area of its section."""
    for radius in (0.08, 0.3, 0.7):
        for voxel in (0.1, 0.3, 0.8):
            axis = np.arange(-4.0 + 0.31 * voxel, 4.0, voxel)
            gaps = np.hypot(*np.meshgrid(axis, axis + 0.2 * voxel))
            filling = [_tube_kernels.thread_fill(gap, radius, voxel) for gap in gaps.ravel()]
            assert filling[:40] == [naive.thread_fill(g, radius, voxel) for g in gaps.ravel()[:40]]
            # A cone a voxel wide meets only a few voxel centres.
            area = np.sum(filling) * voxel**2
            assert area == pytest.approx(np.pi * radius**2, rel=0.13 if voxel >= radius else 0.03)


def test_walls_within_a_group_are_thin_and_those_between_groups_all_there():
    rng = np.random.default_rng(6)
    one, other = rng.random((2, 4000))
    within = _net_kernels.wall_strengths(one + 5.0, other + 5.0)
    # Of 4000 pairs: three standard deviations of a share of 0.35 are 0.023.
    assert np.mean(within == 0.0) == pytest.approx(_net_kernels.ABSENT_WALLS, abs=0.023)
    assert within.max() < _net_kernels.GROUP_WALL
    assert within[within > 0.0].min() >= _net_kernels.THIN_WALL
    alone = _net_kernels.wall_strengths(one - 1.0, other - 1.0)
    assert np.mean(alone == 0.0) == pytest.approx(_net_kernels.ABSENT_WALLS, abs=0.023)
    assert alone.max() > 0.95 * _net_kernels.MAX_WALL
    groups = rng.integers(0, 500, (2, 4000)).astype(float)
    groups[1] += groups[0] + 1.0
    between = _net_kernels.wall_strengths(one + groups[0], other + groups[1])
    assert between.min() >= _net_kernels.GROUP_WALL
    assert between.max() <= _net_kernels.MAX_WALL
    assert between.mean() > 1.15 * np.median(between)
    # a ligament has one thickness, from both sides
    again = _net_kernels.wall_strengths(other + groups[1], other + groups[0])
    np.testing.assert_allclose(between, again)


def test_edges_of_a_foam_are_as_far_from_three_cells_and_nodes_from_four():
    axis = np.arange(0.0, 40.0, 2.0)
    net = lobules.draw_net([axis] * 3, 8.0, np.random.default_rng(3))
    nodes, strands, strength = foam.foam_edges(net)
    present = np.argwhere(net.seeds[..., 3] >= _net_kernels.ABSENT)
    seeds = net.seeds[tuple(present.T)].astype(float)
    middle = (nodes[strands].mean(axis=1) - net.origin_mm) / net.cell_mm
    inner = ((middle > 1.5) & (middle < np.array(net.seeds.shape[:3]) - 1.5)).all(axis=1)
    assert np.count_nonzero(inner) > 100
    for places, cells in (
        (middle[inner], 3),
        ((nodes[strands[inner, 0]] - net.origin_mm) / net.cell_mm, 4),
    ):
        apart = ((places[:, None] - present - seeds[:, :3]) ** 2).sum(axis=-1) - seeds[:, 3]
        nearest = np.sort(apart, axis=1)[:, :cells]
        np.testing.assert_allclose(nearest, nearest[:, :1] + np.zeros(cells), atol=1e-6)
    assert 0.0 <= strength.min() < strength.max() <= _net_kernels.MAX_WALL


def test_walls_join_in_fillets_whatever_the_voxel():
    """Between two walls at a right angle, sqrt a + sqrt b < sqrt R bounds an area of R^2 / 6."""
    near = _net_kernels.new_near()
    near.place[:3] = [[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]
    near.tag[:3] = [0.6, 0.3, 0.3]
    _net_kernels._pairs(near, 3, 3, 10.0, np.eye(3))
    size = 4.0 * near.pair[0, 1, 1] * near.pair[0, 2, 1]
    assert 0.9 < size < 2.0
    for voxel in (0.02, 0.05):
        axis = np.arange(3.0 + 0.5 * voxel, 5.0, voxel) / 10.0
        area = voxel**2 * sum(
            filled(near, 3, (x, y, 0.0), 1e-9, voxel, 4.0) for x in axis for y in axis
        )
        # The face is some voxels long, and is spread over two.
        assert area == pytest.approx(size**2 / 6.0, rel=0.1 if voxel < 0.03 else 0.25)


def test_fibres_follow_edges_and_do_not_turn_back():
    axis = np.arange(0.0, 50.0, 2.0)
    net = lobules.draw_net([axis] * 3, 8.0, np.random.default_rng(3))
    nodes, edges, strength = foam.foam_edges(net)
    edges, strength = edges[strength > 0.0], strength[strength > 0.0]
    path, length = threads._walks(nodes, edges, strength, 200, 5.0, np.random.default_rng(4))
    known = {tuple(sorted(edge)) for edge in edges.tolist()}
    turns = []
    for nodes_passed, count in zip(path.tolist(), length, strict=True):
        passed = nodes_passed[: count + 1]
        assert all(tuple(sorted(edge)) in known for edge in pairwise(passed))
        assert all(before != after for before, after in zip(passed, passed[2:], strict=False))
        way = np.diff(nodes[passed], axis=0)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        turns += list((way[1:] * way[:-1]).sum(axis=1))
    assert 3.0 < length.mean() < 6.0
    assert np.mean(turns) > 0.5  # of the three edges that go on from a node, the straightest


def test_fibres_touch_the_middles_of_edges_and_round_off_nodes():
    rng = np.random.default_rng(8)
    at, radius = rng.uniform(0.0, 20.0, (30, 9, 3)), np.full((30, 9), 0.1)
    courses, radii = threads._spline(at, radius.copy(), rng.integers(1, 8, 30), 4)
    np.testing.assert_allclose(courses[:, ::4], 0.5 * (at[:, :7] + at[:, 1:8]))
    steps = np.diff(courses, axis=1)
    # The way from one piece to the next changes by a fixed part of the control points' bend.
    bend = np.linalg.norm(at[:, 2:] - 2.0 * at[:, 1:-1] + at[:, :-2], axis=2).max()
    assert np.linalg.norm(np.diff(steps, axis=1), axis=2).max() <= bend / 16.0 + 1e-9
    assert radii.max() <= 0.1 + 1e-12
    assert radii[:, 0].max() <= 0.05 + 1e-12  # half way into its taper


def test_strands_are_within_the_skin_of_many_calibres_and_smooth(strands):
    drawn, depth = strands
    middle = drawn.ends_mm.mean(axis=1)
    length = np.linalg.norm(drawn.ends_mm[:, 1] - drawn.ends_mm[:, 0], axis=1)
    assert len(middle) > 3000
    assert depth(middle).min() > -2.0  # by the nearest point of the grid
    thick = drawn.radius_mm.max(axis=1)
    assert np.quantile(thick, 0.99) > 6.0 * np.quantile(thick, 0.05)
    assert thick.max() <= threads.THICKEST_MM
    assert length.max() < 8.0
    # Pieces go on in others, or taper to nothing.
    ends, radius = drawn.ends_mm.reshape(-1, 3), drawn.radius_mm.ravel()
    gap = cKDTree(ends).query(ends, k=2)[0][:, 1]
    inner = (depth(ends) > 4.0) & (radius > 2.0 * threads.THINNEST_MM)
    assert np.mean(gap[inner] > 0.1) < 0.05


def test_threads_are_painted_by_the_part_they_fill_and_leave_other_tissue():
    axis = (np.arange(40) + 0.5) * 0.25
    start = np.arange(6) * 8
    lattice = _block_kernels.Lattice(axis, axis, axis, np.zeros(3), 2.0, start, start, start)
    name = np.array([LABEL[n] for n in ("adipose", "skin", "gland", "nipple", "muscle", "ligament",
                                        *SEPTA[:3])], np.uint8)  # fmt: skip
    ends = np.array([[[1.0, 4.9, 5.1], [9.0, 5.2, 4.8]], [[5.0, 1.0, 3.0], [5.3, 9.0, 3.0]]])
    radius = np.array([[0.2, 0.2], [0.1, 0.1]])
    labels = np.zeros((40, 40, 40), np.uint8)
    _tube_kernels.paint_threads(labels, lattice, ends, radius, name, 3)
    part = {0: 0.0, 1: 0.0, LABEL["ligament"]: 1.0, LABEL["ligament_half"]: 0.5,
            LABEL["ligament_quarter"]: 0.25, LABEL["ligament_eighth"]: 0.125}  # fmt: skip
    volume = sum(part[int(label)] for label in labels.ravel()) * 0.25**3
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    # By lot in some hundreds of voxels.
    wanted = (np.pi * radius[:, 0] ** 2 * length).sum()
    assert volume == pytest.approx(wanted, rel=0.1)
    # Another fibre along the same way adds to what is there.
    _tube_kernels.paint_threads(labels, lattice, ends, 0.5 * radius, name, 99)
    volume = sum(part[int(label)] for label in labels.ravel()) * 0.25**3
    assert volume == pytest.approx(1.25 * wanted, rel=0.1)


def test_the_steps_of_a_filling_have_its_mean():
    part = {0: 0.0, 5: 1.0, 6: 0.125, 7: 0.25, 8: 0.5}
    lots = (np.arange(20_000) + 0.5) / 20_000
    for fill in (0.01, 0.1, 0.125, 0.2, 0.3, 0.5, 0.77, 1.0):
        mean = np.mean([part[_fill_kernels.fill_step(fill, lot)] for lot in lots])
        assert mean == pytest.approx(fill, abs=1e-4)


def test_tubes_agree_with_their_twin():
    axis = np.arange(12) * 0.5
    start = np.arange(4) * 4
    lattice = _block_kernels.Lattice(axis, axis, axis, np.zeros(3), 2.0, start, start, start)
    ends = np.array([[[0.7, 1.0, 1.2], [4.0, 4.4, 3.1]], [[2.0, 4.5, 1.0], [2.0, 4.5, 1.0]]])
    radius, label = np.array([[0.1, 0.9], [0.8, 0.8]]), np.array([125, 95], np.uint8)
    labels = np.zeros((12, 12, 12), np.uint8)
    _tube_kernels.paint_tubes(labels, lattice, ends, radius, label)
    for index in np.ndindex(labels.shape):
        point, wanted = np.array(index) * 0.5, 0
        for piece in range(2):
            if naive.in_cone(point, *ends[piece], radius[piece]) or naive.on_axis(
                point, *ends[piece], 0.5
            ):
                wanted = label[piece]
        assert labels[index] == wanted


def test_the_nipple_is_a_blunt_tilted_cone():
    """Foot at 50 mm, 7 mm high, 5 mm wide at the foot, half of it at the tip, leaning laterally."""
    nipple = np.array([50.0, 7.0, 5.0, 0.5, 0.2, 0.0, 4.0, 0.0, 0.0, 4.0])

    def inside(x, y, z):
        return _surface_kernels.in_nipple(x, y, z, 50.0 - x, 1.5, nipple)

    assert inside(56.0, 1.2, 0.0)
    assert not inside(57.5, 1.4, 0.0)
    assert inside(53.0, 0.6 + 3.8, 0.0)
    assert not inside(53.0, 0.6 - 4.2, 0.0)
    assert inside(49.0, 4.9, 0.0)
    assert not inside(49.0, 5.1, 0.0)
    assert not inside(48.0, 0.0, 0.0)  # behind the skin
    # there its root narrows to nothing over 4 mm, unevenly
    edge = np.array([_surface_kernels.in_root(48.0, r, 0.0, 0.1, nipple) for r in (4.8, 5.2)])
    np.testing.assert_array_equal(edge, [True, False])
    wide = [
        sum(
            _surface_kernels.in_root(48.5 - below, r, 0.0, below, nipple)
            for r in np.arange(0, 9, 0.1)
        )
        for below in (0.1, 2.0, 3.9, 4.1)
    ]
    assert wide[0] > wide[1] > wide[2]
    assert wide[3] == 0
