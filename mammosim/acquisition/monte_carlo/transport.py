"""Scatter and dose of one exposure by Monte Carlo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mammosim.acquisition.detectors import Detector
from mammosim.acquisition.monte_carlo._collision_kernels import Sections
from mammosim.acquisition.monte_carlo._detection_kernels import Screen, Turn
from mammosim.acquisition.monte_carlo._flight_kernels import DENSITY_STEPS, Plan
from mammosim.acquisition.monte_carlo._random_kernels import Stream
from mammosim.acquisition.monte_carlo._transport_kernels import Source, follow_photons
from mammosim.acquisition.monte_carlo.grid import COSINES, LARGEST_TANGENT, TANGENTS, Grid
from mammosim.acquisition.monte_carlo.scene import Scene, mixture_of
from mammosim.acquisition.monte_carlo.tables import PhotonTables
from mammosim.geometry import Gantry

BATCHES = 16
"""Parts of the photons that are followed independently: threads share them, results are added in
their order, and their spread is the noise."""

COLLISIONS = 4.0
"""Places along a first flight through the breast, on average, at which it is made to collide."""

MAX_COLLISIONS = 16
"""The most for one flight, where its weight is large."""

MARGIN_MM = 12.0
"""How far beyond the detector scatter is scored, mm, so that smoothing needs no edge."""

_RESPONSE_COSINES = 64
"""Angles at which the detector's response is tabulated; between them it is interpolated."""
_MIN_DEPTH = 1e-3  # optical depth that decides how often a flight collides where no tissue is
_BREAST_ENERGY_SHARE = 0.6  # photons drawn as they come through the breast; others as they come in


@dataclass(frozen=True, eq=False)
class Field:
    """Cells of the beam on the detector's plane, in the image's order.

    Parameters
    ----------
    row_y_mm, column_x_mm : ndarray of float64, (rows + 1,), (columns + 1,)
        y and x of the cells' edges in the detector frame, mm.
    importance : ndarray of float64, [row, column]
        Photons drawn per mm2, in any unit.
    """

    row_y_mm: NDArray[np.float64]
    column_x_mm: NDArray[np.float64]
    importance: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tallies:
    """What came of the photons, for a fluence of one unit exposure.

    Parameters
    ----------
    scatter : ndarray of float64, [batch, row, column]
        Recorded energy of scattered photons in front of the grid, keV/mm2, with a margin of
        `margin` cells on each side.
    behind_grid : ndarray of float64, [batch, row, column]
        The same behind the grid; zero without one.
    margin : int
    collisions : ndarray of float64, [batch, energy, mixture]
        Number of collisions.
    ledger : ndarray of float64, [batch, 4]
        Energy emitted, detected after scattering, escaped, and deposited (in analog mode), keV.
    energy_map : ndarray of float32, [batch, cell] or None
        Energy deposited in each cell of the scene, keV.
    photons : int
        Photons that were followed.
    """

    scatter: NDArray[np.float64]
    behind_grid: NDArray[np.float64]
    margin: int
    collisions: NDArray[np.float64]
    ledger: NDArray[np.float64]
    energy_map: NDArray[np.float32] | None
    photons: int


def image_field(gantry: Gantry, cell: int, importance: NDArray[np.float64] | None = None) -> Field:
    """The whole detector in cells of several pixels, on which photons are counted.

    Parameters
    ----------
    gantry : Gantry
    cell : int
        Pixels along a side of a cell; the last one of a row or column is cut off at the edge.
    importance : ndarray, [row, column], optional
        How much each cell's signal matters, for the choice of photons to follow; default: alike.

    Returns
    -------
    Field
        Edges of the cells in the detector frame, mm: rows along y, columns along x.
    """
    rows = np.minimum(np.arange(0, gantry.rows + cell, cell), gantry.rows)
    columns = np.minimum(np.arange(0, gantry.columns + cell, cell), gantry.columns)
    y = gantry.detector_xy_mm(rows - 0.5, np.zeros(rows.size))[:, 1]
    x = gantry.detector_xy_mm(np.zeros(columns.size), columns - 0.5)[:, 0]
    if importance is None:
        importance = np.ones((rows.size - 1, columns.size - 1))
    return Field(y, x, importance)


