"""Compiled loops over the pixels of an image. Every turn of a parallel loop writes its own row."""

from __future__ import annotations

from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mammosim._jit import Thread, kernel, parallel_kernel, share

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Rays(NamedTuple):
    """Tangents of each pixel's ray to the central one.

    Parameters
    ----------
    row_tangent, column_tangent : ndarray of float64, (rows,), (columns,)
        Distance from the central ray along each axis over the source to detector distance.
    """

    row_tangent: NDArray[np.float64]
    column_tangent: NDArray[np.float64]


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
    for row in share(thread, 0, rows):
        met = np.empty(tissues, np.int64)
        for column in range(columns):
            number = 0
            for tissue in range(tissues):
                if length_mm[tissue, row, column] > 0.0:
                    met[number] = tissue
                    number += 1
            source = min(column, sources - 1)
            secant = _secant(rays, row, column)
            excess = secant - 1.0
            if number == 0:
                passed = exp(-weights.mean_depth * excess)
                signal = air_signal[source] * passed
                square = air_square[source] * passed
            else:
                signal = 0.0
                square = 0.0
                for e in range(energies):
                    depth = weights.flat_depth[e] * excess
                    for k in range(number):
                        depth += mu_per_mm[e, met[k]] * length_mm[met[k], row, column]
                    transmitted = exp(-depth)
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
            flat = signal[row, column] * secant**3 * exp(mean_depth * (secant - 1.0))
            out_attenuation[row, column] = log(air / max(flat, 1e-6 * air))


@parallel_kernel
def present_kernel(
    thread: Thread,
    attenuation: F32,
    added: F64,
    cell: float,
    low: float,
    high: float,
    bends: tuple[float, float],
    maximum: float,
    out_pixels: NDArray[np.uint16],
) -> None:
    """Add the coarse correction, interpolated linearly, and show the sum as grey.

    ``v = (level - low) / (high - low)`` is straight between the two `bends`, toe and shoulder;
    above the shoulder s the curve nears white as ``1 - (1 - s) exp(-(v - s) / (1 - s))``, below
    the toe t it nears black as ``t exp((v - t) / t)``, both with the same slope there.
    """
    toe, shoulder = bends
    rows, columns = attenuation.shape
    for row in share(thread, 0, rows):
        for column in range(columns):
            extra = _interpolated(added, (row + 0.5) / cell - 0.5, (column + 0.5) / cell - 0.5)
            level = attenuation[row, column] + extra
            shown = (level - low) / (high - low)
            if shown < toe:
                shown = toe * exp((shown - toe) / toe)
            if shown > shoulder:
                shown = 1.0 - (1.0 - shoulder) * exp((shoulder - shown) / (1.0 - shoulder))
            out_pixels[row, column] = int(shown * maximum + 0.5)
