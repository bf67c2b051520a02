"""Layers of a scene of coarse voxels, for the shape that its scatter has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.acquisition.attenuation import attenuation_per_mm
from mammosim.acquisition.monte_carlo import PhotonTables, Scene, density_of, mixture_of
from mammosim.acquisition.scatter.layered import LAYERS, Layer, emission_of, layered_scatter
from mammosim.acquisition.scatter.open_beam import (
    OpenBeam,
    cell_grid,
    open_beam,
    plates_around,
)
from mammosim.acquisition.scatter.scatter_case import ScatterCase

SUBSAMPLES = 2
"""Columns of voxels that are looked at along each side of a cell."""


def shape_of_scatter(
    case: ScatterCase,
    scene: Scene,
    tables: PhotonTables,
    spectrum: NDArray[np.float64],
    margin: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """About what scatter to expect in each cell, and which cells lie below the breast.

    Parameters
    ----------
    case : ScatterCase
        Its primary and thickness are not looked at.
    scene : Scene
    tables : PhotonTables
    spectrum : ndarray of float64, [column or 1, energy]
    margin : int
        Cells on each side of the detector.

    Returns
    -------
    shape : ndarray of float64, [row, column]
        Positive everywhere.
    below : ndarray of bool, [row, column]
        Cells with more than half of the breast's greatest depth straight above them.
    """
    mass = scene.mass_g.sum(axis=0)
    density = np.array([material.density_g_cm3 for material in scene.materials])
    volume = mass / density
    volume[-1] = 0.0  # air
    rows, columns = (size + 2 * margin for size in case.primary.shape)
    if volume.sum() <= 0.0:
        return np.ones((rows, columns)), np.zeros((rows, columns), np.bool_)
    share = volume / volume.sum()
    z, inner = scene.space.z, scene.inner[2]
    depth = tables.total @ share * float(z[inner.stop] - z[inner.start])
    beam = open_beam(case, tables, spectrum, depth, margin)
    layers = _layers(case, scene, share, beam, margin)
    shape = layered_scatter(beam.signal, layers, cell_grid(case, margin))
    above = sum(layer.depth[0] for layer in layers if not layer.plate)
    return shape + 1e-3 * shape.max(), above > 0.5 * above.max()


def _layers(
    case: ScatterCase,
    scene: Scene,
    share: NDArray[np.float64],
    beam: OpenBeam,
    margin: int,
) -> list[Layer]:
    """Support, breast and paddle, from the lowest to the highest."""
    z, inner = scene.space.z, scene.inner[2]
    parts = [(material, float(part)) for material, part in zip(scene.materials, share, strict=True)]
    tissue = emission_of([part for part in parts if part[1] > 0.0], beam.energy_kev, case.detector)
    mu = np.stack([attenuation_per_mm(m, beam.energy_kev) for m in scene.materials], axis=1)
    mu[:, -1] = 0.0  # air
    mixed = mu @ scene.fraction.T
    face = case.gantry.support_to_detector_mm
    count = min(LAYERS, inner.stop - inner.start)
    breast = [
        Layer(
            float(0.5 * (z[part[0]] + z[part[-1] + 1])) + face,
            _depth(case, scene, mixed, part, margin), tissue,
        )
        for part in np.array_split(np.arange(inner.start, inner.stop), count)
    ]  # fmt: skip
    return plates_around(case, beam, breast, float(z[inner.stop] - z[inner.start]))


def _depth(
    case: ScatterCase,
    scene: Scene,
    mixed: NDArray[np.float64],
    levels: NDArray[np.intp],
    margin: int,
) -> NDArray[np.float64]:
    """[energy, row, column] optical depth of levels of voxels straight above each cell."""
    x, y, z, words = scene.space
    cells = words.reshape(x.size - 1, y.size - 1, z.size - 1)
    shape = tuple(size + 2 * margin for size in case.primary.shape)
    depth = np.zeros((len(mixed), *shape))
    for place in np.ndindex(SUBSAMPLES, SUBSAMPLES):
        row, column = (
            (np.arange(size) - margin + (at + 0.5) / SUBSAMPLES) * case.cell - 0.5
            for size, at in zip(shape, place, strict=True)
        )
        v = case.gantry.detector_xy_mm(row, np.zeros(row.size))[:, 1]
        u = case.gantry.detector_xy_mm(np.zeros(column.size), column)[:, 0]
        i = np.clip(np.searchsorted(x, u) - 1, 0, x.size - 2)
        j = np.clip(np.searchsorted(y, v) - 1, 0, y.size - 2)
        for level in levels:
            word = cells[i[None, :], j[:, None], level]
            dense = density_of(word) * (z[level + 1] - z[level])
            depth += mixed[:, mixture_of(word)] * (dense / SUBSAMPLES**2)
    return depth
