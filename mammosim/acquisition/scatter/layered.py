"""Scatter without photons: layers that scatter once, and a share of what scatters again.

Each layer of breast, paddle and support sends out scatter in proportion to the photons that reach
it, with the angular distribution of its material. The way down to the detector is attenuated half
as above where the photon scattered and half as above where it arrives, so that scatter leaves the
breast at its margin with less attenuation, and what paddle and support scatter beside the breast
reaches under its edge.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    counts as it is straight below where the photon scatters, the rest as it is above where the
    photon arrives: a straight way goes evenly from one to the other. Angles are counted from the
    ray that is left.
    """
    energies, rows, columns = open_signal.shape
    reach = round(REACH_MM / grid.cell_mm)
    shape = [fft.next_fast_len(n + reach, real=True) for n in (rows, columns)]
    radius = _radii_mm(grid.cell_mm, reach, shape)
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
            near, far = _split(below, upright)
            if layer.plate and number > 0:  # the paddle
                far = ndimage.gaussian_filter(far, PADDLE_EDGE_MM / grid.cell_mm, mode="nearest")
            near = grid.where_rays_cross(near, layer.height_mm)
            mean = float((near + far)[inside].mean()) if inside.any() else 0.0
            source = reaching * np.exp(-near) * depth
            kernels = _kernels(layer, energy, radius, mean, grid.cell_mm)
            spectrum = fft.rfft2(source, shape) * fft.rfft2(kernels[0])
            spectrum += fft.rfft2(source * again, shape) * fft.rfft2(kernels[1])
            total += fft.irfft2(spectrum, shape)[:rows, :columns] * np.exp(-far)
            reaching *= half
    return np.maximum(total, 0.0)


def _split(
    layers: Sequence[Layer], depths: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth below the middle of the last layer, as met close to it and close to the detector.

    Plates below count as crossed.
    """
    top = layers[-1].height_mm
    near, far = np.zeros(depths[0].shape), np.zeros(depths[0].shape)
    for layer, depth in zip(layers, depths, strict=False):
        if layer.plate:
            continue
        part = layer.height_mm / top
        half = 0.5 if layer is layers[-1] else 1.0
        near += half * part * depth
        far += half * (1.0 - part) * depth
    return near, far


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


def _radii_mm(cell_mm: float, reach: int, shape: list[int]) -> NDArray[np.float64]:
    """Distance of each cell from cell [0, 0] of a torus; a million cells beyond the reach."""
    axes = []
    for length in shape:
        away = np.arange(length, dtype=np.float64)
        away = np.minimum(away, length - away)
        away[away > reach] = 1e6
        axes.append(away * cell_mm)
    return np.hypot(axes[0][:, None], axes[1][None, :])