def shadow_of(scene: Scene, gantry: Gantry, field: Field) -> NDArray[np.bool_]:
    """Cells of a field whose central ray meets tissue.

    Parameters
    ----------
    scene : Scene
        Breast, paddle and support on their grid, gantry frame.
    gantry : Gantry
    field : Field
        Cells on the detector.

    Returns
    -------
    ndarray of bool, [row, column]

    Notes
    -----
    The ray from the focal spot to a cell's centre is looked at in every fourth layer of the grid
    only, so that tissue thinner than four voxels across the ray may be missed at the margin.
    """
    x, y, z, words = scene.space
    shape = (x.size - 1, y.size - 1, z.size - 1)
    mixtures = mixture_of(words).reshape(shape)
    spot, plane = gantry.focal_spot_mm, -gantry.support_to_detector_mm
    v = 0.5 * (field.row_y_mm[1:] + field.row_y_mm[:-1])
    u = 0.5 * (field.column_x_mm[1:] + field.column_x_mm[:-1])
    rows = np.stack([np.zeros(v.size), v, np.full(v.size, plane)], axis=-1)
    _, row_y, row_z = gantry.gantry_from_detector(rows).T
    found = np.zeros((v.size, u.size), np.bool_)
    levels = scene.inner[2]
    for k in range(levels.start, levels.stop, 4):
        near = (spot[2] - 0.5 * (z[k] + z[k + 1])) / (spot[2] - row_z)
        i = np.searchsorted(x, spot[0] + (u - spot[0]) * near[:, None]) - 1
        j = np.searchsorted(y, spot[1] + (row_y - spot[1]) * near) - 1
        i, j = np.clip(i, 0, shape[0] - 1), np.clip(j, 0, shape[1] - 1)
        found |= scene.tissue[mixtures[i, j[:, None], k]]
    return found


def importance_of(shadow: NDArray[np.bool_], cell_mm: float, plates: bool) -> NDArray[np.float64]:
    """Density in which photons are drawn over the detector.

    Parameters
    ----------
    shadow : ndarray of bool, [row, column]
        Cells whose central ray meets tissue.
    cell_mm : float
        Side of a cell, mm.
    plates : bool
        Whether there are paddle and support, whose scatter reaches the detector beside the breast.

    Returns
    -------
    ndarray, [row, column]
        Photons per area relative to the shadow's: fewer, with larger weights, the farther a cell is
        from it.

    Notes
    -----
    Beside the breast a photon meets only paddle and support, but its scatter is not attenuated by
    the breast, so that it counts as much near the shadow as those inside. The density falls by a
    factor of e over 25 mm; it changes the noise only, not the mean.

    Examples
    --------
    >>> importance_of(np.array([[True, False]]), 25.0, True).round(2).tolist()
    [[1.0, 0.67]]
    """
    if not shadow.any():
        return np.ones(shadow.shape)
    away = ndimage.distance_transform_edt(~shadow) * cell_mm
    near, far = (1.0, 0.3) if plates else (0.5, 0.2)
    return np.where(shadow, 1.0, near * np.exp(-away / 25.0) + far)


