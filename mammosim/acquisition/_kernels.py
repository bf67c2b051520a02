"""Compiled loops over the pixels of an image. Every turn of a parallel loop writes its own row."""

from __future__ import annotations

from math import exp, log, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, parallel_kernel, share

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

# Grey beyond which the sum of base and detail is bent, so that it stays within 0 and 1.
FINAL_SHOULDER = 0.85

# Air fades to black from this far below fat on the straight scale of grey, over this much of it.
AIR_BELOW_FAT, AIR_FADE = 0.4, 0.1

# Details keep at least this part of their straight contrast where the base lies on the toe or
# shoulder.
MIN_TOE_SLOPE, MIN_SHOULDER_SLOPE = 0.34, 0.32

# On the shoulder, away from strong steps, weak details keep this part of their contrast: on
# clinical images fibres of muscle, and strands before it, are seen as well as those in fat.
EVEN_SHOULDER_SLOPE = 0.75

# Grain is shown as if a sigmoid window followed, this many times as
# strongly as the straight line per unit of grey * (1 - grey). On six clinical images grain follows
# grey so within a fifth, from 0.1 to 0.8: it is strongest in the middle greys, 2.3 times that in
# fat, and 1.5 times in muscle.
FINE_WINDOW = 2.8

# Grain of quanta grows (ln) by this part of the attenuation: details of that size are weakened as
# much, as if noise had been equalized before.
GRAIN_GROWTH = 0.5

# Slope of the toe below which details are not raised any further.
FLATTEST_TOE = 0.05

# Part of the fine details' enhancement that is left out beside strong steps.
BESIDE_STEPS = 0.5

# Details (ln) well below this part of the contrast of gland above fat are enhanced in full, those
# well above hardly: no halo beside edges. By eye, and so that bright lines stand out in dense
# breasts as in fatty ones.
DETAIL_LIMIT = 0.23

# Where gland has less contrast (ln) than this, most details are strands in fat, and the limit falls
# with the square of the contrast, so that lines in fatty breasts do not look hard. By eye.
USUAL_CONTRAST = 0.95


class Rays(NamedTuple):
    """Tangents of each pixel's ray to the central one.

    Parameters
    ----------
    row_tangent, column_tangent : ndarray of float64, (rows,), (columns,)
        Distance from the central ray along each axis over the source to detector distance.
    turn_cosine, turn_sine : float
        Of the angle by which the detector is turned against the flat layers in the way.
    """

    row_tangent: NDArray[np.float64]
    column_tangent: NDArray[np.float64]
    turn_cosine: float
    turn_sine: float


class Weights(NamedTuple):
    """The sum over energies for rays at right angles to the detector.

    Parameters
    ----------
    energy, square : ndarray of float64, [column or 1, energy]
        Absorbed energy of each bin and its second moment, per column of pixels or for all.
    flat_depth : ndarray of float64, (energies,)
        Attenuation of the flat layers in the way, crossed at right angles.
    mean_depth : float
        Its mean, weighted with the energy absorbed behind nothing else.
    """

    energy: NDArray[np.float64]
    square: NDArray[np.float64]
    flat_depth: NDArray[np.float64]
    mean_depth: float


@parallel_kernel
def primary_kernel(
    thread: Thread,
    length_mm: F32,
    mu_per_mm: F64,
    weights: Weights,
    rays: Rays,
    out_signal: F32,
    out_square: F32,
) -> None:
    """Absorbed energy and its second moment behind each pixel's path.

    ``out = cos^3 sum_e weight_e exp(-sum_t mu_te length_t - depth_e (1/cos - 1))``: the fluence
    falls with the square of the distance and with the obliquity of the detector, and an oblique
    ray has more of the flat layers in its way. In air alone their mean depth is used, which
    `log_attenuation_kernel` takes back (1e-4 of the signal at 1/cos = 1.1).

    `length_mm` is float32 [tissue, row, column], `mu_per_mm` [energy, tissue]; `out_*` are
    float32 [row, column].
    """
    tissues, rows, columns = length_mm.shape
    sources, energies = weights.energy.shape
    air_signal, air_square = np.zeros(sources), np.zeros(sources)
    for source in range(sources):
        for e in range(energies):
            air_signal[source] += weights.energy[source, e]
            air_square[source] += weights.square[source, e]
    mu_of_tissue = np.empty((tissues, energies))
    for tissue in range(tissues):
        for e in range(energies):
            mu_of_tissue[tissue, e] = mu_per_mm[e, tissue]
    for row in share(thread, 0, rows):
        met = np.empty(tissues, np.int64)
        depth = np.empty(energies)
        for column in range(columns):
            number = 0
            for tissue in range(tissues):
                if length_mm[tissue, row, column] > 0.0:
                    met[number] = tissue
                    number += 1
            source = min(column, sources - 1)
            secant = _secant(rays, row, column)
            excess = _excess(rays, row, secant)
            if number == 0:
                passed = exp(-weights.mean_depth * excess)
                signal = air_signal[source] * passed
                square = air_square[source] * passed
            else:
                signal = 0.0
                square = 0.0
                for e in range(energies):
                    depth[e] = weights.flat_depth[e] * excess
                for k in range(number):
                    length = float(length_mm[met[k], row, column])
                    for e in range(energies):
                        depth[e] += mu_of_tissue[met[k], e] * length
                for e in range(energies):
                    transmitted = exp(-depth[e])
                    signal += weights.energy[source, e] * transmitted
                    square += weights.square[source, e] * transmitted
            falloff = 1.0 / (secant * secant * secant)
            out_signal[row, column] = signal * falloff
            out_square[row, column] = square * falloff


