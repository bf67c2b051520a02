"""Compiled photon transport: photons from the focal spot, followed until they are gone.

A photon's *weight* is the energy that it stands for over its own energy. On each flight the whole
way out of the scene is followed once: what comes through is scored where it meets the detector
(expected-value scoring), what does not collides, at a place drawn along the way (forced collision).
In analog mode the weight is never changed and every event is drawn instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mammosim._jit import Thread, borrowing_kernel, inlined_kernel, parallel_kernel, share
from mammosim.acquisition.monte_carlo._collision_kernels import Sections, collide, turned
from mammosim.acquisition.monte_carlo._detection_kernels import Screen, Turn, score_at_screen
from mammosim.acquisition.monte_carlo._flight_kernels import (
    EMITTED,
    ESCAPED,
    F32,
    F64,
    Path,
    Plan,
    Ray,
    Space,
    cell_at_top,
    depth_below,
    draw_depth,
    fly,
    interval,
    moved,
)
from mammosim.acquisition.monte_carlo._random_kernels import Stream, uniforms

# Steps of the additive recurrence in four dimensions: powers of 1 / 1.1673039783, the root of
# x^5 = x + 1 (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences").
_STEPS = (0.8566748838545029, 0.7338918566271260, 0.6287067210378087, 0.5385972572236101)
_ROULETTE = 0.3  # part of the score aimed at below which photons are ended by chance
_DEEPEST = 3.0  # optical depth that counts at most: who lives on grows no heavier than at the start


class Source(NamedTuple):
    """The focal spot and the field on the detector's plane, from which photons are drawn.

    `spot` is in the gantry's frame; `spot_above` and the field are in the detector's, to which
    `turn` leads. `row_edge` (y) and `column_edge` (x) divide the field into cells; `row_sum`
    (rows,) and `column_sum` [row, column] are the cumulated probabilities of drawing each;
    `cell_weight` the true share of photons over that probability. `energy_sum` (bins,) is cumulated
    likewise, and `energy_weight` [column or 1, bin] the true photons over it.
    """

    spot: F64
    spot_above: F64
    turn: Turn
    detector_z: float
    row_edge: F64
    column_edge: F64
    row_sum: F64
    column_sum: F64
    cell_weight: F64
    energy_sum: F64
    energy_weight: F64


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
    mode, deposited, keV; `out_map` [batch, voxel], if `plan.mapped`, the energy deposited, keV. All
    are sums over the batch's photons.
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


@borrowing_kernel
def _emit(
    source: Source, space: Space, place: tuple[float, float, float, float]
) -> tuple[Ray, float, int]:
    """A photon where it enters the scene through its top, its weight and energy."""
    row = interval(source.row_sum, place[0])
    before = source.row_sum[row - 1] if row > 0 else 0.0
    part = (place[0] - before) / (source.row_sum[row] - before)
    y = source.row_edge[row] + part * (source.row_edge[row + 1] - source.row_edge[row])
    sums = source.column_sum[row]
    column = interval(sums, place[1])
    before = sums[column - 1] if column > 0 else 0.0
    part = (place[1] - before) / (sums[column] - before)
    x = source.column_edge[column] + part * (
        source.column_edge[column + 1] - source.column_edge[column]
    )
    energy = interval(source.energy_sum, place[2])
    dx, dv = x - source.spot_above[0], y - source.spot_above[1]
    dw = source.detector_z - source.spot_above[2]
    distance = math.sqrt(dx * dx + dv * dv + dw * dw)
    cosine = -dw / distance
    turn = source.turn
    dy, dz = turn.cosine * dv + turn.sine * dw, turn.cosine * dw - turn.sine * dv
    weight = source.cell_weight[row, column] * cosine**3
    weight *= source.energy_weight[min(column, source.energy_weight.shape[0] - 1), energy]
    down = (source.spot[2] - space.z[-1]) / -dz
    ray = (
        source.spot[0] + down * dx, source.spot[1] + down * dy, space.z[-1],
        dx / distance, dy / distance, dz / distance,
    )  # fmt: skip
    return ray, weight, energy


@borrowing_kernel
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
    cell = cell_at_top(space, ray)
    steps, through = fly(
        plan, space, sections.attenuation[energy], sections.deposit[energy], ray, cell,
        weight, first, out_collisions[energy], out_tallies[1],
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
            depth, factor = draw_depth(path, count, way[5] < 0.0, u, plan.analog)
            if factor == 0.0:  # nothing in the way, or, in analog mode, out of the scene
                if plan.analog:
                    ledger[ESCAPED] += power * sections.energy_kev[here]
                    if path.place[0] >= 0 and block > np.uint64(1):
                        score_at_screen(
                            screen, sections.energy_kev[here], way, power, here, out_scatter, ledger
                        )
                break
            power *= factor
            below = depth_below(path.depth[count - 1], depth, way[5], below)
            numbers = uniforms(stream, block)
            block += np.uint64(1)
            step = interval(path.depth[:count], depth)
            place = path.place[step]
            way = moved(path, step, depth, way)
            power, after, cosine = collide(
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
            way = turned(way, cosine, 2.0 * math.pi * turn)
            path = later
            count, through = fly(
                plan, space, sections.attenuation[here], sections.deposit[here], way, place,
                power, later, out_collisions[here], out_tallies[1],
            )  # fmt: skip
            if not plan.analog:
                kept = power * through
                ledger[ESCAPED] += kept * sections.energy_kev[here]
                score_at_screen(
                    screen, sections.energy_kev[here], way, kept, here, out_scatter, ledger
                )
            u = numbers[2]
