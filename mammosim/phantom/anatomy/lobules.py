"""Fat lobules and the fibrous walls between them: nets of unequal cells in bent coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._net_kernels import ABSENT, Net
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import Outline, mesh

LOBULE_MM = 7.8
"""Side of the lattice cells of fat lobules `REFERENCE_MM` from the nipple, mm. With a tenth of
the cells missing a compartment has a mean volume of 0.7 cm3 there; measured in histology are
0.94 cm3 under the skin, 0.89 cm3 behind the gland and 0.31 cm3 within it (Bakic et al. 2002,
Med Phys 29:2131-2139, and later work of that group)."""

FINE_MM = 4.0
"""The same of the thinner septa within lobules, mm. Chosen by eye."""

REFERENCE_MM, SHRINK = 55.0, 0.26
"""Lobules grow with the power `SHRINK` of the distance from the nipple, so that those 25 mm behind
it have a third of the volume of those near the skin and the chest wall; their length along the
distance is 1 / (1 - SHRINK) = 1.6 of their width."""

PRESSED_DEG, PRESSED_LENGTH = 22.0, 1.6
"""Direction in which plates press, between that of CC, from above, and of MLO, 45 degrees medially
from it; and the length of lobules along it against their width. Pressed to about half their height,
lobules are round, as images show them. Chosen by eye on projections."""

APEX_MM, ROUNDING_MM = 10.0, 18.0
"""Where the lobules' coordinates converge, in front of the nipple's foot, and distance below which
they no longer do, mm."""

WARPS_MM = ((1.0, 36.0), (0.85, 15.0))
"""Amplitude and wavelength by which walls are bent, mm: their slopes, 2 pi amplitude / wavelength,
add up to 0.5, below which coordinates hardly ever fold over. Chosen by eye."""

ABSENT_SHARE, WEIGHT = 0.12, 0.34
"""Share of the lattice cells without a lobule, and spread of the weights, cells squared: both make
lobules unequal. Chosen by eye."""

COLUMN_UNEVEN, CELL_UNEVEN = 4.5, 0.5
"""Spread by which columns of cells and single cells differ in what decides whether they are gland,
in units of the potential. Chosen by eye."""

COLUMN_CELLS, COLUMN_WIDTH = 3.0, 0.3
"""Lengths over which cells of a column are alike, along the direction in which plates press and
across, in cells: fat lobules interrupt the plate of gland through most of its thickness, so that a
mammogram shows them dark. Chosen by eye."""

FATNESS = (0.8, 1.5)
"""How strongly fat lobules push gland aside. Chosen by eye."""

GLANDULAR = -0.45
"""The same of lobes of gland, which are gland whatever the potential is within some limits: their
borders are sharp. Chosen by eye."""

YIELDS, YIELDS_MM = 0.6, 25.0
"""Fat lobules right behind the nipple push gland aside by no more than this part, and fully from
this distance in the net's coordinates, mm: fibrous tissue keeps to the ducts there. Chosen by
eye."""

STEEP_CELLS, FLAT = 1.5, 0.2
"""Below the potential that as much more volume exceeds than gland fills, the potential falls as it
is; above, it is flattened to the second, so that borders of gland are those of lobules."""

GROUP_CELLS, MOST_GROUPS = 2.3, 2048
"""Distance between groups of cells, in cells: a group's border is a ligament, within it walls are
thin. Chosen by eye. Numbers above the second are used again: single precision holds them with the
fraction that walls differ by."""


def draw_net(
    coordinates_mm: list[NDArray[np.float64]],
    cell_mm: float,
    rng: np.random.Generator,
    grouped: bool = True,
) -> Net:
    """Points of a net that covers coordinates.

    Parameters
    ----------
    coordinates_mm : list of three ndarray
        Coordinates of the net all over the coarse grid, mm.
    cell_mm : float
        Side of its lattice cells, mm.
    rng : Generator
    grouped : bool
        Whether cells come in groups, between which walls are thick.
    """
    low = np.array([part.min() for part in coordinates_mm]) - 2.0 * cell_mm
    high = np.array([part.max() for part in coordinates_mm]) + 2.0 * cell_mm
    cells = np.ceil((high - low) / cell_mm).astype(int)
    seeds = np.empty((*cells, 6), np.float32)
    seeds[..., :3] = rng.uniform(0.05, 0.95, (*cells, 3))
    seeds[..., 3] = WEIGHT * rng.random(tuple(cells))
    seeds[..., 3][rng.random(tuple(cells)) < ABSENT_SHARE] = 2.0 * ABSENT
    seeds[..., 4] = rng.uniform(*FATNESS, tuple(cells))
    seeds[..., 5] = rng.random(tuple(cells))
    seeds[..., 5] += _groups(seeds[..., :3], rng) if grouped else -1.0
    return Net(seeds, low, cell_mm)


def _groups(places: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers of the groups of cells: each belongs to the nearest of some random points."""
    cells = np.array(places.shape[:3])
    at = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1) + places
    middle = rng.uniform(0.0, 1.0, (int(cells.prod() / GROUP_CELLS**3) + 1, 3)) * cells
    number: NDArray[np.int64] = cKDTree(middle).query(at)[1]
    return number % MOST_GROUPS


