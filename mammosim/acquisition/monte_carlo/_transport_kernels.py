"""Compiled photon transport: flights through coarse voxels, collisions, and scores.

A photon's *weight* is the energy that it stands for over its own energy. On each flight the whole
way out of the scene is followed once: what comes through is scored where it meets the detector
(expected-value scoring), what does not collides, at a place drawn along the way (forced collision).
In analog mode the weight is never changed and every event is drawn instead.

Voxels are words: the mixture in the lower 16 bits, the density in units of 1 / 8192 above.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import (
    Thread,
    contracting_kernel,
    inlined_kernel,
    kernel,
    parallel_kernel,
    share,
)
from mammosim.acquisition.monte_carlo._random_kernels import Stream, uniforms

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ray = tuple[float, float, float, float, float, float]
"""x, y, z in mm and the direction's cosines."""

MIXTURE_BITS, MIXTURE_MASK = np.uint32(16), np.uint32(0xFFFF)
DENSITY_STEPS = 8192.0

# Steps of the additive recurrence in four dimensions: powers of 1 / 1.1673039783, the root of
# x^5 = x + 1 (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
_STEPS = (0.8566748838545029, 0.7338918566271260, 0.6287067210378087, 0.5385972572236101)
_LARGEST_UNIFORM_DEPTH = 12.0
_SMALL_DEPTH = 0.3
_ROULETTE = 0.3  # part of the score aimed at below which photons are ended by chance
_DEEPEST = 3.0  # optical depth that counts at most: who lives on grows no heavier than at the start
EMITTED, DETECTED, ESCAPED, DEPOSITED = 0, 1, 2, 3


class Space(NamedTuple):
    """Cells between planes along each axis (gantry frame, mm), and the words of their voxels."""

    x: F64
    y: F64
    z: F64
    words: NDArray[np.uint32]


class Sections(NamedTuple):
    """Cross-sections. `attenuation` [energy, mixture] is for density 1 / 8192, 1/mm."""

    energy_kev: F64
    attenuation: F32
    fraction: F32
    incoherent: F32
    coherent: F32
    incoherent_cosine: F32
    coherent_cosine: F32


class Source(NamedTuple):
    """The focal spot and the field on the detector's plane, from which photons are drawn.

    `row_edge` (y) and `column_edge` (x) divide the field into cells; `row_sum` (rows,) and
    `column_sum` [row, column] are the cumulated probabilities of drawing each; `cell_weight` the
    true share of photons over that probability. `energy_sum` (bins,) is cumulated likewise, and
    `energy_weight` [column or 1, bin] the true photons over it.
    """

    spot: F64
    detector_z: float
    row_edge: F64
    column_edge: F64
    row_sum: F64
    column_sum: F64
    cell_weight: F64
    energy_sum: F64
    energy_weight: F64


class Screen(NamedTuple):
    """Where scatter is scored: cells in the image's order on the detector's plane.

    A photon at x, y is in row ``row_0 + row_y y`` and column ``column_0 + column_x x``.
    `response` [energy, cosine] is the part of its energy that is recorded, `grid` [energy, cosine,
    tangent] the grid's transmission; its strips run along x if `along_x` else along y, and are
    focused on `spot`.
    """

    z: float
    row_0: float
    row_y: float
    column_0: float
    column_x: float
    response: F32
    grid: F32
    largest_tangent: float
    along_x: bool
    spot: F64


class Plan(NamedTuple):
    """How many photons are followed in each batch, from which key, and how.

    A first flight collides in so many places that each scores about `score` keV, `collisions` at
    most.
    """

    photons: int
    key: Stream
    score: float
    collisions: int
    analog: bool
    mapped: bool
    first_photon: int


class Path(NamedTuple):
    """A flight cell by cell: optical depth and length at each cell's end, and the cell's place."""

    depth: F64
    length: F64
    place: NDArray[np.int64]