def follow(
    scene: Scene,
    tables: PhotonTables,
    gantry: Gantry,
    field: Field,
    spectrum: NDArray[np.float64],
    detector: Detector,
    *,
    cell_mm: float,
    photons: int,
    seed: int,
    grid: Grid | None = None,
    analog: bool = False,
    mapped: bool = False,
    batches: int = BATCHES,
    collisions: float = COLLISIONS,
) -> Tallies:
    """Follow photons from the focal spot through the scene.

    Parameters
    ----------
    scene : Scene
    tables : PhotonTables
        For the scene's materials.
    gantry : Gantry
    field : Field
    spectrum : ndarray of float64, [field column or 1, energy]
        Photons per mm2 on the detector's plane, on the ray at right angles to it, of a beam that
        has crossed all the air but neither paddle nor support, for each energy of `tables`.
    detector : Detector
    cell_mm : float
        Edge of the cells in which scatter is scored, mm; the first begins at row 0, column 0.
    photons : int
        Photons to follow, rounded up to whole batches.
    seed : int
    grid : Grid, optional
    analog : bool
        Whether every event is drawn and no weight changed.
    mapped : bool
        Whether energy is scored in each cell of the scene.
    batches, collisions : int

    Returns
    -------
    Tallies
    """
    each = -(-photons // batches)
    margin = int(np.ceil(MARGIN_MM / cell_mm))
    rows = int(np.ceil(gantry.rows * gantry.pixel_mm / cell_mm - 1e-6)) + 2 * margin
    columns = int(np.ceil(gantry.columns * gantry.pixel_mm / cell_mm - 1e-6)) + 2 * margin
    scatter = np.zeros((batches, 2, rows, columns))
    sections = _sections(scene, tables, mapped)
    shape = (batches, tables.energy_kev.size, scene.fraction.shape[0])
    collided, ledger = np.zeros(shape), np.zeros((batches, 4))
    energy_map = np.zeros(
        (batches if mapped else 1, scene.space.words.size if mapped else 1), np.float32
    )
    source, score = _source(gantry, field, spectrum, tables, scene)
    plan = Plan(each, _key(seed), score / collisions, MAX_COLLISIONS, analog, mapped, 0)
    screen = _screen(gantry, tables, detector, grid, cell_mm, margin)
    follow_photons(
        plan, source, scene.space, sections, screen, scatter, collided, ledger, energy_map
    )
    scale = 1.0 / each
    scatter *= scale / cell_mm**2
    collided *= scale
    ledger *= scale
    energy_map *= np.float32(scale)
    return Tallies(
        scatter[:, 0], scatter[:, 1], margin, collided, ledger, energy_map if mapped else None,
        each * batches,
    )  # fmt: skip


def _key(seed: int) -> Stream:
    """The streams' key from a seed of any size."""
    low, high = np.random.SeedSequence(seed).generate_state(2, np.uint32)
    return Stream(np.uint64(low), np.uint64(high), np.uint64(0), np.uint64(0))


def _sections(scene: Scene, tables: PhotonTables, mapped: bool) -> Sections:
    total = tables.total @ scene.fraction.T
    deposit = np.zeros((tables.energy_kev.size, 1))
    if mapped:
        absorbed = tables.absorbed @ scene.fraction.T
        deposit = np.divide(absorbed, total, out=np.zeros_like(total), where=total > 0.0)
        deposit *= tables.energy_kev[:, None]
    return Sections(
        tables.energy_kev, *(
            np.ascontiguousarray(part, dtype=np.float32)
            for part in (
                total / DENSITY_STEPS, deposit, scene.fraction, tables.incoherent, tables.coherent,
                tables.incoherent_cosine, tables.coherent_cosine,
            )
        ),
    )  # fmt: skip


def _source(
    gantry: Gantry,
    field: Field,
    spectrum: NDArray[np.float64],
    tables: PhotonTables,
    scene: Scene,
) -> tuple[Source, float]:
    """Cumulated probabilities of cells and energies, and the weights that make up for them.

    Also the energy that first collisions of a photon through the breast score on average, keV.
    """
    area = np.abs(np.diff(field.row_y_mm))[:, None] * np.abs(np.diff(field.column_x_mm))[None, :]
    drawn = area * field.importance
    by_row = drawn.sum(axis=1)
    probability = drawn / drawn.sum()
    # what the scene's own air will take away
    air = tables.total[:, -1] * (scene.space.z[-1] - scene.space.z[0])
    spectrum = spectrum * np.exp(air)
    middle = spectrum[spectrum.shape[0] // 2]
    energy_fluence = middle * tables.energy_kev
    depth = _breast_depth(scene, tables)
    through = energy_fluence * np.exp(-depth)
    share = _BREAST_ENERGY_SHARE
    chosen = (1.0 - share) * energy_fluence / energy_fluence.sum() + share * through / through.sum()
    weight = np.divide(spectrum, chosen, out=np.zeros_like(spectrum), where=chosen > 0.0)
    likely = np.maximum(through * depth, _MIN_DEPTH * energy_fluence)
    score = float(likely.sum() * drawn.sum() / field.importance.max())
    source = Source(
        gantry.focal_spot_mm, gantry.focal_spot_above_detector_mm, Turn(*gantry.detector_turn),
        -gantry.support_to_detector_mm, field.row_y_mm, field.column_x_mm, _cumulated(by_row),
        _cumulated(drawn), area / probability, _cumulated(chosen), np.ascontiguousarray(weight),
    )  # fmt: skip
    return source, score


def _breast_depth(scene: Scene, tables: PhotonTables) -> NDArray[np.float64]:
    """[energy] optical depth of the scene's mean tissue over the whole gap."""
    density = np.array([material.density_g_cm3 for material in tables.materials])
    volume = scene.mass_g.sum(axis=0) / density
    volume[-1] = 0.0  # air
    if volume.sum() <= 0.0:
        return np.zeros(tables.energy_kev.size)
    z, levels = scene.space.z, scene.inner[2]
    depth: NDArray[np.float64] = tables.total @ (volume / volume.sum())
    return depth * (z[levels.stop] - z[levels.start])


def _cumulated(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cumulated sums over the last axis, scaled to end at 1."""
    sums = np.cumsum(weights, axis=-1)
    sums /= sums[..., -1:]
    sums[..., -1] = 1.0
    return np.ascontiguousarray(sums)


def _screen(
    gantry: Gantry,
    tables: PhotonTables,
    detector: Detector,
    grid: Grid | None,
    cell_mm: float,
    margin: int,
) -> Screen:
    """Cells of the detector, and the response of detector and grid to a photon by its direction."""
    per_cell = gantry.pixel_mm / cell_mm
    (row_at, column_at), (row_on, column_on) = (
        (gantry.pixel_of(at, at) + 0.5) * per_cell + margin for at in (0.0, 1.0)
    )
    cosine = (np.arange(_RESPONSE_COSINES) + 0.5) / _RESPONSE_COSINES
    response = detector.oblique_efficiency(tables.energy_kev, cosine).astype(np.float32)
    transmission = np.ones((1, 1, 1), np.float32)
    if grid is not None:
        cosine = (np.arange(COSINES) + 0.5) / COSINES
        tangent = (np.arange(TANGENTS) + 0.5) / (TANGENTS - 1) * LARGEST_TANGENT
        transmission = grid.transmission(tables.energy_kev, cosine, tangent).astype(np.float32)
        transmission[:, :, -1] = 0.0
    return Screen(
        -gantry.support_to_detector_mm, row_at, row_on - row_at, column_at, column_on - column_at,
        response, transmission, LARGEST_TANGENT, bool(grid.along_x) if grid else True,
        gantry.focal_spot_above_detector_mm, Turn(*gantry.detector_turn),
    )  # fmt: skip


def on_energies(
    energy_kev: NDArray[np.float64], fluence: NDArray[np.float64], tables: PhotonTables
) -> NDArray[np.float64]:
    """Share photons between the two nearest energies of the tables; number and energy are kept.

    Parameters
    ----------
    energy_kev : ndarray of float64, (n,)
    fluence : ndarray of float64, [..., n]
    tables : PhotonTables
    """
    grid = tables.energy_kev
    place = (energy_kev - grid[0]) / (grid[1] - grid[0])
    low = np.clip(np.floor(place).astype(np.intp), 0, grid.size - 2)
    part = place - low
    shared = np.zeros((*fluence.shape[:-1], grid.size))
    for at in range(energy_kev.size):
        shared[..., low[at]] += fluence[..., at] * (1.0 - part[at])
        shared[..., low[at] + 1] += fluence[..., at] * part[at]
    return shared


def mean_and_error(batches: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean over the first axis and its standard error."""
    mean = batches.mean(axis=0)
    return mean, batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