@kernel
def _secant(rays: Rays, row: int, column: int) -> float:
    """One over the cosine of the angle between a pixel's ray and the detector's normal."""
    u, v = rays.row_tangent[row], rays.column_tangent[column]
    return sqrt(1.0 + u * u + v * v)


@kernel
def _excess(rays: Rays, row: int, secant: float) -> float:
    """By how much more of the flat layers is in the way than on a ray at right angles to them.

    They stay where they are when the detector turns. The converter's gain is counted among them.
    """
    return secant / (rays.turn_cosine + rays.turn_sine * rays.row_tangent[row]) - 1.0


@kernel
def _interpolated(
    coarse: F64,
    y: float,
    x: float,
) -> float:
    """Bilinear value of a coarse image at fractional cell indices, held beyond its edges."""
    rows, columns = coarse.shape
    y = min(max(y, 0.0), rows - 1.0)
    x = min(max(x, 0.0), columns - 1.0)
    i, j = int(y), int(x)
    i_next, j_next = min(i + 1, rows - 1), min(j + 1, columns - 1)
    upper = coarse[i, j] * (1.0 - (x - j)) + coarse[i, j_next] * (x - j)
    lower = coarse[i_next, j] * (1.0 - (x - j)) + coarse[i_next, j_next] * (x - j)
    return upper * (1.0 - (y - i)) + lower * (y - i)


@parallel_kernel
def add_scatter_kernel(
    thread: Thread,
    coarse: F64,
    cell: float,
    primary_part: float,
    scatter_part: float,
    out_signal: F32,
    out_square: F32,
) -> None:
    """Add scatter of a coarse grid, in place, and let the grid take its part of both.

    `coarse` is float64 [row, column], cells of `cell` pixels, interpolated linearly between cell
    centres. Scattered photons are taken to have the energies of the primary at that pixel, so the
    second moment grows with the signal.
    """
    rows, columns = out_signal.shape
    for row in share(thread, 0, rows):
        for column in range(columns):
            here = _interpolated(coarse, (row + 0.5) / cell - 0.5, (column + 0.5) / cell - 0.5)
            scatter = scatter_part * here
            primary = primary_part * out_signal[row, column]
            ratio = 0.0
            if out_signal[row, column] > 0.0:  # behind a centimetre of metal nothing is left
                ratio = out_square[row, column] / out_signal[row, column]
            out_signal[row, column] = primary + scatter
            out_square[row, column] = (primary + scatter) * ratio


@parallel_kernel
def log_attenuation_kernel(
    thread: Thread,
    signal: F32,
    air_signal: F64,
    mean_depth: float,
    rays: Rays,
    out_attenuation: F32,
) -> None:
    """Logarithm of the signal of air over each pixel's own, flat-fielded.

    `air_signal` [column or 1] is that of rays at right angles to the detector. A signal below a
    millionth of air's counts as that.
    """
    rows, columns = signal.shape
    for row in share(thread, 0, rows):
        for column in range(columns):
            air = air_signal[min(column, air_signal.size - 1)]
            secant = _secant(rays, row, column)
            flat = signal[row, column] * secant**3 * exp(mean_depth * _excess(rays, row, secant))
            out_attenuation[row, column] = log(air / max(flat, 1e-6 * air))


class ToneCurve(NamedTuple):
    """How equalized attenuation becomes grey.

    Parameters
    ----------
    fat, contrast : float
        Attenuation (ln) of fat, and of gland above it.
    fat_grey, gland_grey : float
        Their grey, as part of the range, on the straight line that the curve bends.
    toe, shoulder : float
        Grey below and above which the curve for the base bends.
    white : float
        Grey that the shoulder of the base nears.
    wide_gain, fine_gain : float
        Contrast of details that the middle still holds, and of those that it does not, over that
        of the base.
    grain : float
        Fine details (ln) well below this are taken for grain.
    """

    fat: float
    contrast: float
    fat_grey: float
    gland_grey: float
    toe: float
    shoulder: float
    white: float
    wide_gain: float
    fine_gain: float
    grain: float