@parallel_kernel
def follow_photons(
    thread: Thread,
    plan: Plan,
    source: Source,
    space: Space,
    sections: Sections,
    screen: Screen,
    out_scatter: F64,
    out_collisions: F64,
    out_ledger: F64,
    out_map: F32,
) -> None:
    """Follow photons, batch by batch; each batch writes its own results.

    `out_scatter` [batch, 2, row, column] gets the recorded energy of scattered photons without and
    with the grid, keV; `out_collisions` [batch, energy, mixture] the weight that collides;
    `out_ledger` [batch, 4] energy emitted, detected (scatter only), escaped (all) and, in analog
    mode, deposited, keV; `out_map` [batch, voxel], if `plan.mapped`, the weight that collides times
    energy, keV. All are sums over the batch's photons.
    """
    longest = space.x.size + space.y.size + space.z.size + 3
    for batch in share(thread, 0, out_scatter.shape[0]):
        first = Path(np.empty(longest), np.empty(longest), np.empty(longest, np.int64))
        later = Path(np.empty(longest), np.empty(longest), np.empty(longest, np.int64))
        shift = uniforms(
            Stream(plan.key.key_0, plan.key.key_1, np.uint64(batch), np.uint64(0xFFFFFFFF)), 0
        )
        for photon in range(plan.photons):
            number = np.uint64(plan.first_photon + batch * plan.photons + photon)
            stream = Stream(
                plan.key.key_0, plan.key.key_1, number & np.uint64(0xFFFFFFFF),
                number >> np.uint64(32),
            )  # fmt: skip
            place = _place(shift, photon)
            ray, weight, energy = _emit(source, space, place)
            out_ledger[batch, EMITTED] += weight * sections.energy_kev[energy]
            _follow(
                plan, (ray, weight, energy, place[3]), stream, space, sections, screen,
                (first, later), out_scatter[batch], out_collisions[batch],
                (out_ledger[batch], out_map[min(batch, out_map.shape[0] - 1)]),
            )  # fmt: skip


@inlined_kernel
def _place(
    shift: tuple[float, float, float, float], photon: int
) -> tuple[float, float, float, float]:
    """The photon's point of a shifted additive recurrence: row, column, energy, depth."""
    a = shift[0] + photon * _STEPS[0]
    b = shift[1] + photon * _STEPS[1]
    c = shift[2] + photon * _STEPS[2]
    d = shift[3] + photon * _STEPS[3]
    return a - math.floor(a), b - math.floor(b), c - math.floor(c), d - math.floor(d)