def settle_gland(
    net: Net,
    coordinates_mm: list[NDArray[np.float64]],
    potential: NDArray[np.float64],
    breast: NDArray[np.bool_],
    share: float,
    cells: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Choose the cells that are lobes of gland, and flatten the potential within gland.

    Parameters
    ----------
    net : Net
        Fatness of the chosen cells becomes `GLANDULAR`.
    coordinates_mm : list of three ndarray
        Coordinates of the net on the coarse grid, mm.
    potential : ndarray
        Potential of gland on the same grid.
    breast : ndarray of bool
        Where gland's share is counted.
    share : float
        Gland's share.
    cells : float
        Volume of the chosen cells against that of gland.
    rng : Generator

    Returns
    -------
    ndarray
        The potential, flattened.
    """
    seeds = net.seeds
    present = np.argwhere(seeds[..., 3] >= ABSENT)
    points = np.stack([part[breast] for part in coordinates_mm], axis=-1)
    points = (points - net.origin_mm) / net.cell_mm
    cell = cKDTree(present + seeds[(*present.T, slice(3))]).query(points)[1]
    values = potential[breast]
    volume = np.bincount(cell, minlength=len(present))
    score = np.bincount(cell, values, len(present)) / np.maximum(volume, 1)
    score += COLUMN_UNEVEN * _columns(seeds.shape[:3], rng)[tuple(present.T)]
    score += CELL_UNEVEN * rng.standard_normal(len(present))
    order = np.argsort(-np.where(volume > 0, score, -np.inf))
    taken = np.cumsum(volume[order]) <= cells * share * len(values)
    behind = net.origin_mm[0] + net.cell_mm * (present[:, 0] + seeds[(*present.T, 0)])
    seeds[(*present.T, 4)] *= np.clip(behind / YIELDS_MM, YIELDS, 1.0)
    seeds[(*present[order[taken]].T, 4)] = GLANDULAR
    knee = np.quantile(values, max(1.0 - STEEP_CELLS * share, 0.0))
    above = potential - knee
    flattened: NDArray[np.float64] = knee + np.minimum(above, FLAT * above)
    return flattened


def _columns(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    """Noise of variance 1 over a net's cells that changes slowly along its last axis."""
    widths = (COLUMN_WIDTH, COLUMN_WIDTH, COLUMN_CELLS)
    noise = ndimage.gaussian_filter(rng.standard_normal(shape), widths, mode="wrap")
    return noise / noise.std()


def across_and_pressed(
    lateral_mm: NDArray[np.float64], superior_mm: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lengths across the direction in which plates press and along it."""
    turn = np.deg2rad(PRESSED_DEG)
    return (
        lateral_mm * np.cos(turn) + superior_mm * np.sin(turn),
        superior_mm * np.cos(turn) - lateral_mm * np.sin(turn),
    )


def lobule_coordinates(
    outline: Outline, frame: VoxelFrame, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Coordinates in which lobules are of equal size: bent, and drawn together at the nipple."""
    x, lateral, superior = mesh(frame)
    behind = outline.shape.depth_mm + APEX_MM - x
    distance = np.sqrt(behind**2 + lateral**2 + superior**2 + ROUNDING_MM**2)
    scale = (distance / REFERENCE_MM) ** -SHRINK
    across, pressed = across_and_pressed(lateral, superior)
    bent = []
    for part, longer in ((behind, 1.0), (across, 1.0), (pressed, PRESSED_LENGTH)):
        warp = sum(
            amplitude * smooth_noise(rng, frame, wavelength) for amplitude, wavelength in WARPS_MM
        )
        bent.append((part * scale + warp) / longer)
    return bent


def septum_mm(
    skin_depth_mm: NDArray[np.float64], mean_mm: float, frame: VoxelFrame, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Mean thickness of the walls between fat lobules, mm: uneven, thicker near the skin.

    Cooper's ligaments, sheets of some tenths of a millimetre, hang up the gland at the skin.
    """
    uneven = smooth_noise(rng, frame, 22.0)
    near_skin = 1.0 + 0.35 * np.exp(-((skin_depth_mm.clip(0) / 9.0) ** 2))
    thickness: NDArray[np.float64] = mean_mm * near_skin * np.clip(1.0 + 0.35 * uneven, 0.25, 2.0)
    return thickness