@kernel
def _edge_part(place: float) -> float:
    """Part of its grey that a place is shown with: 0 in air, 1 from the skin line inwards."""
    ramp = min(max(place, 0.0), 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


@kernel
def _weak_part(strength: float) -> float:
    """Part of a detail that is enhanced: all of a faint one, the same amount of any strong one."""
    return tanh(strength) / strength if strength > 1e-6 else 1.0


@kernel
def _on_toe(value: float, toe: float) -> float:
    """`value`, but below the toe it nears 0, with no kink."""
    return toe * exp((value - toe) / toe) if value < toe else value


@kernel
def _bent(value: float, toe: float, shoulder: float, white: float) -> float:
    """`value`, but below the toe it nears 0 and above the shoulder `white`, with no kink.

    It nears white slowly, as a hyperbola, so that differences far above the shoulder are seen.
    """
    if value > shoulder:
        return white - (white - shoulder) ** 2 / (white - 2.0 * shoulder + value)
    return _on_toe(value, toe)


@kernel
def _on_sigmoid(value: float, more: float) -> float:
    """Where on a sigmoid between 0 and 1 one gets from `value` by `more`."""
    value = min(max(value, 0.0), 1.0)
    return value / (value + (1.0 - value) * exp(-more))


@parallel_kernel
def present_kernel(
    thread: Thread,
    attenuation: F32,
    missing: F64,
    edge: F64,
    rise: F64,
    evened: F64,
    base: F64,
    middle: F64,
    even: F64,
    cell: float,
    edge_reach: tuple[float, float],
    nipple: float,
    curve: ToneCurve,
    maximum: float,
    out_pixels: NDArray[np.uint16],
) -> None:
    """Add what the margin lacks, split the sum into base and detail, and show both as grey.

    `missing`, `edge`, `rise`, `evened`, `base`, `middle` (between base and the image) and `even` (0
    beside strong steps, else 1) are coarse and interpolated linearly. `edge` is added in full up to
    the first place on the ramp of `rise` of `edge_reach`, and not at all from the second; then the
    sum goes the part `evened` of the way to the attenuation `nipple`. Detail is added to the base,
    weak detail times the gain of its scale, and raised where the curve is flat; the curve's toe
    shows the sum, and on its shoulder detail keeps a part of its contrast, wide detail most of it.
    Grain moves along a sigmoid instead, so that it does not stand out where the curve is steep. The
    sum is bent at white once more, so that nothing is clipped. Grey rises from black over the skin
    line.
    """
    slope = (curve.gland_grey - curve.fat_grey) / curve.contrast
    detail_limit = DETAIL_LIMIT * curve.contrast * min(curve.contrast / USUAL_CONTRAST, 1.0)
    rows, columns = attenuation.shape
    for row in share(thread, 0, rows):
        for column in range(columns):
            y, x = (row + 0.5) / cell - 0.5, (column + 0.5) / cell - 0.5
            place = _interpolated(rise, y, x)
            part = _edge_part(place)
            if part == 0.0:
                out_pixels[row, column] = 0  # air
                continue
            level = attenuation[row, column] + _interpolated(missing, y, x)
            near, far = edge_reach
            level += _edge_part((far - place) / (far - near)) * _interpolated(edge, y, x)
            level += _interpolated(evened, y, x) * (nipple - level)
            smooth = _interpolated(base, y, x)
            straight = curve.fat_grey + slope * (smooth - curve.fat)
            shown = _bent(straight, curve.toe, curve.shoulder, curve.white)
            wide = _interpolated(middle, y, x) - smooth
            fine = level - smooth - wide
            # near the edge it is no detail but the edge, whose base is coarse
            strength = (abs(wide) + abs(fine)) / detail_limit
            weak = _edge_part(0.5 * place) * _weak_part(strength)
            wide, fine = weak * wide, weak * fine
            away = _interpolated(even, y, x)
            fine_gain = 1.0 + (curve.fine_gain - 1.0) * (1.0 - BESIDE_STEPS * (1.0 - away))
            quiet = exp(-GRAIN_GROWTH * max(smooth - curve.fat, 0.0))
            limit = curve.grain / quiet
            grain = limit * tanh(fine / limit)
            enhanced = curve.wide_gain * wide + fine_gain * (fine - grain)
            # of the base's curve there: its toe is exponential, its shoulder a hyperbola
            on_toe = max(min(shown / curve.toe, 1.0), FLATTEST_TOE)
            on_shoulder = ((curve.white - shown) / (curve.white - curve.shoulder)) ** 2
            on_shoulder = min(max(on_shoulder, MIN_SHOULDER_SLOPE), 1.0)
            # the toe bends what is enhanced, so that bright detail stands out more than dark
            kept = max(MIN_TOE_SLOPE / on_toe, 1.0)
            raised = straight + slope * (level - smooth - wide - fine + kept * enhanced)
            shown += on_shoulder * (_on_toe(raised, curve.toe) - _on_toe(straight, curve.toe))
            lost = max(EVEN_SHOULDER_SLOPE - on_shoulder, 0.0) * away * curve.wide_gain * wide
            shown += slope * lost
            shown = _on_sigmoid(shown, FINE_WINDOW * slope * quiet * fine_gain * grain)
            shown = _bent(max(shown, 0.0), 0.0, FINAL_SHOULDER, 1.0)
            below = raised - curve.fat_grey + AIR_BELOW_FAT
            if below < 0.0:
                shown *= exp(below / AIR_FADE)
            out_pixels[row, column] = int(part * shown * maximum + 0.5)