@inlined_kernel
def _interval(sums: F64, value: float) -> int:
    """Index of the first cumulated sum that is above a value."""
    low, high = 0, sums.size - 1
    while low < high:
        middle = (low + high) >> 1
        if sums[middle] > value:
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def _emit(
    source: Source, space: Space, place: tuple[float, float, float, float]
) -> tuple[Ray, float, int]:
    """A photon where it enters the scene through its top, its weight and energy."""
    row = _interval(source.row_sum, place[0])
    before = source.row_sum[row - 1] if row > 0 else 0.0
    part = (place[0] - before) / (source.row_sum[row] - before)
    y = source.row_edge[row] + part * (source.row_edge[row + 1] - source.row_edge[row])
    sums = source.column_sum[row]
    column = _interval(sums, place[1])
    before = sums[column - 1] if column > 0 else 0.0
    part = (place[1] - before) / (sums[column] - before)
    x = source.column_edge[column] + part * (
        source.column_edge[column + 1] - source.column_edge[column]
    )
    energy = _interval(source.energy_sum, place[2])
    dx, dy = x - source.spot[0], y - source.spot[1]
    dz = source.detector_z - source.spot[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    cosine = -dz / distance
    weight = source.cell_weight[row, column] * cosine**3
    weight *= source.energy_weight[min(column, source.energy_weight.shape[0] - 1), energy]
    down = (source.spot[2] - space.z[-1]) / -dz
    ray = (
        source.spot[0] + down * dx, source.spot[1] + down * dy, space.z[-1],
        dx / distance, dy / distance, dz / distance,
    )  # fmt: skip
    return ray, weight, energy


@kernel
def _follow(
    plan: Plan,
    photon: tuple[Ray, float, int, float],
    stream: Stream,
    space: Space,
    sections: Sections,
    screen: Screen,
    paths: tuple[Path, Path],
    out_scatter: F64,
    out_collisions: F64,
    out_tallies: tuple[F64, F32],
) -> None:
    """Follow one photon and all that scatters from it.

    The first flight is forced to collide in several places, evenly spread over its optical depth;
    each is followed to its end.
    """
    ray, weight, energy, start = photon
    first, later = paths
    ledger = out_tallies[0]
    cell = _cell_at_top(space, ray)
    steps, through = _fly(
        plan, space, sections.attenuation[energy], ray, cell,
        (weight, sections.energy_kev[energy]), first, out_collisions[energy], out_tallies[1],
    )  # fmt: skip
    block = np.uint64(0)
    collisions = 1
    if not plan.analog:
        score = weight * sections.energy_kev[energy] * through * first.depth[steps - 1]
        collisions = min(max(int(score / plan.score + 0.5), 1), plan.collisions)
    if not plan.analog:
        ledger[ESCAPED] += weight * through * sections.energy_kev[energy]
    for collision in range(collisions):
        u = (collision + start) / collisions
        here, power, path, count, way = energy, weight / collisions, first, steps, ray
        below = first.depth[steps - 1] if steps > 0 else 0.0
        while True:
            if plan.analog:
                u = uniforms(stream, block)[0]
                block += np.uint64(1)
            depth, factor = _draw_depth(path, count, way[5] < 0.0, u, plan.analog)
            if factor == 0.0:  # nothing in the way, or, in analog mode, out of the scene
                if plan.analog:
                    ledger[ESCAPED] += power * sections.energy_kev[here]
                    if path.place[0] >= 0 and block > np.uint64(1):
                        _score(
                            screen, sections.energy_kev[here], way, power, here, out_scatter, ledger
                        )
                break
            power *= factor
            below = _depth_below(path.depth[count - 1], depth, way[5], below)
            numbers = uniforms(stream, block)
            block += np.uint64(1)
            step = _interval(path.depth[:count], depth)
            place = path.place[step]
            way = _moved(path, step, depth, way)
            power, after, cosine = _collide(
                plan.analog, sections, space.words[place], (power, here, numbers[0], numbers[1]),
                ledger,
            )  # fmt: skip
            turn = numbers[3]
            if not plan.analog:  # roulette, an even game, where little would be scored
                worth = power * sections.energy_kev[after] * math.exp(-min(below, _DEEPEST))
                chance = worth / (_ROULETTE * plan.score)
                if turn >= chance:
                    break
                if chance < 1.0:
                    power /= chance
                    turn /= chance
            if power == 0.0:
                break
            here = after
            way = _turned(way, cosine, 2.0 * math.pi * turn)
            path = later
            count, through = _fly(
                plan, space, sections.attenuation[here], way, place,
                (power, sections.energy_kev[here]), later, out_collisions[here], out_tallies[1],
            )  # fmt: skip
            if not plan.analog:
                kept = power * through
                ledger[ESCAPED] += kept * sections.energy_kev[here]
                _score(screen, sections.energy_kev[here], way, kept, here, out_scatter, ledger)
            u = numbers[2]


@kernel
def _cell_at_top(space: Space, ray: Ray) -> int:
    """Place of the cell below a point of the scene's top."""
    ny, nz = space.y.size - 1, space.z.size - 1
    i = _interval(space.x[1:], ray[0])
    j = _interval(space.y[1:], ray[1])
    return (i * ny + j) * nz + nz - 1


@contracting_kernel
def _fly(
    plan: Plan,
    space: Space,
    attenuation: F32,
    ray: Ray,
    start: int,
    carried: tuple[float, float],
    path: Path,
    out_collisions: F64,
    out_map: F32,
) -> tuple[int, float]:
    """Follow a ray from a cell out of the scene; the number of steps, and what comes through.

    Traversal of Amanatides and Woo 1987 (Eurographics), with planes at any distance. `carried` is
    weight and energy; the weight that is lost in each cell is added to its mixture's collisions.
    """
    nx, ny, nz = space.x.size - 1, space.y.size - 1, space.z.size - 1
    i, j, k = start // (ny * nz), start // nz % ny, start % nz
    x, y, z, dx, dy, dz = ray
    over_x = 1.0 / dx if dx != 0.0 else math.inf
    over_y = 1.0 / dy if dy != 0.0 else math.inf
    over_z = 1.0 / dz if dz != 0.0 else math.inf
    up_x, up_y, up_z = int(dx > 0.0), int(dy > 0.0), int(dz > 0.0)
    to_x = (space.x[i + up_x] - x) * over_x if dx != 0.0 else math.inf
    to_y = (space.y[j + up_y] - y) * over_y if dy != 0.0 else math.inf
    to_z = (space.z[k + up_z] - z) * over_z if dz != 0.0 else math.inf
    steps, depth, length, through = 0, 0.0, 0.0, 1.0
    tally = not plan.analog
    while True:
        end = max(min(to_x, to_y, to_z), length)
        place = (i * ny + j) * nz + k
        word = space.words[np.uint64(place)]
        mixture = word & MIXTURE_MASK
        crossed = attenuation[mixture] * np.float64(word >> MIXTURE_BITS) * (end - length)
        if crossed < _SMALL_DEPTH:  # Taylor: within 1e-6 of 1 - exp(-crossed)
            gone = crossed * (
                1.0
                - crossed
                / 2.0
                * (1.0 - crossed / 3.0 * (1.0 - crossed / 4.0 * (1.0 - crossed / 5.0)))
            )
        else:
            gone = -math.expm1(-crossed)
        if tally:
            lost = carried[0] * through * gone
            out_collisions[mixture] += lost
            if plan.mapped:
                out_map[place] += lost * carried[1]
        through -= through * gone
        depth += crossed
        length = end
        path.depth[steps], path.length[steps], path.place[steps] = depth, length, place
        steps += 1
        if to_x <= to_y and to_x <= to_z:
            i += 2 * up_x - 1
            if i < 0 or i >= nx:
                break
            to_x = (space.x[i + up_x] - x) * over_x
        elif to_y <= to_z:
            j += 2 * up_y - 1
            if j < 0 or j >= ny:
                break
            to_y = (space.y[j + up_y] - y) * over_y
        else:
            k += 2 * up_z - 1
            if k < 0 or k >= nz:
                break
            to_z = (space.z[k + up_z] - z) * over_z
    return steps, through


@kernel
def _draw_depth(path: Path, steps: int, down: bool, u: float, analog: bool) -> tuple[float, float]:
    """Optical depth of the next collision and the factor that this choice puts on the weight.

    In nature the density of depths t is exp(-t). Downwards, where what collides late reaches the
    detector best, they are drawn evenly, so that all scores weigh about the same; elsewhere from
    exp(-t) cut off at the scene's end. A factor of 0 says that there is no collision.
    """
    last = path.depth[steps - 1]
    if analog:
        depth = -math.log(u)
        return (depth, 1.0) if depth < last else (0.0, 0.0)
    if last <= 0.0:
        return 0.0, 0.0
    if down and last < _LARGEST_UNIFORM_DEPTH:
        depth = u * last
        return depth, last * math.exp(-depth)
    lost = -math.expm1(-last)
    return min(-math.log1p(-u * lost), last * (1.0 - 1e-12)), lost


@inlined_kernel
def _depth_below(last: float, depth: float, slope: float, below: float) -> float:
    """Optical depth straight down from a collision, as far as the flights so far tell."""
    if slope < 0.0:
        return (last - depth) * -slope
    return below + depth * slope


@inlined_kernel
def _moved(path: Path, step: int, depth: float, ray: Ray) -> Ray:
    """The ray begun anew at an optical depth within a step."""
    before = path.depth[step - 1] if step > 0 else 0.0
    behind = path.length[step - 1] if step > 0 else 0.0
    part = (depth - before) / (path.depth[step] - before)
    length = behind + part * (path.length[step] - behind)
    x, y, z, dx, dy, dz = ray
    return x + length * dx, y + length * dy, z + length * dz, dx, dy, dz


@kernel
def _collide(
    analog: bool,
    sections: Sections,
    word: np.uint32,
    photon: tuple[float, int, float, float],
    ledger: F64,
) -> tuple[float, int, float]:
    """A collision in a voxel: weight and energy bin afterwards, and cosine of the angle.

    The weight is reduced by the part that is absorbed; in analog mode absorption is drawn, and the
    energy that stays entered into the ledger.
    """
    power, energy, u, v = photon
    mixture = word & MIXTURE_MASK
    materials = sections.fraction.shape[1]
    scattered = 0.0
    for m in range(materials):
        part = sections.fraction[mixture, m]
        scattered += part * (sections.incoherent[energy, m] + sections.coherent[energy, m])
    chance = scattered / (sections.attenuation[energy, mixture] * DENSITY_STEPS)
    if analog:
        if u >= chance:
            ledger[DEPOSITED] += power * sections.energy_kev[energy]
            return 0.0, energy, 1.0
        u /= chance
    else:
        power *= chance
    left = u * scattered
    material, coherent = materials - 1, False
    for m in range(materials):
        part = sections.fraction[mixture, m]
        width = part * sections.incoherent[energy, m]
        if left < width:
            left /= width
            material = m
            break
        left -= width
        width = part * sections.coherent[energy, m]
        if left < width:
            left /= width
            material, coherent = m, True
            break
        left -= width
    cosines = sections.coherent_cosine if coherent else sections.incoherent_cosine
    place = v * (cosines.shape[2] - 1)
    at = min(int(place), cosines.shape[2] - 2)
    low, high = cosines[energy, material, at], cosines[energy, material, at + 1]
    cosine = low + (place - at) * (high - low)
    after = energy
    if not coherent:
        after = _lowered(sections.energy_kev, energy, cosine, left)
        if analog:
            ledger[DEPOSITED] += power * (sections.energy_kev[energy] - sections.energy_kev[after])
    return power, after, cosine


@inlined_kernel
def _lowered(energies: F64, energy: int, cosine: float, u: float) -> int:
    """Energy bin after a Compton event: one of the two nearest, so that the mean is right."""
    kev = energies[energy]
    scattered = kev / (1.0 + kev / 510.999 * (1.0 - cosine))
    place = (scattered - energies[0]) / (energies[1] - energies[0])
    low = math.floor(place)
    return max(int(low) + int(u < place - low), 0)


@inlined_kernel
def _turned(ray: Ray, cosine: float, azimuth: float) -> Ray:
    """The ray turned by an angle and an azimuth about its direction."""
    x, y, z, dx, dy, dz = ray
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    across, along = sine * math.cos(azimuth), sine * math.sin(azimuth)
    flat = math.sqrt(max(1.0 - dz * dz, 0.0))
    if flat > 1e-6:
        ex, ey = dx / flat, dy / flat
        nx = cosine * dx + across * ex * dz - along * ey
        ny = cosine * dy + across * ey * dz + along * ex
        nz = cosine * dz - across * flat
    else:
        nx, ny, nz = across, along, math.copysign(cosine, dz * cosine)
    norm = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    return x, y, z, nx * norm, ny * norm, nz * norm


@kernel
def _score(
    screen: Screen,
    kev: float,
    ray: Ray,
    weight: float,
    energy: int,
    out_scatter: F64,
    ledger: F64,
) -> None:
    """Add a photon that leaves the scene downwards to the cell of the detector that it meets."""
    x, y, z, dx, dy, dz = ray
    if dz >= 0.0:
        return
    down = (screen.z - z) / dz
    x += down * dx
    y += down * dy
    row, column = screen.row_0 + screen.row_y * y, screen.column_0 + screen.column_x * x
    _, rows, columns = out_scatter.shape
    if not (0.0 <= row < rows and 0.0 <= column < columns):
        return
    ledger[DETECTED] += weight * kev
    at = min(int(-dz * screen.response.shape[1]), screen.response.shape[1] - 1)
    recorded = weight * kev * screen.response[energy, at]
    out_scatter[0, int(row), int(column)] += recorded
    if screen.grid.shape[0] > 1:
        height = screen.spot[2] - screen.z
        if screen.along_x:
            tangent = abs(dy / -dz - (y - screen.spot[1]) / height)
        else:
            tangent = abs(dx / -dz - (x - screen.spot[0]) / height)
        last = screen.grid.shape[2] - 1
        near = min(int(tangent / screen.largest_tangent * last), last)
        at = min(int(-dz * screen.grid.shape[1]), screen.grid.shape[1] - 1)
        out_scatter[1, int(row), int(column)] += recorded * screen.grid[energy, at, near]
