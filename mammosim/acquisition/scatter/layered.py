"""Scatter without photons: layers that scatter once, and a share of what scatters again.

Each layer of breast, paddle and support sends out scatter in proportion to the photons that reach
it, with the angular distribution of its material. The way down to the detector is attenuated half
as below where the photon scattered and half as along the mean way of the photons that arrive at a
place, so that scatter leaves the breast at its margin with less attenuation, and what paddle and
support scatter beside the breast reaches under its edge.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from mammosim.acquisition.attenuation import MM_PER_CM, attenuation_per_mm, compton_ratio
from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.monte_carlo.tables import CM2_PER_G, HALF_ANGLES, angular_densities
from mammosim.tissues import Material

LAYERS = 8
"""Layers into which the breast is divided."""

# Scatter of second and higher order over that of first order, in a layer of the scattering depth t
# of the whole breast above and below it: a t / (1 + b t). t is averaged with a Gaussian of
# `AROUND_MM`, since photons that scatter again come from around: near the margin fewer do. The
# three are fitted to the ten slabs of FDA's MC-GPU (docs/explanation/acquisition.md).
MULTIPLE = (0.46, 0.22)
AROUND_MM = 30.0
REACH_MM = 120.0
"""How far scatter goes: kernels end there."""

MEAN_WAY = 0.75
"""Where photons come from that arrive at a place, as part of the mean distance of all that are sent
there: those from nearer by are attenuated less. Fitted to the profiles of three upright slabs by
Monte Carlo, from 10 mm inside the edge to 10 mm outside; with 1, scatter falls too fast outside."""

PADDLE_EDGE_MM = 8.0
"""Standard deviation over which the breast's edge is spread for what the paddle scatters, mm:
photons that come from beside the breast meet its lower part only."""


@dataclass(frozen=True, eq=False)
class Layer:
    """A layer at one height that scatters.

    Parameters
    ----------
    height_mm : float
        Of its middle, above the detector's plane, mm.
    depth : ndarray of float64, [energy, row, column]
        Optical depth straight down through the layer, above each cell of the detector.
    emission : Emission
        What it is made of.
    plate : bool
        Whether the beam as it is given has crossed it.
    """

    height_mm: float
    depth: NDArray[np.float64]
    emission: Emission
    plate: bool = False


@dataclass(frozen=True)
class CellGrid:
    """Cells of the detector, and the focal spot above them.

    Parameters
    ----------
    cell_mm : float
    spot_row, spot_column : float
        Cell straight below the focal spot.
    spot_height_mm : float
        Of the focal spot above the detector's plane, mm.
    """

    cell_mm: float
    spot_row: float
    spot_column: float
    spot_height_mm: float

    def tangent(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """[row, column] tangent of the angle of the ray to each cell."""
        row, column = (np.arange(n) for n in shape)
        away = np.hypot(row[:, None] - self.spot_row, column[None, :] - self.spot_column)
        return away * self.cell_mm / self.spot_height_mm

    def where_rays_cross(self, image: NDArray[np.float64], height_mm: float) -> NDArray[np.float64]:
        """Look up [row, column] where the ray to each cell is at a height."""
        return self._scaled(image, 1.0 - height_mm / self.spot_height_mm)

    def straight_above(self, image: NDArray[np.float64], height_mm: float) -> NDArray[np.float64]:
        """Look up [row, column], given along rays, where the ray is at a height above each cell."""
        return self._scaled(image, 1.0 / (1.0 - height_mm / self.spot_height_mm))

    def _scaled(self, image: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
        offset = (1.0 - scale) * np.array([self.spot_row, self.spot_column])
        found: NDArray[np.float64] = ndimage.affine_transform(
            image, [scale, scale], offset, order=1, mode="nearest"
        )
        return found


@dataclass(frozen=True, eq=False)
class Emission:
    """Recorded energy that a collision sends into each direction.

    Parameters
    ----------
    per_sr : ndarray of float64, [energy, angle]
        Over the energy of the photon as it would be recorded unscattered, 1/sr, at angles whose
        tangents are `TANGENTS`.
    albedo : ndarray of float64, (energy,)
        Part of the collisions that scatter.
    """

    per_sr: NDArray[np.float64]
    albedo: NDArray[np.float64]


TANGENTS = np.linspace(0.0, 12.0, 769)
"""Tangents of the angles at which an `Emission` is given."""


def emission_of(
    parts: Sequence[tuple[Material, float]], energy_kev: NDArray[np.float64], detector: Detector
) -> Emission:
    """What a mixture sends out; `parts` are materials and volume fractions.

    Examples
    --------
    >>> from mammosim.acquisition.detectors import find_detector
    >>> from mammosim.tissues import composition
    >>> adipose = composition("hammerstein", "oxalate")["adipose"]
    >>> out = emission_of([(adipose, 1.0)], np.array([20.0]), find_detector("ideal"))
    >>> round(float(out.albedo[0]), 2)
    0.46
    """
    total = np.zeros(energy_kev.size)
    for material, part in parts:
        total += part * attenuation_per_mm(material, energy_kev)
    cosine = 1.0 / np.sqrt(1.0 + TANGENTS**2)
    at = np.sqrt(0.5 * (1.0 - cosine))  # sin(theta / 2)
    kept = compton_ratio(energy_kev, cosine)
    upright = detector.efficiency(energy_kev)[:, None]
    slant = detector.oblique_efficiency(energy_kev, cosine) / upright
    per_sr, scattered = np.zeros(kept.shape), np.zeros(energy_kev.size)
    for material, part in parts:
        unit = CM2_PER_G * material.density_g_cm3 / MM_PER_CM * part
        for density, energy in zip(
            angular_densities(material, energy_kev), (kept, 1.0), strict=True
        ):
            scattered += unit * np.trapezoid(density, HALF_ANGLES, axis=1)
            sharp = unit * density[:, 1:] / (8.0 * np.pi * HALF_ANGLES[1:])
            per_sr += energy * np.stack([np.interp(at, HALF_ANGLES[1:], row) for row in sharp])
    return Emission(per_sr * slant / total[:, None], scattered / total)


def layered_scatter(
    open_signal: NDArray[np.float64], layers: Sequence[Layer], grid: CellGrid
) -> NDArray[np.float64]:
    """Scatter signal of each cell, in the unit of `open_signal`.

    Parameters
    ----------
    open_signal : ndarray of float64, [energy, row, column]
        Primary behind the layers that are plates, with nothing else between; 0 where no beam goes.
    layers : sequence of Layer
        From the lowest to the highest.
    grid : CellGrid

    Returns
    -------
    ndarray of float64, [row, column]

    Notes
    -----
    A layer at height h with depth d scatters from the ray to u' towards u

        I(u') d p(theta) cos^3(theta) / h^2 exp(-t(u', u) - t (1 / cos(theta) - 1)),

    I being what reaches it, ``tan(theta) = |u - u'| / h``, p the emission, t the depth below, and
    t without a place its mean in the breast. Of what lies at the height h' < h, the part h' / h
    counts as it is straight below where the photon scatters, the rest as it is on the mean way of
    what arrives at u, at ``u + h' / h MEAN_WAY m``, m being the mean of u' - u over all that is
    sent to u. Just outside an upright side that way leads through the breast; straight above,
    there is air. What the paddle scatters arrives from all around: its way counts as straight
    above, with the breast's edge spread by `PADDLE_EDGE_MM`. Angles are counted from the ray that
    is left.
    """
    energies, rows, columns = open_signal.shape
    reach = round(REACH_MM / grid.cell_mm)
    shape = [fft.next_fast_len(n + reach, real=True) for n in (rows, columns)]
    offsets = _offsets(shape)
    radius = grid.cell_mm * np.hypot(*offsets)
    radius[radius > REACH_MM] = 1e6
    secant = np.sqrt(1.0 + grid.tangent((rows, columns)) ** 2)
    total = np.zeros((rows, columns))
    for energy in range(energies):
        upright = [layer.depth[energy] for layer in layers]
        along = [
            secant * grid.where_rays_cross(depth, layer.height_mm)
            for depth, layer in zip(upright, layers, strict=True)
        ]
        inside = _inside(along, open_signal[energy])
        turbid = sum(
            layer.emission.albedo[energy] * depth
            for layer, depth in zip(layers, along, strict=True)
        )
        around = ndimage.gaussian_filter(turbid, AROUND_MM / grid.cell_mm, mode="nearest")
        again = MULTIPLE[0] * around / (1.0 + MULTIPLE[1] * around)
        reaching = open_signal[energy].copy()
        for number in reversed(range(len(layers))):
            layer, depth = layers[number], along[number]
            half = 1.0 if layer.plate else np.exp(-0.5 * depth)
            reaching *= half
            below = layers[: number + 1]
            near, far = _near(below, upright), _far(below, upright)
            near = grid.where_rays_cross(near, layer.height_mm)
            mean = float((near + far)[inside].mean()) if inside.any() else 0.0
            source = reaching * np.exp(-near) * depth
            kernels = _kernels(layer, energy, radius, mean, grid.cell_mm)
            sent = [fft.rfft2(source, shape), fft.rfft2(source * again, shape)]
            arriving = _spread(sent, kernels, shape)[:rows, :columns]
            if layer.plate and number > 0:  # the paddle
                far = ndimage.gaussian_filter(far, PADDLE_EDGE_MM / grid.cell_mm, mode="nearest")
            else:
                far = _far(below, upright, _mean_way(sent, kernels, offsets, arriving))
            total += arriving * np.exp(-far)
            reaching *= half
    return np.maximum(total, 0.0)


def _spread(
    sent: Sequence[NDArray[np.complex128]],
    kernels: Sequence[NDArray[np.float64]],
    shape: Sequence[int],
) -> NDArray[np.float64]:
    """What arrives at each cell of the torus; `sent` are the transforms of each kernel's source."""
    pairs = zip(sent, kernels, strict=True)
    spread: NDArray[np.float64] = fft.irfft2(sum(s * fft.rfft2(k) for s, k in pairs), shape)
    return spread


