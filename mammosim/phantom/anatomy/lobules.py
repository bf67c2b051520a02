"""Fat lobules and the fibrous walls between them: nets of unequal cells in bent coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mammosim.geometry import VoxelFrame
from mammosim.phantom.anatomy._net_kernels import ABSENT, Net
from mammosim.phantom.anatomy.noise import smooth_noise
from mammosim.phantom.anatomy.outline import Outline, mesh

LOBULE_MM = 9.0
"""Side of the lattice cells of fat lobules `REFERENCE_MM` from the nipple, mm. With a tenth of
the cells missing a compartment has a mean volume of 0.7 cm3 there; measured in histology are
0.94 cm3 under the skin, 0.89 cm3 behind the gland and 0.31 cm3 within it (Bakic et al. 2002,
Med Phys 29:2131-2139, and later work of that group)."""

FINE_MM = 4.6
"""The same of the thinner septa within lobules, mm. Chosen by eye."""

REFERENCE_MM, SHRINK = 55.0, 0.26
"""Lobules grow with the power `SHRINK` of the distance from the nipple, so that those 25 mm behind
it have a third of the volume of those near the skin and the chest wall; their length along the
distance is 1 / (1 - SHRINK) = 1.6 of their width."""

APEX_MM, ROUNDING_MM = 10.0, 18.0
"""Where the lobules' coordinates converge, in front of the nipple's foot, and distance below which
they no longer do, mm."""

WARPS_MM = ((1.7, 36.0), (0.16, 12.0))
"""Amplitude and wavelength by which walls are bent, mm: their slopes, 2 pi amplitude / wavelength,
add up to 0.5, below which coordinates hardly ever fold over. Chosen by eye."""

ABSENT_SHARE, WEIGHT = 0.12, 0.34
"""Share of the lattice cells without a lobule, and spread of the weights, cells squared: both make
lobules unequal. Chosen by eye."""

LEAN_SHARE = 0.30
"""Share of the cells that push no gland aside: lobes of the gland."""


def draw_net(
    coordinates_mm: list[NDArray[np.float64]], cell_mm: float, rng: np.random.Generator
) -> Net:
    """Points of a net that covers coordinates.

    Parameters
    ----------
    coordinates_mm : list of three ndarray
        Coordinates of the net all over the coarse grid, mm.
    cell_mm : float
        Side of its lattice cells, mm.
    rng : Generator
    """
    low = np.array([part.min() for part in coordinates_mm]) - 2.0 * cell_mm
    high = np.array([part.max() for part in coordinates_mm]) + 2.0 * cell_mm
    cells = np.ceil((high - low) / cell_mm).astype(int)
    seeds = np.empty((*cells, 6), np.float32)
    seeds[..., :3] = rng.uniform(0.05, 0.95, (*cells, 3))
    seeds[..., 3] = WEIGHT * rng.random(tuple(cells))
    seeds[..., 3][rng.random(tuple(cells)) < ABSENT_SHARE] = 2.0 * ABSENT
    fat = rng.random(tuple(cells))
    seeds[..., 4] = np.where(fat < LEAN_SHARE, 0.0, 0.6 + rng.random(tuple(cells)))
    seeds[..., 5] = rng.random(tuple(cells))
    return Net(seeds, low, cell_mm)


def lobule_coordinates(
    outline: Outline, frame: VoxelFrame, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """Coordinates in which lobules are of equal size: bent, and drawn together at the nipple."""
    x, lateral, superior = mesh(frame)
    behind = outline.shape.depth_mm + APEX_MM - x
    distance = np.sqrt(behind**2 + lateral**2 + superior**2 + ROUNDING_MM**2)
    scale = (distance / REFERENCE_MM) ** -SHRINK
    bent = []
    for part in (behind, lateral, superior):
        warp = sum(
            amplitude * smooth_noise(rng, frame, wavelength) for amplitude, wavelength in WARPS_MM
        )
        bent.append(part * scale + warp)
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
