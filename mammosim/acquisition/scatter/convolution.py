"""The scatter model `kernels`: layers built from path lengths alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import BEAM_MATERIALS, attenuation_per_mm
from mammosim.acquisition.monte_carlo import photon_tables
from mammosim.acquisition.scatter.layered import (
    LAYERS,
    CellGrid,
    Layer,
    emission_of,
    layered_scatter,
)
from mammosim.acquisition.scatter.open_beam import (
    OpenBeam,
    cell_grid,
    open_beam,
    plates_around,
    spectrum_of,
)
from mammosim.acquisition.scatter.scatter_case import Scatter, ScatterCase

TYPICAL_PERCENTILE = 90.0
"""Paths longer than those of so many per cent of the breast's cells reach from plate to plate."""

MARGIN_ITERATIONS = 25
"""Steps towards the columns of tissue at the margin; twice as many change scatter there by at most
0.6 %."""

LOCAL_RANGE = (0.3, 3.0)
"""Least and greatest attenuation per mm of a place over that of the mean tissue."""


def scatter_by_kernels(case: ScatterCase) -> Scatter:
    """Scatter from path lengths: needs no voxels.

    Parameters
    ----------
    case : ScatterCase

    Notes
    -----
    The breast is taken to lie halfway between the plates wherever it is thinner than their gap, and
    to be a mixture of gland and fat that is the same in all layers: in the breast as a whole that
    which leaves as much primary as there is, at each place thinned or thickened so that its own
    primary comes out. See `layered_scatter` for the rest.
    """
    shape = (case.primary.shape[0], case.primary.shape[1])
    grid = cell_grid(case, 0)
    upright = case.thickness_mm / np.sqrt(1.0 + grid.tangent(shape) ** 2)
    tissue = [case.materials[name] for name in ("adipose", "gland")]
    lowest, highest = float(case.beam.energy_kev[0]), float(case.beam.energy_kev[-1])
    tables = photon_tables([*tissue, BEAM_MATERIALS["air"]], lowest, highest)
    there = upright > 0.0
    gap_mm = float(np.percentile(upright[there], TYPICAL_PERCENTILE)) if there.any() else 0.0
    typical = 0.5 * gap_mm * (tables.total[:, 0] + tables.total[:, 1])
    beam = open_beam(case, tables, spectrum_of(case, tables), typical, 0)
    mu = np.stack([attenuation_per_mm(material, beam.energy_kev) for material in tissue], axis=1)
    primary = case.primary / case.gantry.pixel_mm**2
    gland = _gland_share(primary, case.thickness_mm, beam, mu)
    mixed = mu @ np.array([1.0 - gland, gland])
    local = _relative_attenuation(primary, case.thickness_mm, beam, mixed)
    parts = [(tissue[0], 1.0 - gland), (tissue[1], gland)]
    emission = emission_of(parts, beam.energy_kev, case.detector)
    gap_to_detector = case.gantry.support_to_detector_mm
    thickness = _columns_mm(upright, grid, gap_mm, gap_to_detector)
    middle = gap_to_detector + 0.5 * gap_mm
    whole, dense = (grid.straight_above(part, middle) for part in (upright, upright * local))
    dense = thickness * np.divide(dense, whole, out=np.ones_like(whole), where=whole > 0.0)
    layers = [
        Layer(
            gap_to_detector + 0.5 * (low + high),
            mixed[:, None, None] * _tissue_between(low, high, thickness, dense, gap_mm), emission,
        )
        for low, high in _layers_of(gap_mm)
    ]  # fmt: skip
    signal = layered_scatter(beam.signal, plates_around(case, beam, layers, gap_mm), grid)
    return Scatter(signal * case.gantry.pixel_mm**2)


def _layers_of(gap_mm: float) -> list[tuple[float, float]]:
    """Lower and upper face of each layer of the breast above the support, mm."""
    return list(pairwise(np.linspace(0.0, gap_mm, LAYERS + 1))) if gap_mm > 0.0 else []


def _columns_mm(
    upright_mm: NDArray[np.float64], grid: CellGrid, gap_mm: float, face_mm: float
) -> NDArray[np.float64]:
    """Tissue straight above each cell, mm, that has these paths along the rays, times the cosine.

    Rays cross the margin obliquely: its shape, steep or round, shows only in how fast their paths
    shorten. The iteration starts from the paths at half the gap's height; what is too long or too
    short along each ray is shared among the columns that it crosses (Landweber's iteration, with
    the momentum of Beck and Teboulle 2009, SIAM J Imaging Sci 2:183).
    """
    layers = [(low, high, face_mm + 0.5 * (low + high)) for low, high in _layers_of(gap_mm)]
    columns = grid.straight_above(upright_mm, face_mm + 0.5 * gap_mm)
    if not layers:
        return columns
    ahead, momentum = columns, 1.0
    for _ in range(MARGIN_ITERATIONS):
        left = upright_mm - sum(
            grid.where_rays_cross(_tissue_between(low, high, ahead, ahead, gap_mm), height)
            for low, high, height in layers
        )
        shared = sum(grid.straight_above(left, height) for _, _, height in layers)
        before, columns = columns, np.clip(ahead + shared / len(layers), 0.0, gap_mm)
        faster = 0.5 + np.sqrt(0.25 + momentum**2)
        ahead = columns + (momentum - 1.0) / faster * (columns - before)
        momentum = faster
    return columns


def _tissue_between(
    low_mm: float,
    high_mm: float,
    thickness_mm: NDArray[np.float64],
    dense_mm: NDArray[np.float64],
    gap_mm: float,
) -> NDArray[np.float64]:
    """Tissue of a thickness centred in the gap that lies between two heights, as `dense_mm`."""
    bottom = np.maximum(0.5 * (gap_mm - thickness_mm), 0.0)
    top = np.minimum(bottom + thickness_mm, gap_mm)
    inside = np.clip(np.minimum(top, high_mm) - np.maximum(bottom, low_mm), 0.0, None)
    whole = np.maximum(top - bottom, 1e-9)
    return inside / whole * dense_mm


def _gland_share(
    primary: NDArray[np.float64],
    thickness_mm: NDArray[np.float64],
    beam: OpenBeam,
    mu: NDArray[np.float64],
) -> float:
    """Volume of gland in the mixture behind which the breast has its primary, 0 to 1."""
    inside = thickness_mm > 0.5 * thickness_mm.max()
    if not inside.any():
        return 0.0
    wanted, low, high = primary[inside].sum(), 0.0, 1.0
    for _ in range(12):
        share = 0.5 * (low + high)
        depth = (mu @ np.array([1.0 - share, share]))[:, None] * thickness_mm[inside]
        if (beam.signal[:, inside] * np.exp(-depth)).sum() > wanted:
            low = share
        else:
            high = share
    return 0.5 * (low + high)


def _relative_attenuation(
    primary: NDArray[np.float64],
    thickness_mm: NDArray[np.float64],
    beam: OpenBeam,
    mixed: NDArray[np.float64],
) -> NDArray[np.float64]:
    """[row, column] attenuation per mm over that of the mixture, within `LOCAL_RANGE`."""
    free = beam.signal.sum(axis=0)
    expected = (beam.signal * np.exp(-mixed[:, None, None] * thickness_mm)).sum(axis=0)
    there = (thickness_mm > 1.0) & (primary > 0.0) & (primary < free)
    ratio = np.ones(primary.shape)
    ratio[there] = np.log(free[there] / primary[there]) / np.log(free[there] / expected[there])
    return np.clip(ratio, *LOCAL_RANGE)