def _mean_way(
    sent: Sequence[NDArray[np.complex128]],
    kernels: Sequence[NDArray[np.float64]],
    offsets: tuple[NDArray[np.float64], NDArray[np.float64]],
    arriving: NDArray[np.float64],
) -> tuple[NDArray[np.float64], ...]:
    """Rows and columns from each cell to where the photons come from that arrive there."""
    rows, columns = arriving.shape
    floor = max(1e-9 * float(arriving.max()), np.finfo(float).tiny)
    moments = (
        _spread(sent, [-away * kernel for kernel in kernels], kernels[0].shape)[:rows, :columns]
        for away in offsets
    )
    return tuple(MEAN_WAY * moment / np.maximum(arriving, floor) for moment in moments)


def _near(layers: Sequence[Layer], depths: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Depth below the middle of the last layer, as met close to it; plates count as crossed."""
    near = np.zeros(depths[0].shape)
    for weight, part, depth in _crossed(layers, depths):
        near += weight * part * depth
    return near


def _far(
    layers: Sequence[Layer],
    depths: Sequence[NDArray[np.float64]],
    way: tuple[NDArray[np.float64], ...] | None = None,
) -> NDArray[np.float64]:
    """The rest of that depth, as met close to the detector: on a way (cells), or straight above."""
    far = np.zeros(depths[0].shape)
    place = () if way is None else np.indices(far.shape, np.float64)
    for weight, part, depth in _crossed(layers, depths):
        met = depth
        if way is not None:
            moved = [start + part * along for start, along in zip(place, way, strict=True)]
            met = ndimage.map_coordinates(depth, moved, order=1, mode="nearest")
        far += weight * (1.0 - part) * met
    return far


def _crossed(
    layers: Sequence[Layer], depths: Sequence[NDArray[np.float64]]
) -> Iterator[tuple[float, float, NDArray[np.float64]]]:
    """How much of each layer is crossed, its height over that of the last one, and its depth."""
    for layer, depth in zip(layers, depths, strict=False):
        if not layer.plate:
            half = 0.5 if layer is layers[-1] else 1.0
            yield half, layer.height_mm / layers[-1].height_mm, depth


def _inside(
    depths: Sequence[NDArray[np.float64]], open_signal: NDArray[np.float64]
) -> NDArray[np.bool_]:
    whole: NDArray[np.float64] = np.sum(depths, axis=0)
    return (whole > 0.5 * whole.max()) & (open_signal > 0.0)


def _kernels(
    layer: Layer, energy: int, radius: NDArray[np.float64], mean_depth: float, cell_mm: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of first order, and of higher ones: even in all directions, with the same sum."""

    def kernels(r: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        tangent = r / layer.height_mm
        secant = np.sqrt(1.0 + tangent**2)
        even = (cell_mm / layer.height_mm) ** 2 / secant**3
        even *= np.exp(-mean_depth * (secant - 1.0)) * (r <= REACH_MM)
        return even * np.interp(tangent, TANGENTS, layer.emission.per_sr[energy]), even

    ring = np.arange(0.25, REACH_MM, 0.5)
    sums = [float((part * ring).sum()) for part in kernels(ring)]
    once, even = kernels(radius)
    return once, even * (sums[0] / sums[1])


def _offsets(shape: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows and columns from cell [0, 0] of a torus to each cell, the shorter way round."""
    axes = []
    for length in shape:
        away = np.arange(length, dtype=np.float64)
        axes.append(np.where(away > 0.5 * length, away - length, away))
    return axes[0][:, None], axes[1][None, :]
